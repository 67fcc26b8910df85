"""Part `wild`: careless operators in all kinds of cells; every fault needs a touch as its cause.

Each run is judged by the bus, the physics and the events: no exception, no bound broken, no refusal
by the gate, and no fault but one: the arm of a cell that feels no collisions runs into something
that nobody told of, faster than the leash can stop it, and a joint falls behind. That is a quick
stop by the table of stops; the report counts it.
"""

from dataclasses import dataclass, field

from telerobot.config.load import load_cell
from telerobot.tools.simulation.simulation import Simulation
from telerobot.tools.soak.cli import ComputedSights, Touches

from ..part import Part, Selection
from ..runs import Runs
from .wild import equipped, wild

CELLS = ("ur5e_scene", "pa10_vision", "pa10_all", "pa10_scene", "ranger", "pa10_platform", "pa10")
"""Cells of wild operators, in turns by the seed."""


@dataclass(frozen=True)
class Wild:
    """Result of one run."""

    name: str
    enabled_s: float
    touched: bool
    stopped_by_touch: bool
    """The fault is explained by what the arm ran into."""
    reasons: list[str] = field(default_factory=list)


class Wilds(Runs[Wild]):
    """Summary of all runs."""

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        return super().figures() | {
            "enabled_s": round(sum(run.enabled_s for run in self.runs), 1),
            "touched": sum(run.touched for run in self.runs),
            "stopped_by_touch": self.stopped,
        }

    @property
    def stopped(self) -> list[str]:
        """Runs that ended in a quick stop at what the arm ran into."""
        return [run.name for run in self.runs if run.stopped_by_touch]

    def lines(self) -> list[str]:
        """Return the report."""
        f = self.figures()
        return [
            f"{f['runs']} runs, {f['enabled_s']} s enabled; {f['touched']} ran into something, "
            f"{len(self.stopped)} of them to a quick stop",
            *super().lines(),
        ]


def play(seed: int) -> Wild:
    """Simulate the run of a seed, up to a fault, and judge it."""
    return play_in(CELLS[seed % len(CELLS)], seed)


def play_in(name: str, seed: int) -> Wild:
    """Simulate the run of a seed in a shipped cell, up to a fault, and judge it."""
    cell = equipped(load_cell(name), seed)
    simulation = Simulation(cell, wild(cell, seed), cameras=lambda s: ComputedSights(s, seed))
    touches = Touches(simulation)
    title = f"{name} seed {seed}"
    try:
        result = simulation.run(lambda: any(e.name == "fault" for e in simulation.events))
    except Exception as error:  # noqa: BLE001  whatever is raised stops an arm: it is counted
        return Wild(title, 0.0, touches.felt, False, [f"raised {type(error).__name__}: {error}"])
    reasons = []
    if result.summary["failure"]:
        reasons.append(f"not played: {result.summary['failure']}")
    if simulation.observer.violations:
        worst = simulation.observer.violations[0]
        reasons.append(f"{worst.joint} {worst.kind} {worst.value:.6g} over {worst.bound:.6g}")
    reasons += touches.unexplained()
    excused = any(touches.explain(event) for event in simulation.events)
    enabled = sum(state.mode == "enabled" for state in result.states)
    period_s = cell.config.timing.period_s
    return Wild(title, enabled * period_s, touches.felt, excused, reasons)


def jobs(selection: Selection) -> list[int]:
    """Return every seed: each decides its cell."""
    for name in CELLS:
        load_cell(name)  # a mistake in a cell shows here, in one line
    return list(selection.seeds)


WILD = Part(jobs, play, Wilds)
