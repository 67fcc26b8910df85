"""Part `beam`: two arms on one payload, under sticks, goals, stops at any instant, and faults.

Drawn are what the payload weighs and where, how far the grasps are from fitting it, the gain of
force control there, where on it the MRF is, the motion, and what goes wrong. Judged by the bus and
the physics: no bound of any joint is broken, internal force stays below its bound unless a drive
fails, a stop stretches the payload by no more than is promised, and what was pressed is let go.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...config.load import Cell, load_cell
from ...config.schema.joint_task import JointTaskSection
from ...config.schema.mechanism.mechanism import PayloadSection
from ...protocols.messages.rig import RigTruth
from ..scripts.script import Script
from ..scripts.step import Step
from ..simulation.simulation import Simulation
from .part import Part, Selection
from .runs import Runs
from .steps import Act, Draw, step

CELL = "pa10_pair"
END_S = 4.5
"""Length of a run [s]."""
SEGMENT_S = (0.5, 1.2)
"""Length of one motion [s]."""
MASS = (2.5, 9.0)
"""[kg]; pads of this stiffness need that much to swing slower than the physics steps."""
MISFIT = 1.4e-3
"""Grasps are from fitting the payload by at most [m]."""
PERIOD_S = 0.01
"""Of the cell [s]."""
LOOP_GAIN = (0.08, 0.25)
"""K_F k T [1]."""
FAULTY = 0.4
"""Part of the runs in which something fails [1]."""
FAULTS: tuple[Act, ...] = (
    {"rig/fault": {"kind": "silence", "target": "left.force_torque"}},
    {"rig/fault": {"kind": "silence", "target": "right.force_torque"}},
    {"rig/fault": {"kind": "fault", "target": "left.e1"}},
    {"rig/fault": {"kind": "fault", "target": "right.s2"}},
    {"rig/fault": {"kind": "unplug", "target": "right"}},
    {"operator/protective_stop": {}},
)
DRIVES_FAIL = ("fault", "unplug")
"""Kinds of faults that quick-stop the drives, each on its own ramp."""
AFTER_FAULT = 200.0
"""Internal force that quick stops of all drives may leave [N]."""
MEASURED = 1.5e-4
"""Stretch of the true payload beside what is commanded, by drives and what was pressed [m]."""
LET_GO = 15.0
"""Internal force at the end, where nothing failed [N]."""


@dataclass(frozen=True)
class Carried:
    """Result of one run."""

    name: str
    internal_n: float
    """Greatest internal force after the first half second [N]."""
    stop_stretch_m: float
    """By how much a stop stretched the payload, at most [m]."""
    stops: int
    travelled_m: float
    reasons: list[str] = field(default_factory=list)


class Carrying(Runs[Carried]):
    """Summary of all runs."""

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        return super().figures() | {
            "most_internal_n": max((run.internal_n for run in self.runs), default=None),
            "most_stop_stretch_m": max((run.stop_stretch_m for run in self.runs), default=None),
            "stops": sum(run.stops for run in self.runs),
            "travelled_m": math.fsum(run.travelled_m for run in self.runs),
        }

    def lines(self) -> list[str]:
        """Return the report."""
        internal = max((run.internal_n for run in self.runs), default=0.0)
        stretch = max((run.stop_stretch_m for run in self.runs), default=0.0)
        stops = sum(run.stops for run in self.runs)
        return [
            f"{len(self.runs)} runs, {stops} stops; internal force at most {internal:.1f} N, a "
            f"stop stretched the payload by at most {1e3 * stretch:.3f} mm",
            *super().lines(),
        ]


def drawn(cell: Cell, draw: Draw) -> Cell:
    """Return the cell with another payload, other grasps, gains and place of the MRF."""
    task, rig = cell.joint_tasks[0], cell.config.rig
    if rig is None or rig.beam is None:
        raise ValueError(f"cell {cell.config.name} has no [rig.beam]")
    mass = float(draw.uniform(*MASS))
    com = (0.0, float(draw.uniform(-0.15, 0.15)), float(draw.uniform(-0.03, 0.03)))
    misfit = draw.normal(size=3)
    misfit *= float(draw.uniform(0.0, MISFIT)) / np.linalg.norm(misfit)
    x, y, z = misfit.tolist()
    beam = rig.beam.model_copy(
        update={"mass": mass, "com": com, "misfit": ((0.0, 0.0, 0.0), (x, y, z)), "pegs": ()}
    )
    config = cell.config.model_copy(
        update={"rig": rig.model_copy(update={"beam": beam, "holes": ()})}
    )
    return replace(cell, config=config, joint_tasks=(_task(task, mass, com, draw),))


def _task(
    task: JointTaskSection, mass: float, com: tuple[float, float, float], draw: Draw
) -> JointTaskSection:
    loop = float(draw.uniform(*LOOP_GAIN))
    linear, turning = (
        loop / (PERIOD_S * stiffness)
        for stiffness in (task.internal_stiffness, task.internal_stiffness_rotation)
    )
    gain = (linear,) * 3 + (turning,) * 3
    force = task.sources.force.model_copy(update={"gain": gain})
    update = {
        "payload": PayloadSection(mass=mass, com=com),
        "sources": task.sources.model_copy(update={"force": force}),
    }
    return task.model_copy(update=update)


def generate(cell: Cell, seed: int) -> tuple[Cell, Script, str]:
    """Return the cell and the script of a seed, and the kind of its fault; "" for none."""
    draw = np.random.default_rng([seed, 11])
    cell = drawn(cell, draw)
    steps: list[Step] = []
    at_s = 0.6
    while at_s < END_S - 1.4:
        end_s = at_s + float(draw.uniform(*SEGMENT_S))
        v, w = draw.normal(size=3), draw.normal(size=3)
        v *= float(draw.uniform(0.0, 0.2)) / np.linalg.norm(v)
        w *= float(draw.uniform(0.0, 0.3)) / np.linalg.norm(w)
        if at_s < 1.0:
            v[2] = abs(v[2])  # up first: there is a floor
        twist = [*v.tolist(), *w.tolist()]
        act = {"for_s": end_s - at_s, "cmd/joystick": {"twist": twist, "expressed_in": "world"}}
        steps.append(step(at_s, act))
        at_s = end_s
    held_s = float(draw.uniform(0.8, END_S - 2.0))
    steps.append(step(held_s, {"operator/mode": {"action": "hold"}}))
    steps.append(step(held_s + 0.6, {"operator/mode": {"action": "resume"}}))
    kind = ""
    if draw.random() < FAULTY:
        wrong = FAULTS[int(draw.integers(len(FAULTS)))]
        steps.append(step(float(draw.uniform(0.8, END_S - 1.0)), wrong))
        kind = str(wrong.get("rig/fault", {}).get("kind", "stop"))
    script = Script(description=f"beam, seed {seed}", duration_s=END_S, step=tuple(steps))
    return cell, script, kind


def play(seed: int) -> Carried:
    """Simulate the run of a seed, and judge it."""
    cell, script, fault = generate(load_cell(CELL), seed)
    simulation, name = Simulation(cell, script), f"seed {seed}"
    try:
        result = simulation.run()
    except Exception as error:  # noqa: BLE001  whatever is raised stops an arm: it is counted
        return Carried(name, 0.0, 0.0, 0, 0.0, [f"raised {type(error).__name__}: {error}"])
    task, failed = cell.joint_tasks[0], fault in DRIVES_FAIL
    beams = [truth.beam for truth in result.truths if truth.beam is not None]
    settled = round(0.5 / cell.config.timing.period_s)
    internal = max(beam.internal_force for beam in beams[settled:])
    stretch, stops = _stop_stretch(result.truths, [s.mode for s in result.states])
    reasons = []
    if simulation.observer.violations:
        worst = simulation.observer.violations[0]
        reasons.append(f"{worst.joint} {worst.kind} {worst.value:.6g} over {worst.bound:.6g}")
    reasons += [
        f"{event.name} at {event.time_s:.2f} s: {event.detail}"
        for event in simulation.events
        if event.severity == "error" and not (failed and event.name == "fault")
    ]
    if internal > (AFTER_FAULT if failed else task.most_internal):
        reasons.append(f"internal force {internal:.1f} N")
    if not failed and stretch > task.stretch + MEASURED:
        reasons.append(f"a stop stretched the payload by {1e3 * stretch:.3f} mm")
    if not fault and beams[-1].internal_force > LET_GO:
        reasons.append(f"internal force at the end {beams[-1].internal_force:.1f} N")
    places = np.array([beam.pose[:3] for beam in beams])
    travelled = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    if not fault and travelled < 0.01:
        reasons.append("the payload did not move")
    return Carried(name, internal, stretch, stops, travelled, reasons)


def _stop_stretch(truths: Sequence[RigTruth], modes: Sequence[str]) -> tuple[float, int]:
    """Return by how much stops stretched the payload, at most [m], and how many there were."""
    most, stops, began = 0.0, 0, None
    for truth, mode in zip(truths, modes[-len(truths) :], strict=True):
        if truth.beam is None or mode != "stopping":
            began = None
            continue
        if began is None:
            began, stops = truth.beam.stretch, stops + 1
        most = max(most, truth.beam.stretch - began)
    return most, stops


def jobs(selection: Selection) -> list[int]:
    """Return every seed."""
    load_cell(CELL)  # a mistake in the cell shows here, in one line
    return list(selection.seeds)


BEAM = Part(jobs, play, Carrying)
