"""Part `search`: a beam's pegs go into nodes that are farther off than their chamfers catch.

Drawn are how far both nodes are from where they are meant to be, how far one is from the other, and
whether the right arm stands where the daemon is told. The distance between the nodes along the beam
is the pegs', which no arm can change. A run is good when both pegs are in, and also when it says
`jammed`; but nine of ten are to be in. Judged by the physics: depths, and forces summed by
magnitude.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from telerobot.config.load import Cell, altered, load_cell
from telerobot.config.schema.section import PoseSection
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.simulation import Simulation

from ..part import Part, Selection
from ..runs import Runs

CELL, SCRIPT = "pa10_pair", "two_nodes_search"
BOTH, APART = 0.005, 0.004
"""Nodes are off by at most so much along each axis across, and one from the other [m]."""
BASE, TURNED = (0.003, -0.003, 0.003), math.radians(0.5)
"""What the right arm's base is off by, in half of the runs [m], [rad]."""
DEEP = 0.020
"""A peg is in when it is so deep [m]."""
PUSH_N = 120.0
"""Pegs press with at most so much, summed over what they touch [N]."""
IN = 0.9
"""Part of the runs that is to succeed [1]."""


@dataclass(frozen=True)
class Searched:
    """Result of one run; all plain values."""

    name: str
    depths_m: tuple[float, ...]
    seconds: float
    """From enabling to the end, which comes when both pegs are in [s]."""
    push_n: float
    jammed: bool
    """It was told at the end that they are not in."""
    reasons: list[str]

    @property
    def inserted(self) -> bool:
        """True when both pegs are in."""
        return min(self.depths_m) >= DEEP


class Searching(Runs[Searched]):
    """Summary of all runs."""

    @property
    def kept(self) -> bool:
        """True when enough are in, the rest is named, and nothing else speaks against any."""
        return super().kept and sum(r.inserted for r in self.runs) >= IN * len(self.runs)

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        return super().figures() | {
            "inserted": sum(run.inserted for run in self.runs),
            "named": sum(run.jammed and not run.inserted for run in self.runs),
            "push_n": max((run.push_n for run in self.runs), default=None),
        }

    def lines(self) -> list[str]:
        """Return the report."""
        f = self.figures()
        return [
            f"{f['inserted']} of {f['runs']} beams in, {f['named']} of the others named; pushed "
            f"with at most {f['push_n']:.0f} N",
            *super().lines(),
        ]


def drawn(seed: int) -> tuple[Cell, Cell]:
    """Return the cell that the daemon is told, and the real one."""
    draw = np.random.default_rng([seed, 8])
    y, z = draw.uniform(-BOTH, BOTH, 2).tolist()
    up, ahead = draw.uniform(-APART, APART, 2).tolist()
    told = load_cell(CELL)
    rig = told.config.rig
    if rig is None or len(rig.holes) != 2:
        raise ValueError(f"cell {CELL}: two holes are expected")
    # A hole's x is up, its y along the beam, and its z towards the beam.
    holes = tuple(
        hole.model_copy(
            update={"misplaced": PoseSection(xyz=(z + side * up / 2, y, side * ahead / 2))}
        )
        for hole, side in zip(rig.holes, (1, -1), strict=True)
    )
    real = altered(told, {"rig.holes": holes})
    return told, _shifted(real) if draw.random() < 0.5 else real


def _shifted(cell: Cell) -> Cell:
    """Return a cell whose second arm stands elsewhere."""
    second = cell.others[0]
    T, each = second.config.mechanism.T_world_base, TURNED / math.sqrt(3.0)
    x, y, z = (a + b for a, b in zip(T.xyz, BASE, strict=True))
    roll, pitch, yaw = (a + b for a, b in zip(T.rpy, (each, -each, each), strict=True))
    T = PoseSection(xyz=(x, y, z), rpy=(roll, pitch, yaw))
    second = altered(second, {"mechanism.T_world_base": T})
    return replace(cell, others=(second, *cell.others[1:]))


def play(seed: int, script: Script | None = None) -> Searched:
    """Simulate the run of a seed, and judge it."""
    told, real = drawn(seed)
    simulation = Simulation(told, load_script(SCRIPT) if script is None else script, real=real)

    def depths() -> tuple[float, ...]:
        beam = simulation.truths[-1].beam if simulation.truths else None
        return () if beam is None else beam.peg_depth

    def inserted() -> bool:
        return min(depths(), default=0.0) >= DEEP

    result = simulation.run(until=inserted)
    push = max(t.beam.push_peak for t in result.truths if t.beam is not None)
    jammed = any(event.name == "jammed" for event in simulation.events)
    reasons = [f"{e.name}: {e.detail}" for e in simulation.events if e.severity == "error"]
    if simulation.observer.violations:
        reasons.append(f"{len(simulation.observer.violations)} limit violations")
    if not inserted() and not jammed:
        reasons.append(f"not in, and nobody said so: {[round(1e3 * d, 1) for d in depths()]} mm")
    if push > PUSH_N:
        reasons.append(f"pushed with {push:.0f} N")
    seconds = simulation.clock.time_s - simulation.player.start_s
    return Searched(f"seed {seed}", depths(), seconds, push, jammed, reasons)


def _jobs(selection: Selection) -> list[int]:
    load_cell(CELL)  # a mistake in the cell shows here, in one line
    return list(selection.seeds)


SEARCH = Part(_jobs, play, Searching)
