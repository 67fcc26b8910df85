"""Fuzzes a daemon in virtual time with messages of strangers, sensors and the lease's holder.

Strangers send junk on every key and ask for everything; sensor keys get news that is valid, and
wild. An honest operator who drives meanwhile keeps the lease, and nothing is in FAULT. In every
third job it is the operator that goes wild, in the range of what the messages allow; then the arm
may run into something, and only what came of that is excused.
"""

import random
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from hypothesis import strategies as st
from hypothesis.strategies import SearchStrategy
from pydantic import ValidationError
from telerobot.config.load import Cell, load_cell, shipped
from telerobot.protocols import topics as t
from telerobot.protocols.topics import Flow
from telerobot.server.mode import Mode
from telerobot.tools.client.protocol_client import NoLease
from telerobot.tools.scripts.player import Phase
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation
from telerobot.tools.soak.cli import ComputedSights, Touches

from .. import drawn
from .messages import KEPT, Said, fields_of, of_strangers, words_of
from .outcome import Outcome

RUNS = 2
"""Runs of one job [1]."""
TURNS, TURN_TICKS = 30, 3
"""Turns of an attack [1], and their length [periods]."""
AFTER_TICKS = 30
"""Periods in which what was sent last may show [1]."""


Turn = tuple[Sequence[Said], tuple[Said, bool] | None]
"""What strangers say at once; what the holder does, and whether he goes on with it."""


@dataclass(frozen=True)
class Attack:
    """What is sent to a daemon, turn by turn."""

    turns: Sequence[Turn]

    def __repr__(self) -> str:
        told = []
        for i, (said, held) in enumerate(self.turns):
            told += [f"tick {i * TURN_TICKS}: {one!r}" for one in said]
            told += [f"tick {i * TURN_TICKS}, by the holder: {held[0]!r}"] if held else []
        return "; ".join(told) or "nothing"

    @property
    def ticks(self) -> int:
        """Periods until what was sent last may show."""
        last = max((i for i, turn in enumerate(self.turns) if any(turn)), default=0)
        return last * TURN_TICKS + AFTER_TICKS


def attacks(cell: Cell, *, wild: bool) -> SearchStrategy[Attack]:
    """Return attacks on a cell by strangers; with commands of a `wild` holder beside them."""
    said = st.lists(of_strangers(cell), max_size=8).map(tuple)
    commanded = [
        st.builds(Said, st.just(topic), fields_of(topic.message, words_of(cell)))
        for topic in (*t.COMMANDS, *t.REQUESTS)
        if topic not in KEPT
    ]
    held = st.none() | st.tuples(st.one_of(commanded), st.booleans()) if wild else st.none()
    return st.tuples(*TURNS * [st.tuples(said, held)]).map(Attack)


def cell_of(seed: int) -> str:
    """Return the name of the cell that a seed's job runs in: one after the other."""
    cells = shipped("cells")
    return cells[seed % len(cells)]


def play(seed: int) -> Outcome:
    """Run one job in the shipped cell of the seed."""
    cell, wild = load_cell(cell_of(seed)), seed % 3 == 2
    outcome = Outcome(f"network, {cell.config.name}, {'holder' if wild else 'stranger'}", seed)
    outcome.reasons = drawn.play(
        attacks(cell, wild=wild),
        lambda attack: _judge(cell, attack, seed, outcome, wild=wild),
        f"network {seed}",
        RUNS,
    )
    return outcome


