"""Part `beam`: two arms on one payload, under sticks, goals, stops at any instant, and faults.

Drawn are what the payload weighs and where, what the task is told of that, how far the grasps are
from fitting it, the gain of force control there, the motion, and what goes wrong. Judged by the bus
and the physics: no bound of any joint is broken, internal force stays below its bound, also after a
drive fails, a stop stretches the payload by no more than is promised, what was pressed is let go,
and a payload told a little wrong does not sink.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from telerobot.config.load import Cell, altered, load_cell
from telerobot.config.schema.joint_task import JointTaskSection
from telerobot.config.schema.mechanism import PayloadSection
from telerobot.protocols.messages.rig import RigTruth
from telerobot.tools.scripts.script import Script, Step
from telerobot.tools.simulation.simulation import Simulation
from telerobot.tools.soak.segments import Act, Draw, step

from .part import Part, Selection
from .runs import Runs

CELL = "pa10_pair"
END_S = 4.5
"""Length of a run [s], but for the rest at its end."""
SEGMENT_S = (0.5, 1.2)
"""Length of one motion [s]."""
MASS = (2.5, 9.0)
"""[kg]; pads of this stiffness need that much to swing slower than the physics steps."""
TOLD_MASS, TOLD_COM = 0.1, 0.01
"""The task is told a mass wrong by at most this part [1], and a centre by so much an axis [m]."""
SUNK = 2e-3
"""At rest, a payload told so wrong sinks or rises by at most [m], in all."""
RESTED_S, LOOKED_S = 0.5, 4.0
"""After the last stick it has come to rest, and then it is looked at for so long [s]."""
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
AFTER_FAULT = 60.0
"""Internal force that quick stops of all drives may leave, in any direction [N]."""
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
    sunk_m: float = 0.0
    """By how much the payload sank or rose at rest, at most [m]."""
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
            "most_sunk_m": max((run.sunk_m for run in self.runs), default=None),
        }

    def lines(self) -> list[str]:
        """Return the report."""
        internal = max((run.internal_n for run in self.runs), default=0.0)
        stretch = max((run.stop_stretch_m for run in self.runs), default=0.0)
        stops = sum(run.stops for run in self.runs)
        sunk = max((run.sunk_m for run in self.runs), default=0.0)
        return [
            f"{len(self.runs)} runs, {stops} stops; internal force at most {internal:.1f} N, a "
            f"stop stretched the payload by at most {1e3 * stretch:.3f} mm; told wrong by up to "
            f"{TOLD_MASS:.0%}, it sank by at most {1e3 * sunk:.2f} mm at rest",
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
    told = mass * float(draw.uniform(1.0 - TOLD_MASS, 1.0 + TOLD_MASS))
    a, b, c = (np.array(com) + draw.uniform(-TOLD_COM, TOLD_COM, 3)).tolist()
    cell = altered(cell, {"rig.beam": beam, "rig.holes": ()})
    return replace(cell, joint_tasks=(_task(task, told, (a, b, c), draw),))


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
    last_s = max(END_S, *(s.at_s + (s.for_s or 0.0) for s in steps))
    duration_s = END_S if kind else last_s + RESTED_S + LOOKED_S
    script = Script(description=f"beam, seed {seed}", duration_s=duration_s, step=tuple(steps))
    return cell, script, kind


def play(seed: int) -> Carried:
    """Simulate the run of a seed, and judge it."""
    cell, script, fault = generate(load_cell(CELL), seed)
    simulation, name = Simulation(cell, script), f"seed {seed}"
    try:
        result = simulation.run()
    except Exception as error:  # noqa: BLE001  whatever is raised stops an arm: it is counted
        reasons = [f"raised {type(error).__name__}: {error}"]
        return Carried(name, 0.0, 0.0, 0, 0.0, reasons=reasons)
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
    sunk = 0.0 if fault else _sunk(script, simulation)
    if sunk > SUNK:
        told = task.payload.mass if task.payload else 0.0
        weighs = cell.config.rig.beam.mass if cell.config.rig and cell.config.rig.beam else 0.0
        reasons.append(f"told {told:.2f} kg, {weighs:.2f} kg sank by {1e3 * sunk:.2f} mm at rest")
    return Carried(name, internal, stretch, stops, travelled, sunk, reasons)


def _sunk(script: Script, simulation: Simulation) -> float:
    """Return how far the payload sank or rose after the last stick [m]; 0 where it is not held."""
    ends = [s.at_s for s in script.steps]
    rested_s = simulation.player.start_s + max(ends) + RESTED_S
    modes = [s.mode for s in simulation.states][-len(simulation.truths) :]
    heights = [
        truth.beam.pose[2]
        for truth, mode in zip(simulation.truths, modes, strict=True)
        if truth.time_s >= rested_s and mode == "enabled" and truth.beam is not None
    ]
    return max(heights) - min(heights) if heights else 0.0


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
