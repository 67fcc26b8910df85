"""Random scenes: an arm among obstacles, some of which move, under hostile sticks, from a seed.

Written beforehand in the label: a scene is *keepable* when the arm starts clear of everything, by
the physics' own geometry, and nothing moves. There the promised clearance must hold to the
millimetre. Where the arm starts inside, it must not get deeper (as
the daemon sees it, with capsules around the links); where something moves (`movers.py`), it is the
arm's own motion that must not close what is below the promise, and what comes slowly and is told of
is given way to: hits are counted.
"""

import math
from dataclasses import dataclass

import numpy as np
from laboratory.oracle.arm import OracleArm
from numpy.typing import NDArray
from telerobot.config.drives import joint_bounds
from telerobot.config.load import Cell, altered
from telerobot.config.schema.surroundings import (
    AvoidanceSection,
    LinkCapsuleSection,
    ObstacleSection,
    Stale,
)
from telerobot.drivers.rig.physics.world import World
from telerobot.server.control.proximity.capsules import Capsules
from telerobot.server.control.proximity.pairs import PairSearch
from telerobot.server.events import Events
from telerobot.server.perception.obstacle_map import ObstacleMap
from telerobot.tools.scripts.script import Script, Step
from telerobot.tools.soak.segments import step

from .movers import PROMISE, RandomMover, mover

SAG = 0.001
"""Sag of the joints when the drives begin to hold them [m]."""
COUNT = (4, 16)
"""Fewest and most obstacles [1]."""
HOSTILE_S = 3.5
"""Length of the hostile part [s]."""
WITHIN_S = 30.0
"""Time limit of the retreat [s]."""
KINDS = ("free", "near", "inside", "moving")
"""Kinds of scenes; the seed chooses."""
MOVERS = (1, 3)
"""Fewest and most things that move, where any do [1]."""
UNFOLDED = 0.03
"""Least distance between links at the start [m]."""
TRIES = 400
"""Postures that are tried for a start [1]."""

Draw = np.random.Generator


@dataclass(frozen=True)
class Clutter:
    """One scene: the cell, its script, and what can be promised there."""

    seed: int
    kind: str
    cell: Cell
    script: Script
    movers: tuple[RandomMover, ...]
    start_m: float
    """Clearance at the start, of the physics [m]."""
    modelled_m: float
    """The same of the daemon's capsules, which are around the arm [m]."""

    @property
    def keepable(self) -> bool:
        """True where the promise holds throughout, whatever the stick does."""
        return self.start_m >= PROMISE + SAG and self.kind != "moving"


def make_clutter(base: Cell, seed: int) -> Clutter:
    """Return the scene of a seed; all that is random is drawn here."""
    draw = np.random.default_rng([seed, 2])
    kind = KINDS[seed % len(KINDS)]
    lowest, highest = {
        "free": (0.06, 1.0), "near": (PROMISE, 0.05), "inside": (0.002, PROMISE - 0.002),
        "moving": (0.05, 1.0),
    }[kind]  # fmt: skip
    if kind == "moving" and seed // len(KINDS) % 2:
        lowest, highest = 0.002, 0.05
    while True:
        cell = _furnished(base, draw, kind)
        found = _start(cell, draw, lowest, highest)
        if found is not None:
            cell, start, modelled = found
            movers = tuple(
                mover(draw, o, HOSTILE_S) for o in cell.config.obstacles if o.max_speed > 0.0
            )
            return Clutter(seed, kind, cell, _script(draw), movers, start, modelled)


def _furnished(base: Cell, draw: Draw, kind: str) -> Cell:
    rig = base.config.rig
    if rig is None:
        raise ValueError(f"cell {base.config.name} has no [rig]: nothing to simulate")
    obstacles = [_obstacle(draw, i) for i in range(int(draw.integers(*COUNT, endpoint=True)))]
    if kind == "moving":
        for i in range(min(int(draw.integers(*MOVERS, endpoint=True)), len(obstacles))):
            obstacles[i] = _mover(draw, i)
    mrf = base.config.mechanism.T_wrist_mrf.xyz
    tip = LinkCapsuleSection(
        link=base.config.mechanism.tip_link, start=mrf, end=mrf, radius=max(rig.tool_radius, 0.005)
    )
    avoidance = AvoidanceSection(enabled=True, clearance=PROMISE, capsules=(tip,))
    return altered(
        base,
        {
            "obstacles": tuple(obstacles),
            "avoidance": avoidance,
            "rig.wall": None,
            "rig.boxes": (),
            "rig.tags": (),
            "cameras": (),
        },
    )


