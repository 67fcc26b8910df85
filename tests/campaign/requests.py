"""Part `requests`: pairs of requests at every distance; mode and drives must agree afterwards.

One operator asks for two things, 0 to 20 periods apart, from every mode that lasts. The daemon
takes requests once a period, so that a distance between two of these is one of them. Judged by the
drives' own states, as the physics has them, and not by what telemetry says of them.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Literal

from telerobot.config.load import Cell, load_cell
from telerobot.protocols import topics as t
from telerobot.protocols.messages.requests import Reply
from telerobot.protocols.messages.rig import RigFault
from telerobot.server.mode import Mode
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from .part import Part, Selection

Request = Literal[
    "enable", "disable", "hold", "resume", "reset", "protective_stop", "protective_clear",
    "release", "acquire",
]  # fmt: skip
REQUESTS: tuple[Request, ...] = (
    "enable", "disable", "hold", "resume", "reset", "protective_stop", "protective_clear",
    "release", "acquire",
)  # fmt: skip
STARTS = (Mode.READY, Mode.ENABLED, Mode.HOLD, Mode.FAULT)
APART = range(21)
"""Periods between the two requests [1]."""
TOLERATED = 2
"""An energised mode with a drive elsewhere lasts no longer than so many ticks [1]."""
SETTLED_TICKS = 60
"""Ticks within which a request comes about, if it does: drives take some time [1]."""
LONGEST_TICKS = 450
"""Every request is answered by then, and every mode reached again [1]."""
_ON = "operation_enabled"


@dataclass
class Pair:
    """Two requests, and what followed."""

    start: Mode
    first: Request
    second: Request
    apart: int
    faults: list[str] = field(default_factory=list)
    """Broken promises of the daemon."""

    @property
    def text(self) -> str:
        """Return the case in a line."""
        return f"{self.start}: {self.first}, {self.second} after {self.apart} ticks"


class AskingOperator:
    """An arm whose operator asks for one thing after another."""

    def __init__(self, cell: Cell) -> None:
        script = Script.model_validate({"duration_s": 3600, "auto_enable": False})
        self.simulation = Simulation(cell, script)
        self.simulation.cycle.boot()
        self._joint = cell.config.mechanism.drives[0].joint
        self._astray = 0
        self._pair = Pair(Mode.READY, "enable", "enable", 0)
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
                self._say(f"mode is {self.mode}, drives are {self._seen()}")

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

    def play(self, pair: Pair) -> Pair:
        """Play a pair, and judge it; the arm is brought to where it starts before."""
        self._pair, self._astray = pair, 0
        if not self._reach(pair.start):
            return pair
        simulation = self.simulation
        before = len(simulation.events)
        del simulation.states[:-1], simulation.truths[:-1]
        self.ask(pair.first)
        self.run(pair.apart)
        self.ask(pair.second)
        self.run(SETTLED_TICKS)
        for _ in range(LONGEST_TICKS):
            if not self._open:
                break
            self.run(1)
        if self._open:
            self._say(f"no answer to {', '.join(self._open)}")
            self._open.clear()
        self._judge(before)
        return pair

    def close(self) -> None:
        """End the simulation."""
        self.simulation.cycle.close()
        self.simulation.buses.hubs[0].close()

    def _judge(self, before: int) -> None:
        meant = self.mode.energised
        if any((state == _ON) is not meant for state in self.drives):
            self._say(f"settled in {self.mode} with drives {self._seen()}")
        faults = [e.detail for e in self.simulation.events[before:] if e.severity == "error"]
        if faults:
            self._say(f"fault: {faults[0]}")

    def _reach(self, mode: Mode) -> bool:
        """Bring the arm to a mode by the operator's requests; return whether it came there."""
        client = self.simulation.player.client
        if self.simulation.states[-1].protective_stop:
            self._ask_and_wait("protective_clear")
        if client.secret is None or self.simulation.states[-1].lease_holder != client.name:
            self._ask_and_wait("acquire")
        if self.mode is Mode.FAULT and mode is not Mode.FAULT:
            self._ask_and_wait("reset")
        if mode is Mode.FAULT and self.mode is not Mode.FAULT:
            self.simulation.rig.inject(RigFault(kind="fault", target=self._joint))
            self.run(20)
            self.simulation.rig.inject(RigFault(kind="fault", target=self._joint, on=False))
            self.run(SETTLED_TICKS)
        if mode is Mode.READY and self.mode.energised:
            self._ask_and_wait("disable")
        if mode.energised and self.mode in (Mode.READY, Mode.HOLD) and self.mode is not mode:
            self._ask_and_wait("enable")
        if mode is Mode.HOLD and self.mode is Mode.ENABLED:
            self._ask_and_wait("hold")
        if self.mode is not mode:
            self._say(f"cannot be brought to {mode}: it is {self.mode}")
        return self.mode is mode

    def _ask_and_wait(self, request: Request) -> None:
        self.ask(request)
        for _ in range(LONGEST_TICKS):
            self.run(1)
            if not self._open:
                break
        self._open.clear()
        self.run(SETTLED_TICKS)

    def _seen(self) -> str:
        return ", ".join(sorted(set(self.drives)))

    def _say(self, fault: str) -> None:
        self._pair.faults.append(fault)


@dataclass(frozen=True)
class Pairs:
    """Every pair that begins with one request, in one mode."""

    start: str
    first: str
    played: int
    faults: tuple[str, ...]

    @property
    def name(self) -> str:
        """The run, in a few words."""
        return f"requests {self.start} {self.first}"

    @property
    def reasons(self) -> list[str]:
        """Broken promises."""
        return list(self.faults[:5])


class Agreement:
    """Summary of all pairs."""

    def __init__(self, every: Sequence[Pairs]) -> None:
        self.every = every
        self.played = sum(pairs.played for pairs in every)
        self.faults = [fault for pairs in every for fault in pairs.faults]

    @property
    def kept(self) -> bool:
        """True when mode and drives agreed always."""
        return not self.faults

    def figures(self) -> dict[str, object]:
        """Return everything as plain values, for JSON."""
        return {"pairs": self.played, "by_start": [asdict(pairs) for pairs in self.every]}

    def lines(self) -> list[str]:
        """Return the report for people."""
        lines = [f"pairs of requests    {self.played}", *self.faults[:50]]
        lines.append("modes and drives agree" if self.kept else f"{len(self.faults)} disagree")
        return lines


def _jobs(_selection: Selection) -> list[tuple[str, Mode, Request]]:
    return [("pa10", start, first) for start in STARTS for first in REQUESTS]


def _play(job: tuple[str, Mode, Request]) -> Pairs:
    name, start, first = job
    asking = AskingOperator(load_cell(name))
    try:
        played = [
            asking.play(Pair(start, first, second, apart)) for second in REQUESTS for apart in APART
        ]
    finally:
        asking.close()
    faults = tuple(f"{pair.text}: {fault}" for pair in played for fault in pair.faults)
    return Pairs(str(start), first, len(played), faults)


ASKING = Part(_jobs, _play, Agreement)
