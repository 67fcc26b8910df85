"""Fuzzes a real daemon with its virtual hardware, over Zenoh, with a stranger's messages.

An operator drives meanwhile. He keeps the lease, the arm stays enabled, nothing is in FAULT, and
the daemon's memory does not grow.
"""

import time
from itertools import cycle, islice
from pathlib import Path

from telerobot.config.load import load_cell
from telerobot.drivers.network.session import Session
from telerobot.protocols.topics import Flow
from telerobot.tools.client.operator import Operator, OperatorError
from telerobot.tools.host.local_plant import ChildDied, LocalPlant

from .. import drawn
from .messages import of_strangers
from .outcome import Outcome

EVERY = 10
"""Of the seeds, the first of so many is played on the wire, too: processes take their time [1]."""
CELL = "pa10_scene"
FULL_S, SECONDS = 4.0, 6.0
"""The attack fills every ring of messages [s], and goes on for so long [s]."""
DRAWN = 1000
"""Messages that are drawn beforehand, and sent again and again [1]."""
AT_ONCE = 40
"""Messages between two turns of the operator [1]."""
START_S = 60.0
"""Processes are up within [s]."""
MOST_MB = 20.0
"""Once rings are full, its memory may grow by so much [MB]; the flight recorder keeps 1 MB a second
of it until it has its 20 s."""


def play(seed: int) -> Outcome:
    """Run one job."""
    outcome = Outcome(f"wire, {CELL}", seed)
    try:
        with LocalPlant(load_cell(CELL)) as plant:
            try:
                _attack(plant, seed, outcome)
            finally:
                plant.stop()
            outcome.reasons += [
                line for line in plant.complaints().splitlines() if "Traceback" in line
            ]
    except (ChildDied, OperatorError) as error:
        outcome.reasons.append(f"{type(error).__name__}: {error}")
    return outcome


def _attack(plant: LocalPlant, seed: int, outcome: Outcome) -> None:
    plant.wait(plant.answers, START_S, "the daemon does not listen")
    stream = drawn.stream(of_strangers(plant.cell), f"wire {seed}")
    stranger = cycle([*islice(stream, DRAWN)])
    with Operator(plant.cell, name="honest") as operator:
        operator.spin(
            START_S, lambda: operator.state is not None and operator.state.mode == "ready"
        )
        operator.acquire()
        operator.enable()
        operator.joystick([0.0, 0.0, 0.005, 0.0, 0.0, 0.0], expressed_in="base")
        operator.spin(1.0)
        before_mb, first = None, len(operator.events)
        session = Session(operator.cell, operator.endpoint)
        full_s = time.monotonic() + FULL_S
        while time.monotonic() < full_s + SECONDS:
            if before_mb is None and time.monotonic() > full_s:
                before_mb = _resident_mb(plant)
            plant.raise_if_dead()
            for said in islice(stranger, AT_ONCE):
                payload = said.payload(operator.client.seen_tick)
                outcome.inputs["messages on the wire"] += 1
                if said.topic.flow is Flow.REQUEST:
                    session.ask(said.topic, payload, _ignore, said.proof)
                else:
                    session.put(said.topic, payload, said.proof)
            session.poll()
            operator.turn()
        session.close()
        operator.spin(0.5)
        grown = _resident_mb(plant) - (before_mb or 0.0)
        if grown > MOST_MB:
            outcome.reasons.append(f"the daemon grew by {grown:.1f} MB, at most {MOST_MB:g}")
        if not operator.holds_lease:
            outcome.reasons.append("the operator who drove lost the lease")
        for event in operator.events[first:]:
            if event.severity == "error":
                outcome.reasons.append(f"{event.name} at {event.time_s:.2f} s: {event.detail}")


def _ignore(_reply: bytes) -> None:
    """Take an answer, and do nothing."""


def _resident_mb(plant: LocalPlant) -> float:
    """Return the memory that the daemon holds [MB]."""
    if plant.daemon is None:
        raise ChildDied("there is no daemon")
    status = Path(f"/proc/{plant.daemon.pid}/status").read_text(encoding="ascii").splitlines()
    return int(next(line for line in status if line.startswith("VmRSS")).split()[1]) / 1024