def _judge(cell: Cell, attack: Attack, seed: int, outcome: Outcome, *, wild: bool) -> list[str]:
    """Play an attack; return what speaks against the daemon."""
    duration_s = attack.ticks * cell.config.timing.period_s
    script = _script(seed, duration_s, wild=wild)
    simulation = Simulation(cell, script, cameras=lambda s: ComputedSights(s, seed))
    touches = Touches(simulation)
    simulation.on_tick = Attacker(attack, outcome, wild=wild).attack
    try:
        result = simulation.run()
    except Exception as error:  # noqa: BLE001  that nothing is raised is what is tried
        return [outcome.raised(error, "simulation")]
    reasons = []
    if result.summary["limit_violations"]:
        first = simulation.observer.violations[0]
        reasons.append(
            f"{result.summary['limit_violations']} limit violations: {first.joint} {first.kind} "
            f"{first.value:.6g} over {first.bound:.6g} at {first.time_s:.3f} s"
        )
    reasons += touches.unexplained(excused=wild)
    for event in simulation.events:
        if event.name == "lease_expired" and not wild:
            reasons.append(f"lease_expired at {event.time_s:.2f} s: {event.detail}")
    if result.summary["failure"] and not wild:
        reasons.append(f"not played: {result.summary['failure']}")
    return reasons


def _script(seed: int, duration_s: float, *, wild: bool) -> Script:
    """Return what the operator does beside the attack: sticks there and back, if he is honest."""
    dice, sticks = random.Random(f"sticks {seed}"), list[dict[str, Any]]()
    for i in range(0 if wild else round(duration_s + 0.5)):
        twist = [dice.uniform(-0.1, 0.1) for _ in range(3)] + [dice.uniform(-0.3, 0.3)] * 3
        for k, sense in enumerate((1.0, -1.0)):
            stick = {"twist": [sense * x for x in twist], "expressed_in": "base"}
            sticks.append({"at_s": 0.1 + i + 0.5 * k, "cmd/joystick": stick})
    last_s = max((step["at_s"] for step in sticks), default=0.0)
    return Script.model_validate({"duration_s": max(duration_s, last_s + 0.1), "step": sticks})


class Attacker:
    """Sends an attack, turn by turn, and helps a wild holder up."""

    def __init__(self, attack: Attack, outcome: Outcome, *, wild: bool) -> None:
        self._turns, self._outcome, self._wild = attack.turns, outcome, wild
        self._ticks = 0

    def attack(self, simulation: Simulation) -> None:
        """Send what this tick brings, once the arm was enabled.

        What comes before, as news of an obstacle that is stale, may rightly forbid the enabling.
        """
        if simulation.player.phase is not Phase.PLAYING:
            return
        turn, between = divmod(self._ticks, TURN_TICKS)
        self._ticks += 1
        if between or turn >= len(self._turns):
            return
        link = simulation.link
        said, held = self._turns[turn]
        for one in said:
            self._outcome.inputs[f"{one.topic.flow.name.lower()} of strangers"] += 1
            payload = one.payload(simulation.cycle.tick)
            if one.topic.flow is Flow.REQUEST:
                link.ask(one.topic, payload, lambda _reply: None, one.proof)
            else:
                link.put(one.topic, payload, one.proof)
        if held is not None:
            self._command(simulation, *held)
        if self._wild:
            self._recover(simulation)

    def _command(self, simulation: Simulation, held: Said, streamed: bool) -> None:
        topic, client = held.topic, simulation.player.client
        fields = dict(held.fields) if isinstance(held.fields, dict) else {}
        try:
            if topic.flow is Flow.REQUEST:
                client.request(topic, lambda _reply: None, **fields)
            elif streamed and topic.life is t.Life.STREAM:
                client.stream(topic, **fields)
            else:
                client.command(topic, **fields)
        except (NoLease, ValidationError):
            return  # the lease is lost, and nobody may command; or fields do not fit one another
        self._outcome.inputs[f"{topic.flow.name.lower()} of the holder"] += 1

    def _recover(self, simulation: Simulation) -> None:
        """Take the lease again, enable and go on: a stopped arm tells little."""
        client, mode = simulation.player.client, simulation.cycle.mode
        action = {Mode.READY: "enable", Mode.HOLD: "resume"}.get(mode)
        try:
            client.acquire(lambda _reply: None)
            if mode is not Mode.ENABLED:
                client.clear_protective_stop(lambda _reply: None)
            if action is not None:
                client.request(t.MODE, lambda _reply: None, action=action)
        except NoLease:
            return
