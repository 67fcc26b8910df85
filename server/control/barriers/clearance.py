"""Clearances: their barriers, and their shortfall along a stop.

A promise is kept by the arm itself, not by the command that it follows: what the joints lag behind
the command, times how much that matters for the gap, is taken off every gap (the tracking tube).
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ....config.load import Cell
from ..compiled import COUNT, FLAG, FLAGS, VECTOR, compiled
from ..frame_tree import Body
from ..proximity.capsules import Capsules, Placed
from ..proximity.link_travel import carried, doubtful, surroundings, travel
from ..proximity.pairs import NearPairs, PairSearch
from ..scene import Flags, Index, Scene
from ..spatial import Array
from .clearance_bounds import HORIZON_S, held, kept, wanted
from .velocity_damper import Braking

SAMPLE_S = 0.025
"""Greatest time between two postures that are checked along a stop [s] …"""
SAMPLE_M = 0.03
"""… and greatest motion of any link between them [m]."""
SAMPLES = 16
"""Greatest number of postures that are checked along a stop [1]."""
BETWEEN = 0.4
"""Part of the margin that stops keep: for what a curved path dips between two looks, beside the
chord's, and for what loaded joints give way by, which no encoder sees [1]."""
SLACK = 1e-4
"""A gap that is below its bound may shrink by so much in all, not more [m]."""
CREEP = 2e-5
"""The same of a gap to something that comes nearer, in one period [m]."""
COMES = 1e-3
"""Slower obstacles count as static [m/s]."""
BESIDE = 0.03
"""Extra search radius around capsules [m]."""
LATENCY = 3.0
"""Periods until the arm is where the command is now [1]."""
SHOWN = 4
"""Number of nearest pairs in telemetry [1]."""

_LOOKS = np.arange(SAMPLES + 1.0)
_STILL = np.zeros((0, 0))
"""How much nearer pairs may be where nothing moves: not at all, at any time."""

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


class NearGaps(NamedTuple):
    """Clearances at one posture: near pairs, and the bounds of their gaps."""

    scene: Scene | None
    base: Base
    still: bool
    """Nothing moves but the arm: neither Base nor anything in the scene may."""
    lever: Array
    """Distances of capsules from the joints' axes (c, n) [m]."""
    around: Array
    """How far each capsule may come before other pairs matter (c,) [m]."""
    near: NearPairs
    room: Array
    """How far each gap may close (k,) [m]; negative beyond its barrier."""
    tube: Array
    """Loss of each gap (k,) by tracking errors [m]."""
    needed: Array
    """Minimum of each gap (k,) along a stop [m]."""
    floor: Array
    """Minimum of each gap (k,) that is below its bound already [m]."""
    levels: Levels


class Shown(NamedTuple):
    """Nearest pairs of one tick, for telemetry: their names are looked up on request."""

    sight: NearGaps
    links: tuple[str, ...]
    """Names of the capsules' links (c,)."""
    active: Flags
    """Whose barrier acts (k,)."""

    def gaps(self, most: int = SHOWN, only_active: bool = False) -> tuple[Gap, ...]:
        """Return the nearest pairs, the nearest first."""
        (near, scene), found = (self.sight.near, self.sight.scene), []
        for i in _nearest(near.gap, self.active, most, only_active).tolist():
            obstacle = int(near.obstacle[i])
            if scene is None or obstacle < 0:
                other = self.links[int(near.second[i])]
            else:
                other = scene.names[obstacle]
            link = self.links[int(near.first[i])]
            found.append(Gap(link, other, float(near.gap[i]), bool(self.active[i])))
        return tuple(found)


