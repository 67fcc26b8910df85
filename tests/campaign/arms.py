"""Part `arms`: two arms with a task each, side by side, under hostile sticks, goals and jogs.

Both arms are asked for all kinds of motion at the same time, often towards each other. Judged by
the bus and the physics: no bound of any joint is broken, nothing faults or is refused by the gate,
and the commanded arms are never nearer to each other than the cell promises.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from telerobot.config.load import Cell, altered, load_cell
from telerobot.config.schema.section import PoseSection
from telerobot.drivers.rig.physics.world import World
from telerobot.protocols import topics as t
from telerobot.protocols.messages.messages import MechanismCommand, TaskCommand
from telerobot.tools.scripts.script import Script, Step, TopicMessage
from telerobot.tools.simulation.simulation import Simulation
from telerobot.tools.soak.segments import SEGMENTS, Draw, disturbance, master, step

from .part import Part, Selection
from .runs import Runs

CELL = "pa10_two"
END_S = 8.0
"""Length of a run [s]."""
SEGMENT_S = (0.6, 2.0)
"""Length of one kind of act of one operator [s]."""
TOWARDS = 0.35
"""Part of the segments in which an arm is driven at the other one [1]."""
APART = ((0.42, 0.7), 0.4, 0.6)
"""Bases are so far from the middle [m], in front of each other [m], and turned [rad]."""
AT_START = 0.05
"""Arms stand at least so far from each other at start [m]."""
LOOK_EVERY = 2
"""Ticks between two looks at the commanded arms [1]."""
ROUNDING = 2e-4
"""The hull of a link is no exact sum of its capsules [m]."""
NEAR = 0.05
"""Arms that come nearer than this have met each other's barrier [m]."""


@dataclass(frozen=True)
class Encounter:
    """Result of one run."""

    name: str
    least_m: float
    """Least distance of the commanded arms [m]."""
    true_m: float
    """Least distance of the arms [m]."""
    limited: int
    """Ticks in which a barrier or the verified stop acted."""
    ticks: int
    reasons: list[str] = field(default_factory=list)


class Encounters(Runs[Encounter]):
    """Summary of all runs."""

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        return super().figures() | {
            "least_m": min((run.least_m for run in self.runs), default=None),
            "least_true_m": min((run.true_m for run in self.runs), default=None),
            "came_near": sum(run.least_m < NEAR for run in self.runs),
            "limited_ticks": sum(run.limited for run in self.runs),
            "ticks": sum(run.ticks for run in self.runs),
        }

    def lines(self) -> list[str]:
        """Return the report."""
        f = self.figures()
        least = ", ".join(
            f"{words} {1e3 * value:.2f} mm"
            for words, value in (("commanded", f["least_m"]), ("true", f["least_true_m"]))
            if isinstance(value, float)
        )
        return [
            f"{f['runs']} runs; the arms came near in {f['came_near']}; least distance {least}; "
            f"limited in {f['limited_ticks']} of {f['ticks']} ticks",
            *super().lines(),
        ]


def placed(cell: Cell, draw: Draw) -> Cell:
    """Return a cell of two arms with their bases somewhere beside each other."""
    beside, ahead, turned = APART
    while True:
        parts = []
        for part, side in zip(cell.parts, (1.0, -1.0), strict=True):
            xyz = (float(draw.uniform(-ahead, ahead)), side * float(draw.uniform(*beside)), 0.0)
            rpy = (0.0, 0.0, float(draw.uniform(-turned, turned)))
            base = PoseSection(xyz=xyz, rpy=rpy)
            parts.append(altered(part, {"mechanism.T_world_base": base}))
        made = replace(parts[0], others=tuple(parts[1:]))
        if _between(World(made)) > AT_START:
            return made


def _between(world: World) -> float:
    """Return the distance between the arms [m]."""
    distance = world.distances.between_arms()
    if distance is None:
        raise ValueError("one arm alone is at no distance from another")
    return distance


