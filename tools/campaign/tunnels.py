"""Part `tunnel`: snakes in random tunnels, planar and in space, driven to and fro and stopped.

A judge of other means (`oracle/passable.py`) accepts the tunnels. Judged by bus and physics: no
wall is touched, and no bound of any joint is broken.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from ...config.load import Cell, load_cell
from ...config.schema.backbone import Backbone as Section
from ...config.schema.backbone import Segment
from ...server.control.mechanism.backbone.insertion import Backbone
from ..oracle.passable import passable
from ..scripts.script import Script
from ..simulation.simulation import Simulation
from .part import Part, Selection
from .runs import Runs
from .steps import Draw

CELLS = ("snake", "snake_space")
END_S = 5.0
"""Length of a run [s]."""
ACT_S = (0.3, 1.2)
"""Length of one act of the operator [s]."""
LINK, JOINTS, MOST, THICKNESS = 0.05, 30, 1.04, 0.01
"""Length of a link [m], joints [1], their range [rad] and the walls' thickness [m]."""
RADIUS = ((0.09, 0.25), (0.19, 0.40))
"""Of bends, planar and in space [m]."""


@dataclass(frozen=True)
class Passage:
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


class Passages(Runs[Passage]):
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


def tunnel(section: Section, draw: Draw) -> Section:
    """Return a section with a tunnel that the arm can go through."""
    planar, length = section.axes == "planar", LINK * JOINTS
    while True:
        pieces: list[Segment] = []
        while sum(piece.length for piece in pieces) < length - section.least + 0.1:
            radius = float(draw.uniform(*RADIUS[not planar]))
            angle = float(draw.uniform(0.3, 3.0 if planar else 1.6)) * float(draw.choice((-1, 1)))
            climbs = not planar and draw.random() < 0.5
            turn = {"climb": angle} if climbs else {"bend": angle}
            pieces.append(Segment(length=radius * abs(angle), **turn))
            if draw.random() < 0.3:
                pieces.append(Segment(length=float(draw.uniform(0.05, 0.2))))
        made = section.model_copy(update={"tunnel": tuple(pieces)})
        if passable(made, LINK, length, MOST, THICKNESS, np.zeros(3)):
            return made


def generate(cell: Cell, seed: int) -> tuple[Cell, Script]:
    """Return the cell and the script of a seed; equal seeds give equal runs."""
    draw = np.random.default_rng([seed, 11])
    mechanism = cell.config.mechanism
    section = mechanism.backbone
    if section is None:
        raise ValueError(f"cell {cell.config.name} has no backbone")
    section = tunnel(section, draw)
    cell = _with(cell, section, mechanism.postures["start"])
    backbone = Backbone.from_cell(cell)
    if backbone is None:
        raise ValueError(f"cell {cell.config.name} has no backbone")
    place = int(draw.integers(len(backbone.lengths)))
    cell = _with(cell, section, tuple(backbone.fits[place].tolist()))
    deepest = backbone.chain.length - section.least
    steps: list[dict[str, object]] = []
    at_s = 0.2
    while at_s < END_S - 0.3:
        kind = draw.choice(("drive", "drive", "insert", "stick", "hold", "slow"))
        speed = float(draw.uniform(-section.speed, section.speed))
        if kind == "drive":
            steps.append({"at_s": at_s, "cmd/drive": {"rates": [speed]}})
        elif kind == "insert":
            steps.append({"at_s": at_s, "cmd/insert": {"depth": float(draw.uniform(0, deepest))}})
        elif kind == "stick":
            twist = [*draw.uniform(-0.15, 0.15, 3).tolist(), *draw.uniform(-0.5, 0.5, 3).tolist()]
            stick = {"twist": twist, "expressed_in": "mrf"}
            steps.append({"at_s": at_s, "for_s": 0.5, "cmd/joystick": stick})
        elif kind == "slow":
            factor = float(draw.uniform(0.2, 1.0))
            steps.append({"at_s": at_s, "operator/speed": {"factor": factor}})
        else:
            steps.append({"at_s": at_s, "operator/mode": {"action": "hold"}})
            steps.append({"at_s": at_s + 0.5, "operator/mode": {"action": "enable"}})
            at_s += 0.5
        at_s += float(draw.uniform(*ACT_S))
    return cell, Script.model_validate({"duration_s": END_S, "step": steps})


def _with(cell: Cell, section: Section, q: tuple[float, ...]) -> Cell:
    postures = {"start": q, "ready": q}
    mechanism = cell.config.mechanism.model_copy(update={"backbone": section, "postures": postures})
    return replace(cell, config=cell.config.model_copy(update={"mechanism": mechanism}))


def play(seed: int) -> Passage:
    """Run a seed and judge it."""
    name = CELLS[seed % len(CELLS)]
    cell, script = generate(load_cell(name), seed)
    result = Simulation(cell, script).run()
    s, reasons = result.summary, []
    if s["failure"] is not None:
        reasons.append(str(s["failure"]))
    if s["limit_violations"]:
        reasons.append(f"{s['limit_violations']} limit violations")
    if s["mode"] == "fault":
        reasons.append("ended in FAULT")
    clearance = min((t.clearance_m for t in result.truths if t.clearance_m is not None), default=1)
    force = s["wall_force_n"]
    if force or clearance <= 0.0:
        reasons.append(f"touched a wall: {force} N, {1e3 * clearance:.1f} mm")
    depths = [state.insertion["depth"] for state in result.states if state.insertion]
    if any(state.mode == "enabled" and not state.insertion for state in result.states):
        reasons.append("left its curve")
    return Passage(
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
