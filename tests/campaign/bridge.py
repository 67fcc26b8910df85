"""Part `bridge`: a rover is driven under random bridges; closed loop, with every ray cast.

Of bridges of random height, width, thickness, skew, offset, distance, at random speeds: the arm
comes to none nearer than the cell promises, no bound of any joint is broken, and every one is
passed, or refused by name. Those that a search of other means (`oracle/duck.py`) calls passable are
to be passed, most of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from laboratory.oracle.duck import FoldingArm, gate_of, passable
from telerobot.config.load import Cell, altered, load_cell
from telerobot.config.schema.rig import RigBridgeSection
from telerobot.server.perception.ahead import REASONS
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from .part import Part, Selection
from .runs import Runs

CELL = "rover_bridge"
BEYOND_M = 1.3
"""The base is through when its middle is so far behind the bridge [m]."""
REFUSED_S = 6.0
"""A refusal that stands for so long is one [s]."""
SPARE_S = 45.0
"""Deciding, folding and waiting may take so much longer than driving through [s]."""
MOST_S = 140.0
"""No run is longer [s]."""
CLEARANCE_M = 0.02
"""Promised by the cell [m]."""
SHARE = 0.8
"""Of the passable ones are to be passed [1]."""


@dataclass(frozen=True)
class Ducked:
    """Result of one run."""

    name: str
    passed: bool
    refused: str
    """Why it was refused; empty where it was not."""
    could: bool
    """A search of other means found a posture that passes."""
    clearance_m: float
    reasons: list[str] = field(default_factory=list)


class Bridges(Runs[Ducked]):
    """Summary of all runs."""

    @property
    def kept(self) -> bool:
        """True when no run broke a promise, and most of what is passable was passed."""
        return super().kept and self._share >= SHARE

    @property
    def _share(self) -> float:
        could = [run for run in self.runs if run.could]
        return sum(run.passed for run in could) / len(could) if could else 1.0

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        refused: dict[str, int] = {}
        for run in self.runs:
            if run.refused:
                refused[run.refused] = refused.get(run.refused, 0) + 1
        return super().figures() | {
            "passed": sum(run.passed for run in self.runs),
            "refused": refused,
            "passable": sum(run.could for run in self.runs),
            "passed_of_passable": self._share,
            "least_clearance_m": min((run.clearance_m for run in self.runs), default=None),
        }

    def lines(self) -> list[str]:
        """Return the report."""
        f = self.figures()
        least = f["least_clearance_m"]
        shown = f"{1e3 * least:.0f} mm" if isinstance(least, float) else "-"
        return [
            f"{f['runs']} bridges: {f['passed']} passed, refused {f['refused']}; "
            f"{f['passable']} passable, {100 * self._share:.0f} % of them passed; least distance "
            f"{shown}",
            *super().lines(),
        ]


def bridge(seed: int) -> tuple[RigBridgeSection, float]:
    """Return the bridge of a seed, and the speed of the base [m/s]."""
    draw = np.random.default_rng([seed, 12])
    made = RigBridgeSection(
        height=round(float(draw.uniform(0.90, 1.30)), 3),
        width=round(float(draw.uniform(0.7, 1.7)), 3),
        thickness=round(float(draw.uniform(0.05, 0.4)), 3),
        side=round(float(draw.uniform(0.08, 0.2)), 3),
        skew=round(float(draw.uniform(-0.3, 0.3)), 3),
        offset=round(float(draw.uniform(-0.15, 0.15)), 3),
        distance=round(float(draw.uniform(1.8, 3.0)), 3),
    )
    return made, round(float(draw.uniform(0.05, 0.3)), 3)


def oracle(cell: Cell, made: RigBridgeSection) -> bool:
    """Return whether the search of other means finds a posture."""
    foot = 0.0 if cell.config.contour is None else cell.config.contour.foot[2]
    arm = FoldingArm(0.300, 0.328, 0.276, 0.2195, (3.0, 1.95, 2.8, 2.0944), 0.06, 0.30)
    gate = gate_of(
        made.height - foot, made.width, made.thickness, made.side, made.skew, made.offset
    )
    return passable(arm, gate, CLEARANCE_M)


def play(seed: int) -> Ducked:
    """Run a seed and judge it."""
    made, speed = bridge(seed)
    cell = load_cell(CELL)
    config = cell.config
    if config.rig is None:
        raise ValueError(f"cell {config.name} has no [rig]")
    cell = altered(cell, {"rig.bridge": made, "rig.seed": seed})
    most_s = min(MOST_S, (made.distance + BEYOND_M) / speed + SPARE_S)
    steps: list[dict[str, object]] = [{"at_s": 0.3, "cmd/drive": {"rates": [speed, 0.0]}}]
    run = Simulation(cell, Script.model_validate({"duration_s": most_s, "step": steps}))
    since: dict[str, float] = {}

    def over() -> bool:
        if not run.truths:
            return False
        newest = None if run.scans is None else run.scans.newest
        reason = "" if newest is None or newest.answer is None else newest.answer.reason
        if not reason and run.states:
            reason = next((name for name in run.states[-1].limits if name in REASONS), "")
        if reason:
            since.setdefault(reason, run.clock.time_s)
        else:
            since.clear()
        stands = any(run.clock.time_s - then > REFUSED_S for then in since.values())
        return stands or run.truths[-1].frames["base"][0] > made.distance + BEYOND_M

    result = run.run(over)
    s, reasons = result.summary, []
    passed = bool(result.truths) and result.truths[-1].frames["base"][0] > made.distance + BEYOND_M
    refused = next(iter(since), "")
    clearance = min((t.clearance_m for t in result.truths if t.clearance_m is not None), default=1)
    if s["failure"] is not None:
        reasons.append(str(s["failure"]))
    if s["limit_violations"]:
        reasons.append(f"{s['limit_violations']} limit violations")
    if s["mode"] == "fault":
        reasons.append("ended in FAULT")
    touched = max(
        (float(arm.contact_peak) for t in result.truths for arm in t.arms.values()), default=0
    )
    if clearance < CLEARANCE_M:
        promised = f"{1e3 * CLEARANCE_M:g} mm are promised"
        reasons.append(f"came to the bridge by {1e3 * clearance:.1f} mm, {promised}")
    if touched > 0.0:
        reasons.append(f"touched the bridge with {touched:.0f} N")
    if not passed and not refused:
        reasons.append("stuck: neither passed nor refused")
    words = (
        f"{seed}: {made.height:g} high, {made.width:g} wide, {made.thickness:g} thick, skew "
        f"{made.skew:g}, offset {made.offset:g}, at {made.distance:g} m, {speed:g} m/s"
    )
    return Ducked(words, passed, refused, oracle(cell, made), float(clearance), reasons)


def jobs(selection: Selection) -> list[int]:
    """List the seeds."""
    return list(selection.seeds)


def report(results: Sequence[Ducked]) -> Bridges:
    """Summarise the runs."""
    return Bridges(list(results))


BRIDGE = Part(jobs, play, report)
