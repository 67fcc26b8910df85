"""Clearances: their barriers, and what a stop would leave of them.

A promise is kept by the arm itself, not by the command that it follows: what the joints lag behind
the command, times how much that matters for the gap, is taken off every gap (the tracking tube).
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ....config.load import Cell
from ..compiled import VECTOR, compiled
from ..frames import Array
from ..scene import Scene
from ..tree import Body
from .approach import Braking
from .chain import Flags
from .distance import Index
from .links import Links
from .neighbours import Around, Neighbours
from .ways import carried, doubtful, travel

SAMPLE_S = 0.025
"""A stop is looked at this often at least [s] …"""
SAMPLE_M = 0.03
"""… and after so much motion of any link [m]."""
SAMPLES = 16
"""Most looks at one stop [1]."""
BETWEEN = 0.4
"""Part of the margin that stops keep: for what a curved path dips between two looks, beside the
chord's, and for what loaded joints give way by, which no encoder sees [1]."""
SLACK = 1e-4
"""A gap that is below its bound may shrink by so much in all, not more [m]."""
CREEP = 2e-5
"""The same of a gap to something that comes nearer, in one period [m]."""
COMES = 1e-3
"""What comes no quicker than this stands [m/s]."""
LATENCY = 3.0
"""Periods until the arm is where the command is now [1]."""
HORIZON_S = 0.4
"""What moves is looked at when it can be near within this time [s]."""
SHOWN = 4
"""So many of the nearest pairs are told [1]."""

Postures = Callable[[Array], Array]
"""Joint angles (s, n) at times (s,) along a stop."""

Base = Body | None
"""A Base that moves, and how; None for one that stands where the cell says."""

Levels = dict[tuple[int, int, str], float]
"""Best gap so far of each pair that is inside its bound, by capsule, other capsule or −1, name."""


class Gap(NamedTuple):
    """One pair, as it is told to operators."""

    link: str
    other: str
    gap: float
    """Distance of the surfaces, of the commanded arm [m]."""
    active: bool
    """True while its barrier bends or slows the motion."""


class Sight(NamedTuple):
    """What clearances are at one posture."""

    scene: Scene | None
    base: Base
    lever: Array
    """Distances of capsules from the joints' axes (c, n) [m]."""
    room: Array
    """How far each capsule may come before other pairs matter (c,) [m]."""
    near: Neighbours
    tube: Array
    """What tracking may take off each gap (k,) [m]."""
    floor: Array
    """What each gap (k,) must keep where it is below its bound already [m]."""
    levels: Levels