def _place(draw: Draw) -> tuple[float, float, float]:
    radius, angle = draw.uniform(0.3, 1.0), draw.uniform(-math.pi, math.pi)
    return (
        float(radius * math.cos(angle)),
        float(radius * math.sin(angle)),
        float(draw.uniform(0.05, 1.3)),
    )


def _obstacle(draw: Draw, i: int) -> ObstacleSection:
    name, xyz = f"thing{i}", _place(draw)
    match int(draw.integers(4)):
        case 0:
            return ObstacleSection(name=name, shape="point", xyz=xyz)
        case 1:
            return ObstacleSection(
                name=name, shape="sphere", xyz=xyz, radius=float(draw.uniform(0.02, 0.12))
            )
        case 2:
            x, y, z = (np.array(xyz) + draw.uniform(-0.4, 0.4, 3)).tolist()
            radius = float(draw.uniform(0.01, 0.07))
            return ObstacleSection(name=name, shape="capsule", xyz=xyz, to=(x, y, z), radius=radius)
        case _:
            a, b, c = draw.uniform(0.02, 0.2, 3).tolist()
            r, p, y = draw.uniform(-1.5, 1.5, 3).tolist()
            return ObstacleSection(
                name=name, shape="box", xyz=xyz, half_size=(a, b, c), rpy=(r, p, y)
            )


def _mover(draw: Draw, i: int) -> ObstacleSection:
    """Return one that moves: its velocity may jump, or its acceleration is bounded and told."""
    bounded = float(draw.uniform(0.5, 5.0)) if draw.random() < 0.5 else None
    stale: Stale = "stop" if draw.random() < 0.5 else "grow"
    return ObstacleSection(
        name=f"mover{i}", shape="sphere", xyz=_place(draw), radius=float(draw.uniform(0.04, 0.12)),
        max_speed=float(draw.uniform(0.05, 0.5)), max_acceleration=bounded, stale=stale,
        timeout_s=0.3,
    )  # fmt: skip


def _start(
    cell: Cell, draw: Draw, lowest: float, highest: float
) -> tuple[Cell, float, float] | None:
    """Return the cell with a start whose clearance is between two bounds, if one is found."""
    mechanism = cell.config.mechanism
    low, high = joint_bounds(cell.robot.joints, mechanism.drives)
    world, own = World(cell), OracleArm.of(cell)
    search = PairSearch(cell, Capsules(cell))
    ready = np.array(mechanism.postures["ready"])
    for _ in range(TRIES):
        q = np.clip(ready + draw.uniform(-1.2, 1.2, len(ready)), low, high)
        world.q[:] = q
        found = world.distances.clearance()
        if found is not None and lowest <= found <= highest and own.clearance(q)[1] > UNFOLDED:
            postures = {**mechanism.postures, "start": tuple(q.tolist())}
            return (
                altered(cell, {"mechanism.postures": postures}),
                found,
                _modelled(search, cell, q),
            )
    return None


def _modelled(search: PairSearch, cell: Cell, q: NDArray[np.float64]) -> float:
    scene = ObstacleMap.from_cell(cell, Events()).scene(0)
    capsules = search.capsules
    near = search.find(capsules.place(q[None]), scene, np.full(len(capsules.each), 1.0), 0.0)
    return float(near.gap[near.obstacle >= 0].min(initial=1.0))


def _script(draw: Draw) -> Script:
    """Return the hostile stick; movers and retreat depend on what happens: the judge plays them."""
    steps: list[Step] = []
    style = int(draw.integers(3))
    at_s = 0.05
    twist = _twist(draw)
    while at_s < HOSTILE_S:
        steps.append(step(at_s, {"cmd/joystick": {"twist": twist, "expressed_in": "world"}}))
        if style == 0:
            twist, at_s = _twist(draw), at_s + float(draw.uniform(0.8, 1.6))
        elif style == 1:
            twist, at_s = [-x for x in twist], at_s + float(draw.uniform(0.1, 0.5))
            if draw.random() < 0.4:
                twist = _twist(draw)
        else:
            twist, at_s = _twist(draw), at_s + float(draw.uniform(0.03, 0.2))
    steps.append(step(HOSTILE_S, {"cmd/joystick": {"twist": (0.0,) * 6}}))
    return Script(duration_s=HOSTILE_S + WITHIN_S, step=tuple(steps))


def _twist(draw: Draw) -> list[float]:
    linear, angular = draw.normal(size=3), draw.normal(size=3)
    linear *= draw.uniform(0.3, 1.5) / np.linalg.norm(linear)
    angular *= draw.uniform(0.0, 4.0) / np.linalg.norm(angular)
    return [*linear.tolist(), *angular.tolist()]
