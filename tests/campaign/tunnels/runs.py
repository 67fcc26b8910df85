"""Part `tunnel`: snakes in random tunnels, planar and in space, driven to and fro and stopped.

A judge of other means (`oracle/passable.py`) accepts the tunnels. Judged by bus and physics: no
wall is touched, and no bound of any joint is broken.
"""

from dataclasses import dataclass, field

import numpy as np
from telerobot.config.errors import ConfigError
from telerobot.config.load import load_cell
from telerobot.tools.simulation.simulation import Simulation

from ..part import Part, Selection
from ..runs import Runs
from .draw import generate

CELLS = ("snake", "snake_space")


@dataclass(frozen=True)
class TunnelRun:
    """Result of one run."""

    name: str
    clearance_m: float
    """Least distance from a wall [m]."""
    way_m: float
    """How far the tip has gone in all [m]."""
    slowed: int
    """Ticks in which anything limited the arm."""
    ticks: int
    reasons: list[str] = field(default_factory=list)


class Passages(Runs[TunnelRun]):
    """Summary of all runs."""

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        return super().figures() | {
            "least_clearance_m": min((run.clearance_m for run in self.runs), default=None),
            "way_m": sum(run.way_m for run in self.runs),
            "limited_ticks": sum(run.slowed for run in self.runs),
            "ticks": sum(run.ticks for run in self.runs),
        }

    def lines(self) -> list[str]:
        """Return the report."""
        f = self.figures()
        least = f["least_clearance_m"]
        shown = f"{1e3 * least:.1f} mm" if isinstance(least, float) else "-"
        return [
            f"{f['runs']} runs, {f['way_m']:.1f} m in tunnels; least distance from a wall {shown}; "
            f"limited in {f['limited_ticks']} of {f['ticks']} ticks",
            *super().lines(),
        ]


def play(seed: int) -> TunnelRun:
    """Run a seed and judge it."""
    name = CELLS[seed % len(CELLS)]
    try:
        cell, script = generate(load_cell(name), seed)
    except ConfigError as error:
        return TunnelRun(f"{name} {seed}", 1.0, 0.0, 0, 0, [f"refused: {error}"])
    faulty = any(
        step.message is not None and step.message.topic.key == "rig/fault" for step in script.steps
    )
    result = Simulation(cell, script).run()
    s, reasons = result.summary, []
    if s["failure"] is not None:
        reasons.append(str(s["failure"]))
    if s["limit_violations"]:
        reasons.append(f"{s['limit_violations']} limit violations")
    if s["mode"] == "fault" and not faulty:
        reasons.append("ended in FAULT")
    clearance = min((t.clearance_m for t in result.truths if t.clearance_m is not None), default=1)
    force = s["wall_force_n"]
    if force or clearance <= 0.0:
        reasons.append(f"touched a wall: {force} N, {1e3 * clearance:.1f} mm")
    depths = [state.insertion["depth"] for state in result.states if state.insertion]
    if any(state.mode == "enabled" and not state.insertion for state in result.states):
        reasons.append("left its curve")
    return TunnelRun(
        f"{name} {seed}",
        clearance,
        float(np.abs(np.diff(depths)).sum()),
        sum(bool(state.limits) for state in result.states),
        len(result.states),
        reasons,
    )


def jobs(selection: Selection) -> list[int]:
    """List the seeds."""
    return list(selection.seeds)


TUNNEL = Part(jobs=jobs, play=play, report=Passages)
