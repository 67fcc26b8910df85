"""Clearances: their barriers, and what a stop would leave of them.

A promise is kept by the arm itself, not by the command that it follows: what the joints lag behind
the command, times how much that matters for the gap, is taken off every gap (the tracking tube).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ....config.load import Cell
from ..frames import Array
from ..scene import Scene
from ..tree import Body
from .approach import Braking
from .links import Flags, Index, Links
from .neighbours import Around, Neighbours

SAMPLE_S = 0.025
"""A stop is looked at this often at least [s] …"""
SAMPLE_M = 0.03
"""… and after so much motion of any link [m]."""
SAMPLES = 16
"""Most looks at one stop [1]."""
BETWEEN = 0.001
"""Kept beyond the promise for what a curved path dips between two looks, beside the chord's [m]."""
SLACK = 1e-4
"""A gap that is below its bound may shrink by so much in all, not more [m]."""
CREEP = 2e-5
"""The same in one period, of a gap to something that moves [m]."""
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


@dataclass(frozen=True)
class Gap:
    """One pair, as it is told to operators."""

    link: str
    other: str
    gap: float
    """Distance of the surfaces, of the commanded arm [m]."""
    active: bool
    """True while its barrier bends or slows the motion."""


@dataclass(frozen=True)
class Sight:
    """What clearances are at one posture."""

    q: Array
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


def travel(lever: Array, way: Array) -> Array:
    """Return how far capsules move at most (c,) [m] when joints move by no more than `way` (n,).

    The levers (c, n) themselves grow with the motion: D' ≤ Σ way (lever + D), so that
    D ≤ lever·way (exp(σ) − 1)/σ with σ the sum of all ways.
    """
    total = float(way.sum())
    return np.asarray(lever @ way * (math.expm1(total) / total if total > 1e-9 else 1.0))


def carried(near: Neighbours, base: Body) -> Neighbours:
    """Return neighbours with the speed at which a Base that moves brings links to obstacles."""
    place, w = near.near.place - base.T.p, base.twist[3:]
    v = base.twist[:3] + np.stack(
        [
            w[1] * place[:, 2] - w[2] * place[:, 1],
            w[2] * place[:, 0] - w[0] * place[:, 2],
            w[0] * place[:, 1] - w[1] * place[:, 0],
        ],
        axis=1,
    )
    others = near.obstacle >= 0
    closing = np.where(others, -np.einsum("ki,ki->k", near.near.normal, v), 0.0)
    fastest = np.where(others, np.sqrt(np.einsum("ki,ki->k", v, v)), 0.0)
    return near._replace(speed=np.maximum(near.speed + closing, 0.0), carried=fastest)