class Clearance:
    """The clearances of one cell."""

    def __init__(self, cell: Cell, acceleration: Array, jerk: Array) -> None:
        self.links = Links(cell)
        self.around = Around(cell, self.links)
        self._period_s = cell.config.timing.period_s
        self._margin = cell.config.avoidance.margin
        self._between = BETWEEN * self._margin
        self.braking = Braking(acceleration, jerk, self._period_s)

    def look(
        self, q: Array, fastest: Array, error: Array, scene: Scene | None, factor: float,
        levels: Levels, base: Base = None,
    ) -> Sight:  # fmt: skip
        """Return what is near at q (n,) [rad] for joints that go at most `fastest` (n,) [rad/s].

        `error` (n,) [rad] is what the joints are behind the command; `factor` the reduced-speed
        setting; `levels` those of the sight before; `base` where a Base that moves is.
        """
        placed = self.links.place(q[None], None if base is None else base.T)
        lever = self.links.levers(placed)
        room = travel(lever, self.braking.stop_way(fastest, factor)) + 0.03 + self._margin
        near = self.around.look(placed, scene, room, HORIZON_S)
        if base is not None:
            near = _on_moving_base(near, base)
        tube = np.abs(near.rows) @ np.abs(error)
        floor, levels = self._floors(near, tube, scene, levels)
        return Sight(scene, base, lever, room, near, tube, floor, levels)

    def room(self, sight: Sight) -> Array:
        """Return how far each gap may close (k,) [m]; negative beyond its barrier."""
        near = sight.near
        room = near.gap - near.promise - self._margin - sight.tube
        if sight.scene is not None and sight.scene.moves:
            ahead = np.array([LATENCY * self._period_s])
            room = room - sight.scene.growth(near.obstacle, ahead)[0]
        if sight.base is not None:
            room = room - near.carried * LATENCY * self._period_s
        return room

    def shortfall(
        self, sight: Sight, duration_s: float, farthest: Array, postures: Postures
    ) -> float:
        """Return by how much the worst gap falls short along a stop [m]; 0 where all are kept.

        `farthest` (n,) [rad] bounds how far joints go from where they are; `postures` gives them.
        """
        way = travel(sight.lever, farthest)
        if (way > sight.room).any():
            sight = self._farther(sight, way)
        near, scene = sight.near, sight.scene
        needed = near.promise + sight.tube + self._between
        end_s = duration_s + (1.0 + LATENCY) * self._period_s
        most = needed
        if scene is not None and scene.moves:
            most = most + scene.growth(near.obstacle, np.array([end_s]))[0]
        if sight.base is not None:
            most = most + near.carried * end_s
        pairs, closer = doubtful(way, near.first, near.second, near.gap, most)
        if not len(pairs):
            return 0.0
        return self._sampled(sight, pairs, needed[pairs], duration_s, closer, postures)

    def _farther(self, sight: Sight, way: Array) -> Sight:
        """Return a sight that reaches as far as a stop may lead: the first one did not."""
        near = self.around.look(
            sight.near.placed, sight.scene, way + 0.03 + self._margin, HORIZON_S
        )
        tube = np.full(near.size, float(sight.tube.max(initial=0.0)))
        floor, _ = self._floors(near, tube, sight.scene, sight.levels)
        if sight.base is not None:
            near = _on_moving_base(near, sight.base)
        return sight._replace(room=way, near=near, tube=tube, floor=floor)

    def _sampled(
        self, sight: Sight, pairs: Index, needed: Array, duration_s: float, closer: Array,
        postures: Postures,
    ) -> float:  # fmt: skip
        """Return how short pairs (k,) of a sight fall of `needed` (k,) [m], looked at along a stop.

        Each may come `closer` (k,) [m] at most.
        """
        near, scene = sight.near, sight.scene
        count = max(math.ceil(duration_s / SAMPLE_S), math.ceil(float(closer.max()) / SAMPLE_M), 1)
        count = min(count, SAMPLES)
        times = (duration_s / count) * np.arange(count + 1.0)
        radii, chord = near.radii[pairs], closer / count
        round_off = chord * chord / (8.0 * np.maximum(radii + near.promise[pairs], 0.02))
        bound = np.empty((count + 1, len(pairs)))
        bound[:] = needed + round_off
        ahead = times + (1.0 + LATENCY) * self._period_s
        if scene is not None and scene.moves:
            bound += scene.growth(near.obstacle[pairs], ahead)
        if sight.base is not None:
            bound += near.carried[pairs] * ahead[:, None]
        wanted = np.minimum(bound, sight.floor[pairs]) + radii
        base = None if sight.base is None else sight.base.T
        ends = self.links.place(postures(times), base).ends
        found = self.around.between(ends, near.first[pairs], near.second[pairs], wanted, scene)
        return max(0.0, float((wanted - found.distance).max()))

    def _floors(
        self, near: Neighbours, tube: Array, scene: Scene | None, levels: Levels
    ) -> tuple[Array, Levels]:
        """Return what each gap must keep at least, and the levels to remember.

        A gap that was below its bound to begin with can only get better: it keeps the best it has
        had. So does that of what may move and stands; while it comes nearer, the gap keeps what
        it is now.
        """
        floor = np.full(near.size, np.inf)
        kept: Levels = {}
        for i in _held(near.gap, near.promise + tube + self._between, near.speed).tolist():
            key, gap, speed = self._key(near, i, scene), float(near.gap[i]), float(near.speed[i])
            level, movable, comes = levels.get(key), speed > 0.0, False
            if movable and scene is not None:
                comes = speed > float(scene.speed[near.obstacle[i]]) + COMES
            if level is None or comes or gap < level - (SLACK if movable else 2.0 * SLACK):
                level = gap + SLACK - CREEP if movable else gap
            kept[key] = max(level, gap)
            floor[i] = min(kept[key] - SLACK, gap)
        return floor, kept

    def _key(self, near: Neighbours, i: int, scene: Scene | None) -> tuple[int, int, str]:
        first, obstacle = int(near.first[i]), int(near.obstacle[i])
        if scene is None or obstacle < 0:
            return (first, int(near.second[i]), "")
        return (first, -1, scene.names[obstacle])

    def shown(
        self, sight: Sight, active: Flags, most: int = SHOWN, only_active: bool = False
    ) -> tuple[Gap, ...]:
        """Return the nearest pairs for telemetry; `active` (k,) says whose barrier acts."""
        near, names = sight.near, self.links.links
        found: list[Gap] = []
        for i in np.argsort(near.gap, kind="stable").tolist():
            if len(found) == most:
                break
            if only_active and not active[i]:
                continue
            obstacle = int(near.obstacle[i])
            if sight.scene is None or obstacle < 0:
                other = names[int(near.second[i])]
            else:
                other = sight.scene.names[obstacle]
            link = names[int(near.first[i])]
            found.append(Gap(link, other, float(near.gap[i]), bool(active[i])))
        return tuple(found)


def _on_moving_base(near: Neighbours, base: Body) -> Neighbours:
    """Return neighbours with the speed at which a Base that moves brings links to obstacles."""
    speed, fastest = carried(
        near.near.normal, near.near.place - base.T.p, near.obstacle, near.speed, base.twist
    )
    return near._replace(speed=speed, carried=fastest)


@compiled(VECTOR, VECTOR, VECTOR)
def _held(gap: Array, bound: Array, speed: Array) -> Index:
    """Return which gaps (k,) are below their bounds, or may be soon, since something moves."""
    held, found = np.empty(len(gap), dtype=np.int64), 0
    for i in range(len(gap)):
        if gap[i] < bound[i] + speed[i] * HORIZON_S:
            held[found] = i
            found += 1
    return held[:found].copy()