def generate(cell: Cell, seed: int) -> tuple[Cell, Script]:
    """Return the cell and the script of a seed; equal seeds give equal runs."""
    draw = np.random.default_rng([seed, 9])
    cell = placed(cell, draw)
    steps: list[Step] = []
    for part, side in zip(cell.parts, (1.0, -1.0), strict=True):
        at_s = 0.1
        while at_s < END_S - 0.3:
            end_s = min(at_s + float(draw.uniform(*SEGMENT_S)), END_S - 0.1)
            steps += [_for(part, made) for made in _segment(draw, part, side, at_s, end_s)]
            at_s = end_s
    for _ in range(int(draw.integers(0, 4))):
        part = cell.parts[int(draw.integers(len(cell.parts)))]
        at_s = float(draw.uniform(0.5, END_S - 1.0))
        steps += [_for(part, made) for made in disturbance(draw, part, at_s)]
    return cell, Script(description=f"two arms, seed {seed}", duration_s=END_S, step=tuple(steps))


def _segment(draw: Draw, part: Cell, side: float, at_s: float, end_s: float) -> list[Step]:
    if draw.random() < TOWARDS:
        speed = side * float(draw.uniform(-2.0, -0.2))
        twist = [float(draw.uniform(-0.3, 0.3)), speed, float(draw.uniform(-0.3, 0.3)), 0.0, 0.0]
        twist.append(float(draw.uniform(-2.0, 2.0)))
        return [step(at_s, {"cmd/joystick": {"twist": twist, "expressed_in": "world"}})]
    # The generator of a master's pose leads the first task only.
    kinds = [kind for kind in SEGMENTS if kind is not master]
    return kinds[int(draw.integers(len(kinds)))](draw, part, at_s, end_s)


def _for(part: Cell, made: Step) -> Step:
    """Return a step that names the task, or the mechanism, of one part."""
    named = part.task, part.config.mechanism.name
    if made.silence:
        names = [named[key == "cmd/jog"] for key in made.silence]
        streams = tuple(f"{key}:{name}" for key, name in zip(made.silence, names, strict=True))
        return made.model_copy(update={"silence": streams})
    if made.message is None:
        return made
    topic, fields = made.message.topic, dict(made.message.fields)
    if issubclass(topic.message, TaskCommand):
        fields["task"] = named[0]
    elif issubclass(topic.message, MechanismCommand):
        fields["mechanism"] = named[1]
    elif topic is t.RIG_FAULT:
        fields["target"] = f"{part.prefix}{fields['target']}"
    return made.model_copy(update={"message": TopicMessage(topic, fields)})


def play(seed: int) -> Encounter:
    """Simulate the run of a seed, and judge it."""
    cell, script = generate(load_cell(CELL), seed)
    simulation, commanded = Simulation(cell, script), World(cell)
    least: list[float] = []

    def look(s: Simulation) -> None:
        outputs = [unit.output for unit in s.cycle.units.each if unit.output is not None]
        if s.cycle.tick % LOOK_EVERY == 0 and outputs:
            commanded.q[:] = np.concatenate([output.q for output in outputs])
            least.append(_between(commanded))

    simulation.on_tick = look
    name = f"seed {seed}"
    try:
        result = simulation.run(lambda: any(e.name == "fault" for e in simulation.events))
    except Exception as error:  # noqa: BLE001  whatever is raised stops an arm: it is counted
        return Encounter(name, 0.0, 0.0, 0, 0, [f"raised {type(error).__name__}: {error}"])
    reasons = []
    if result.summary["failure"]:
        reasons.append(f"not played: {result.summary['failure']}")
    if simulation.observer.violations:
        worst = simulation.observer.violations[0]
        reasons.append(f"{worst.joint} {worst.kind} {worst.value:.6g} over {worst.bound:.6g}")
    reasons += [
        f"{event.name} at {event.time_s:.2f} s: {event.detail}"
        for event in simulation.events
        if event.severity == "error"
    ]
    promised = cell.config.avoidance.self_clearance
    if min(least) < promised - ROUNDING:
        reasons.append(f"the commanded arms came to {1e3 * min(least):.2f} mm")
    true = [x.between_arms_m for x in result.truths if x.between_arms_m is not None]
    if min(true) <= 0.0:
        reasons.append("the arms touched")
    limited = sum(
        bool(s.limits) or any(task.limits for task in s.tasks.values()) for s in result.states
    )
    return Encounter(name, min(least), min(true), limited, len(result.states), reasons)


def jobs(selection: Selection) -> list[int]:
    """Return every seed."""
    load_cell(CELL)  # a mistake in the cell shows here, in one line
    return list(selection.seeds)


ARMS = Part(jobs, play, Encounters)