class Clearance:
    """The clearances of one cell."""

    def __init__(self, cell: Cell, acceleration: Array, jerk: Array) -> None:
        self.links = Links(cell)
        self.around = Around(cell, self.links)
        self._period_s = cell.config.timing.period_s
        self._margin = cell.config.avoidance.margin
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
            near = carried(near, base)
        tube = np.abs(near.rows) @ np.abs(error)
        floor, levels = self._floors(near, tube, scene, levels)
        return Sight(q, scene, base, lever, room, near, tube, floor, levels)

    def room(self, sight: Sight) -> Array:
        """Return how far each gap may close (k,) [m]; negative beyond its barrier."""
        near = sight.near
        room = near.gap - near.promise - self._margin - sight.tube
        if sight.scene is not None and sight.scene.moves:
            room = room - self._growth(near, sight.scene, LATENCY * self._period_s)
        if sight.base is not None:
            room = room - near.carried * LATENCY * self._period_s
        return room

    def shortfall(
        self, sight: Sight, duration_s: float, low: Array, high: Array, postures: Postures
    ) -> float:
        """Return by how much the worst gap falls short along a stop [m]; 0 where all are kept.

        `low` and `high` (n,) bound the joints along the stop; `postures` gives them at times.
        """
        deviation = np.maximum(high - sight.q, sight.q - low)
        way = travel(sight.lever, deviation)
        if (way > sight.room).any():
            sight = self._farther(sight, way)
        near, scene = sight.near, sight.scene
        if not near.size:
            return 0.0
        first = near.pairs.first
        closer = way[first]
        if len(near.pairs.own):
            closer[: len(near.pairs.own)] += way[near.pairs.own[:, 1]]
        needed = near.promise + sight.tube + BETWEEN
        end_s = duration_s + (1.0 + LATENCY) * self._period_s
        most = needed
        if scene is not None and scene.moves:
            most = most + self._growth(near, scene, end_s)
        if sight.base is not None:
            most = most + near.carried * end_s
        doubtful = near.gap - closer < most
        if not doubtful.any():
            return 0.0
        return self._sampled(sight, doubtful, needed, duration_s, closer, postures)

    def _farther(self, sight: Sight, way: Array) -> Sight:
        """Return a sight that reaches as far as a stop may lead: the first one did not."""
        near = self.around.look(
            sight.near.placed, sight.scene, way + 0.03 + self._margin, HORIZON_S
        )
        tube = np.full(near.size, float(sight.tube.max(initial=0.0)))
        floor, _ = self._floors(near, tube, sight.scene, sight.levels)
        if sight.base is not None:
            near = carried(near, sight.base)
        return Sight(
            sight.q, sight.scene, sight.base, sight.lever, way, near, tube, floor, sight.levels
        )

    def _sampled(
        self, sight: Sight, doubtful: Flags, needed: Array, duration_s: float, closer: Array,
        postures: Postures,
    ) -> float:  # fmt: skip
        near, scene = sight.near, sight.scene
        longest = float(closer[doubtful].max())
        count = max(math.ceil(duration_s / SAMPLE_S), math.ceil(longest / SAMPLE_M), 1)
        count = min(count, SAMPLES)
        times = np.linspace(0.0, duration_s, count + 1)
        pairs = near.pairs.chosen(doubtful)
        base = None if sight.base is None else sight.base.T
        ends = self.links.place(postures(times), base).ends
        radii = self.around.radii(pairs, scene)
        gaps = self.around.between(ends, pairs, scene).distance - radii
        chord = closer[doubtful] / count
        round_off = chord * chord / (8.0 * np.maximum(radii + near.promise[doubtful], 0.02))
        bound = needed[doubtful] + round_off
        if scene is not None and scene.moves:
            ahead = times[:, None] + (1.0 + LATENCY) * self._period_s
            bound = bound + self._growth_at(near.obstacle[doubtful], scene, ahead)
        if sight.base is not None:
            ahead = times[:, None] + (1.0 + LATENCY) * self._period_s
            bound = bound + near.carried[doubtful] * ahead
        short = np.minimum(bound, sight.floor[doubtful]) - gaps
        return max(0.0, float(short.max()))

    def _growth(self, near: Neighbours, scene: Scene, ahead_s: float) -> Array:
        """Return how much nearer each second may be `ahead_s` from now (k,) [m]."""
        return np.asarray(self._growth_at(near.obstacle, scene, np.array([[ahead_s]]))[0])

    def _growth_at(self, obstacle: Index, scene: Scene, ahead: Array) -> Array:
        speed = np.sqrt((scene.velocity * scene.velocity).sum(axis=1))
        grown = scene.reach(ahead) + speed * ahead
        return np.asarray(np.where(obstacle >= 0, grown[:, obstacle], 0.0))

    def _floors(
        self, near: Neighbours, tube: Array, scene: Scene | None, levels: Levels
    ) -> tuple[Array, Levels]:
        """Return what each gap must keep at least, and the levels to remember.

        A gap that was below its bound to begin with can only get better: it keeps the best it has
        had. That of something that moves keeps what it is now.
        """
        floor = np.full(near.size, np.inf)
        below = near.gap < near.promise + tube + BETWEEN
        moving = near.speed > 0.0
        floor[moving] = near.gap[moving] - CREEP
        if not below.any():
            return floor, {}
        kept: Levels = {}
        for i in np.flatnonzero(below & ~moving):
            key = self._key(near, int(i), scene)
            gap = float(near.gap[i])
            level = levels.get(key, gap)
            level = gap if gap < level - 2.0 * SLACK else max(level, gap)
            kept[key] = level
            floor[i] = min(level - SLACK, gap)
        return floor, kept

    def _key(self, near: Neighbours, i: int, scene: Scene | None) -> tuple[int, int, str]:
        first = int(near.pairs.first[i])
        if scene is None or near.obstacle[i] < 0:
            return (first, int(near.pairs.own[i, 1]), "")
        return (first, -1, scene.names[int(near.obstacle[i])])

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
            first = int(near.pairs.first[i])
            if sight.scene is None or near.obstacle[i] < 0:
                other = names[int(near.pairs.own[i, 1])]
            else:
                other = sight.scene.names[int(near.obstacle[i])]
            found.append(Gap(names[first], other, float(near.gap[i]), bool(active[i])))
        return tuple(found)