class Clearance:
    """The clearances of one cell."""

    def __init__(self, cell: Cell, acceleration: Array, jerk: Array, capsules: Capsules) -> None:
        self.capsules = capsules
        self.search = PairSearch(cell, capsules)
        self._period_s = cell.config.timing.period_s
        self._margin = cell.config.avoidance.margin
        self._between = BETWEEN * self._margin
        self.braking = Braking(acceleration, jerk, self._period_s)

    def look(
        self, q: Array, fastest: Array, error: Array, scene: Scene | None, factor: float,
        levels: Levels, base: Base = None, placed: Placed | None = None,
    ) -> NearGaps:  # fmt: skip
        """Return near pairs and bounds at q (n,) [rad], for joint speeds `fastest` (n,) [rad/s].

        `error` (n,) [rad] is what the joints are behind the command; `factor` the reduced-speed
        setting; `levels` those of the sight before; `base` where a Base that moves is; `placed`
        where links are at q, where that is known.
        """
        capsules, still = self.capsules, base is None and (scene is None or not scene.moves)
        if placed is None:
            placed = capsules.place(q[None], None if base is None else base.T)
        gear, acceleration = capsules.forest.gear, self.braking.acceleration
        if gear is not None:
            fastest, acceleration = gear * fastest, gear * acceleration
        lever, around = surroundings(
            placed[:], capsules.moves, capsules.forest.tree.prismatic, fastest,
            acceleration, factor, self.braking.lag(factor), BESIDE + self._margin,
        )  # fmt: skip
        near = self.search.find(placed, scene, around, HORIZON_S)
        if base is not None:
            near = _on_moving_base(near, base)
        tube, room, needed, floor, which = kept(
            near.rows, error, near.gap, near.promise, near.speed,
            _STILL if still else self._nearer(near, scene, base, [LATENCY * self._period_s]),
            self._margin, self._between,
        )  # fmt: skip
        levels = self._floors(near, floor, which, scene, levels)
        return NearGaps(scene, base, still, lever, around, near, room, tube, needed, floor, levels)

    def shortfall(
        self, sight: NearGaps, duration_s: float, way: Array, postures: Postures
    ) -> float:
        """Return by how much the worst gap falls short along a stop [m]; 0 where all are kept.

        `way` (n,) [rad] bounds how far joints go from where they are; `postures` gives them.
        """
        if self.capsules.forest.gear is not None:
            way = self.capsules.forest.gear * way
        return self._short(sight, duration_s, way, postures)

    def _short(self, sight: NearGaps, duration_s: float, way: Array, postures: Postures) -> float:
        """Return the shortfall, given how far at most the joints turn what they move (n,) [rad]."""
        near, most = sight.near, sight.needed
        if not sight.still:
            end_s = duration_s + (1.0 + LATENCY) * self._period_s
            most = most + self._nearer(near, sight.scene, sight.base, [end_s])[0]
        leaves, pairs, closer = doubtful(sight.lever, way, sight.around, near[:2], near.gap, most)
        if leaves:
            sight = self._farther(sight, travel(sight.lever, way))
            return self._short(sight, duration_s, way, postures)
        if not len(pairs):
            return 0.0
        return self._sampled(sight, pairs, closer, duration_s, postures)

    def _farther(self, sight: NearGaps, way: Array) -> NearGaps:
        """Return a sight that reaches as far as a stop may lead: the first one did not."""
        around = way + BESIDE + self._margin
        near = self.search.find(sight.near.placed, sight.scene, around, HORIZON_S)
        tube = np.full(near.size, float(sight.tube.max(initial=0.0)))
        needed, floor, which = held(tube, near.gap, near.promise, near.speed, self._between)
        self._floors(near, floor, which, sight.scene, sight.levels)
        if sight.base is not None:
            near = _on_moving_base(near, sight.base)
        return sight._replace(around=way, near=near, tube=tube, needed=needed, floor=floor)

    def _sampled(
        self, sight: NearGaps, pairs: Index, closer: Array, duration_s: float, postures: Postures
    ) -> float:
        """Return how short pairs (p,) fall of what they need [m], looked at along a stop.

        Each may come `closer` (p,) [m] at most.
        """
        near, scene, base = sight.near, sight.scene, sight.base
        farthest = max(closer.tolist())
        count = max(math.ceil(duration_s / SAMPLE_S), math.ceil(farthest / SAMPLE_M), 1)
        count = min(count, SAMPLES)
        times, nearer = (duration_s / count) * _LOOKS[: count + 1], _STILL
        if not sight.still:
            nearer = self._nearer(near, scene, base, times + (1.0 + LATENCY) * self._period_s)
        bounds = wanted(
            count, pairs, closer, sight.needed, near.promise, near.radii, sight.floor, nearer
        )
        ends = self.capsules.place(postures(times), None if base is None else base.T).ends
        return self.search.shortfall(ends, near, pairs, bounds, scene)

    def _nearer(
        self, near: NearPairs, scene: Scene | None, base: Base, ahead_s: Sequence[float] | Array
    ) -> Array:
        """Return how much nearer pairs may be than now (s, k) [m], some times (s,) [s] from now.

        By what moves in the scene, and with Base.
        """
        ahead = np.asarray(ahead_s)
        if scene is not None and scene.moves:
            found = scene.growth(near.obstacle, ahead)
        else:
            found = np.zeros((len(ahead), near.size))
        return found if base is None else found + near.carried * ahead[:, None]

    def _floors(
        self, near: NearPairs, floor: Array, held: Index, scene: Scene | None, levels: Levels
    ) -> Levels:
        """Set what gaps that are `held` must keep at least, and return the levels to remember.

        A gap that was below its bound to begin with can only get better: it keeps the best it has
        had. So does that of what may move and stands; while it comes nearer, the gap keeps what
        it is now.
        """
        kept: Levels = {}
        for i in held.tolist():
            key, gap, speed = self._key(near, i, scene), float(near.gap[i]), float(near.speed[i])
            level, movable, comes = levels.get(key), speed > 0.0, False
            if movable and scene is not None:
                comes = speed > float(scene.speed[near.obstacle[i]]) + COMES
            if level is None or comes or gap < level - (SLACK if movable else 2.0 * SLACK):
                level = gap + SLACK - CREEP if movable else gap
            kept[key] = max(level, gap)
            floor[i] = min(kept[key] - SLACK, gap)
        return kept

    def _key(self, near: NearPairs, i: int, scene: Scene | None) -> tuple[int, int, str]:
        first, obstacle = int(near.first[i]), int(near.obstacle[i])
        if scene is None or obstacle < 0:
            return (first, int(near.second[i]), "")
        return (first, -1, scene.names[obstacle])


def _on_moving_base(near: NearPairs, base: Body) -> NearPairs:
    """Return pairs with the speed at which a Base that moves brings links to obstacles."""
    speed, fastest = carried(
        near.near.normal, near.near.place - base.T.p, near.obstacle, near.speed, base.twist
    )
    return near._replace(speed=speed, carried=fastest)


@compiled(VECTOR, FLAGS, COUNT, FLAG)
def _nearest(gap: Array, active: Flags, most: int, only_active: bool) -> Index:
    """Return the nearest of pairs (k,), nearest first; of equal ones the first comes first."""
    found, count = np.empty(most, dtype=np.int64), 0
    for i in range(len(gap)):
        if only_active and not active[i]:
            continue
        place = min(count, most)
        while place > 0 and gap[found[place - 1]] > gap[i]:
            if place < most:
                found[place] = found[place - 1]
            place -= 1
        if place < most:
            found[place] = i
            count = min(count + 1, most)
    return found[:count].copy()
