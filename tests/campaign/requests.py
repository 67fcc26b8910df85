"""Part `requests`: requests at every distance; mode and drives must agree afterwards.

One operator asks for some things, 0 to 20 periods apart, from every mode that lasts. The daemon
takes requests once a period, so that a distance between two of these is one of them. Judged by the
drives' own states, as the physics has them, and not by what telemetry says of them.
"""

from collections.abc import Sequence
from typing import Literal, get_args

from hypothesis import strategies as st
from telerobot.config.load import Cell, load_cell
from telerobot.protocols import topics as t
from telerobot.protocols.messages.requests import Reply
from telerobot.protocols.messages.rig import RigFault
from telerobot.server.mode import Mode
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from . import drawn
from .fuzz.outcome import Outcome
from .part import Part, Selection
from .runs import Runs

Request = Literal[
    "enable", "disable", "hold", "resume", "reset", "protective_stop", "protective_clear",
    "release", "acquire",
]  # fmt: skip
Asked = tuple[Request, int]
"""A request, and so many periods until the next one."""
APART = 20
"""Periods between two requests, at most [1]."""
SCRIPTS = 5
"""Scripts of one job [1]."""
STARTS: dict[Mode, tuple[Request, ...]] = {
    Mode.READY: ("acquire",),
    Mode.ENABLED: ("acquire", "enable"),
    Mode.HOLD: ("acquire", "enable", "hold"),
    Mode.FAULT: ("acquire", "enable"),
}
"""Modes that scripts begin in, and what brings an arm there; to FAULT, before a drive fails."""
TOLERATED = 2
"""An energised mode with a drive elsewhere lasts no longer than so many ticks [1]."""
SETTLED_TICKS = 60
"""Ticks within which a request comes about, if it does: drives take some time [1]."""
LONGEST_TICKS = 450
"""Every request is answered by then [1]."""
_ON = "operation_enabled"

SCRIPT = st.lists(
    st.tuples(st.sampled_from(get_args(Request)), st.integers(0, APART)), min_size=1, max_size=8
)
"""What an operator asks for, one after the other."""


def faults_of(cell: Cell, start: Mode, script: Sequence[Asked]) -> list[str]:
    """Play a script from a mode on; return the broken promises of the daemon."""
    asking = AskingOperator(cell)
    try:
        for request in STARTS[start]:
            asking.ask(request)
            asking.settle()
        if start is Mode.FAULT:
            asking.fail()
        if asking.mode is not start:
            return [f"cannot be brought to {start}: it is {asking.mode}"]
        before = len(asking.simulation.events)
        for request, apart in script:
            asking.ask(request)
            asking.run(apart)
        asking.settle()
        errors = [e for e in asking.simulation.events[before:] if e.severity == "error"]
        return asking.faults + [f"fault: {event.detail}" for event in errors[:1]]
    finally:
        asking.close()


class AskingOperator:
    """An arm whose operator asks for one thing after another."""

    def __init__(self, cell: Cell) -> None:
        script = Script.model_validate({"duration_s": 3600, "auto_enable": False})
        self.simulation = Simulation(cell, script)
        self.simulation.cycle.boot()
        self.faults: list[str] = []
        self._joint = cell.config.mechanism.drives[0].joint
        self._astray = 0
        self._open: list[str] = []
        self.run(5)

    @property
    def mode(self) -> Mode:
        """The daemon's mode."""
        return self.simulation.cycle.mode

    @property
    def drives(self) -> tuple[str, ...]:
        """The drives' states, as the physics has them."""
        return tuple(drive.state.name.lower() for drive in self.simulation.rig.drives.values())

    def run(self, ticks: int) -> None:
        """Let time pass, and judge every tick of it."""
        for _ in range(ticks):
            self.simulation.step()
            astray = self.mode.energised and any(state != _ON for state in self.drives)
            self._astray = self._astray + 1 if astray else 0
            if self._astray == TOLERATED + 1:
                self.faults.append(f"mode is {self.mode}, drives are {self._seen()}")

    def ask(self, request: Request) -> None:
        """Ask for something; its answer is waited for by `settle`."""
        client = self.simulation.player.client
        self._open.append(request)

        def answered(_reply: Reply) -> None:
            self._open.remove(request)

        if request == "acquire":
            client.acquire(answered)
        elif request == "protective_stop":
            client.protective_stop(answered)
        elif request == "protective_clear":
            client.clear_protective_stop(answered)
        elif client.secret is None:
            self._open.remove(request)  # it knows that it holds no lease, and asks for nothing
        elif request == "release":
            client.release(answered)
        else:
            client.request(t.MODE, answered, action=request)

    def settle(self) -> None:
        """Wait for all answers, and until what was asked has come about; judge it."""
        self.run(SETTLED_TICKS)
        for _ in range(LONGEST_TICKS):
            if not self._open:
                break
            self.run(1)
        if self._open:
            self.faults.append(f"no answer to {', '.join(self._open)}")
        if any((state == _ON) is not self.mode.energised for state in self.drives):
            self.faults.append(f"settled in {self.mode} with drives {self._seen()}")

    def fail(self) -> None:
        """Let a drive fail, and the cause be gone."""
        for on in (True, False):
            self.simulation.rig.inject(RigFault(kind="fault", target=self._joint, on=on))
            self.run(SETTLED_TICKS)

    def close(self) -> None:
        """End the simulation."""
        self.simulation.cycle.close()
        self.simulation.buses.hubs[0].close()

    def _seen(self) -> str:
        return ", ".join(sorted(set(self.drives)))


def _jobs(selection: Selection) -> list[tuple[str, Mode, int]]:
    return [("pa10", start, seed) for seed in selection.seeds for start in STARTS]


def _play(job: tuple[str, Mode, int]) -> Outcome:
    name, start, seed = job
    cell, outcome = load_cell(name), Outcome(f"requests from {start}", seed)

    def judge(script: Sequence[Asked]) -> list[str]:
        outcome.inputs["requests"] += len(script)
        return faults_of(cell, start, script)

    outcome.reasons = drawn.play(SCRIPT, judge, outcome.name, SCRIPTS)
    return outcome


ASKING = Part(_jobs, _play, Runs[Outcome])
