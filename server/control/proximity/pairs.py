"""Pairs that are near, culled cheaply, and control points on the arm."""

import math
from typing import Final, NamedTuple

import numpy as np

from ....config.errors import ConfigError
from ....config.load import Cell
from ....config.schema.null_space import VirtualSphereSection
from ..compiled import (
    ARRAY3,
    ARRAY4,
    COUNT,
    COUNTS,
    FLAG,
    FLAGS,
    FLAGS2,
    INDEX,
    INDEX2,
    MATRIX,
    NUMBER,
    VECTOR,
    compiled,
    record,
)
from ..forest import Forest
from ..scene import Flags, Index, Scene, empty
from ..spatial import Array, Pose
from .capsules import Capsules, Placed
from .distance import OBSTACLES, NearestPoints, Obstacles, apart, described, measured, violation

# --- Pairs that are near: links and obstacles, links and each other; far ones are culled cheaply
#
# A pair is a capsule of the arm (`first`) and another thing (`second`), counted as in
# `distance.py`. Those of two capsules come first, then those with rounds, then those with
# boxes.

NEIGHBOURS = 2
"""Links that so many joints part, or fewer, may overlap by design [1]."""

_NOTHING = empty()


class NearPairs(NamedTuple):
    """The pairs that are near at one posture; all arrays have one row per pair."""

    first: Index
    second: Index
    placed: Placed
    near: NearestPoints
    radii: Array
    """Sum of both radii [m]."""
    gap: Array
    """Distance of the surfaces [m]."""
    promise: Array
    """Least distance that the cell promises [m]."""
    rows: Array
    """Slope of the gap in the joint angles (k, n) [m/rad]."""
    speed: Array
    """Speed at which the second may approach [m/s]."""
    approach: Array
    """Speed at which news shows the second to approach (k,) [m/s]; 0 for one that does not."""
    obstacle: Index
    """Index of the second in the scene; −1 for links."""
    carried: Array
    """Speed at which a moving Base carries the first (k,) [m/s]."""

    @property
    def size(self) -> int:
        """Number of pairs."""
        return len(self.gap)


class PairSearch:
    """Finds the pairs that are near the arm of one cell."""

    def __init__(self, cell: Cell, capsules: Capsules) -> None:
        self.capsules = capsules
        avoidance = cell.config.avoidance
        self._own_clearance = avoidance.self_clearance
        self._contacts = {(c.link, c.other) for c in avoidance.allowed_contacts}
        self._size = capsules.half_length + capsules.radius
        self._bodies = capsules.radius, capsules.moves, capsules.forest.tree.prismatic
        self._own = self._own_pairs(avoidance.self_clearance + avoidance.margin)
        self._of: tuple[tuple[str, ...], Flags] | None = None

    def find(self, placed: Placed, scene: Scene | None, room: Array, ahead_s: float) -> NearPairs:
        """Return the pairs at one posture that are nearer than promised plus `room` (c,) [m].

        `room` is how far each capsule may come; what moves counts for the next `ahead_s` [s].
        """
        scene = _NOTHING if scene is None else scene
        reach = scene.kept_clear(ahead_s) if scene.moves else scene.clearance
        wanted = self._wanted(scene)
        first = np.empty(len(self._own) + wanted.size, dtype=np.int64)
        second = np.empty(len(first), dtype=np.int64)
        count = _search(
            placed.ends, self._size, room, self._own, self._own_clearance,
            scene.segments, scene.rounds.radius, reach, wanted, scene.hard, first, second,
        )  # fmt: skip
        pairs = first[:count], second[:count]
        near = NearestPoints(*measured(placed.ends, pairs, scene.segments))
        motion = scene.clearance, scene.velocity, scene.speed, scene.observed
        radii, gap, promise, rows, speed, approach, obstacle, none = described(
            placed[:], self._bodies, pairs, near[:], self._own_clearance,
            scene.rounds.radius, motion,
        )  # fmt: skip
        return NearPairs(
            *pairs, placed, near, radii, gap, promise, rows, speed, approach, obstacle, none
        )

    def violation(
        self, ends: Array, near: NearPairs, which: Index, least: Array, scene: Scene | None
    ) -> float:
        """Return the greatest shortfall of distances below the least ones [m]; 0 for none.

        `ends` (s, c, 2, 3) are the capsules' at s postures in World; the scene stands still.
        `least` (s, p) [m], between segments, is for those pairs `which` (p,) are near.
        """
        scene = _NOTHING if scene is None else scene
        return violation(ends, near[:2], which, least, scene.segments)

    def _wanted(self, scene: Scene) -> Flags:
        """Return which capsules and obstacles (c, k) may be kept apart at all."""
        if self._of is None or self._of[0] != scene.names:
            links, movable = self.capsules.links, self.capsules.movable
            allowed = np.array(
                [
                    [moved and (link, name) not in self._contacts for name in scene.names]
                    for link, moved in zip(links, movable, strict=True)
                ],
                dtype=bool,
            )
            self._of = (scene.names, allowed.reshape(len(links), -1))
        return self._of[1]

    def _own_pairs(self, least: float) -> Index:
        """Return the pairs of links to keep apart: no neighbours, none that meet at neutral."""
        capsules, links = self.capsules, self.capsules.links
        found = [
            (i, j)
            for j in range(len(links))
            for i in range(j)
            if self._part(i, j)
            and not {(links[i], links[j]), (links[j], links[i])} & self._contacts
        ]
        pairs = np.array(found, dtype=np.int64).reshape(-1, 2)
        ends = capsules.place(np.zeros((1, capsules.forest.n))).ends
        apart = measured(ends, (pairs[:, 0], pairs[:, 1]), _NOTHING.segments)[0]
        meet = apart - capsules.radius[pairs].sum(axis=1) <= least
        # Two mechanisms that meet where all joints are at zero are no such pair.
        own = [self._root(a) == self._root(b) for a, b in pairs.tolist()]
        return np.asarray(pairs[~(meet & np.array(own, dtype=bool))])

    def _part(self, i: int, j: int) -> bool:
        """Return whether enough joints move one of two capsules and not the other."""
        capsules = self.capsules
        between = int((capsules.moves[i] ^ capsules.moves[j]).sum())
        return between > (NEIGHBOURS if self._root(i) == self._root(j) else 0)

    def _root(self, i: int) -> int:
        """Return the root of the mechanism that a capsule belongs to."""
        return self.capsules.forest.root(int(self.capsules.body[i]))


@compiled(
    ARRAY4, VECTOR, VECTOR, INDEX2, NUMBER, OBSTACLES,
    VECTOR, VECTOR, FLAGS2, FLAGS, COUNTS, COUNTS,
)  # fmt: skip
def _search(
    ends: Array, length: Array, room: Array, own: Index, own_clearance: float,
    obstacles: Obstacles,
    radius: Array, further: Array, wanted: Flags, hard: Flags, first: Index, second: Index,
) -> int:  # fmt: skip
    """Write `first` and `second` of pairs whose surroundings meet: balls, and boxes themselves.

    Return how many there are. `ends` (1, c, 2, 3) are the capsules', of which each reaches `length`
    (c,) from its middle, and `room` (c,) around that; `own` (p, 2) are their pairs. `further` is
    how far each obstacle reaches beyond its surface [m]. Only `wanted` (c, k) pairs with `hard`
    obstacles (k,) count.
    """
    start, end, R, centre, half = obstacles
    capsules, rounds, boxes, size = ends.shape[1], len(start), len(centre), length + room
    middle = np.empty((capsules, 3))
    for c in range(capsules):
        for i in range(3):
            middle[c, i] = 0.5 * (ends[0, c, 0, i] + ends[0, c, 1, i])
    found = 0
    for pair in range(len(own)):
        a, b = own[pair]
        reach, apart2 = size[a] + size[b] + own_clearance, 0.0
        for i in range(3):
            apart2 += (middle[a, i] - middle[b, i]) ** 2
        if apart2 < reach * reach:
            first[found], second[found] = a, b
            found += 1
    around = np.empty(rounds)
    for k in range(rounds):
        length2 = 0.0
        for i in range(3):
            length2 += (end[k, i] - start[k, i]) ** 2
        around[k] = 0.5 * math.sqrt(length2) + radius[k] + further[k]
    for c in range(capsules):
        for k in range(rounds):
            if wanted[c, k] and hard[k]:
                reach, apart2 = size[c] + around[k], 0.0
                for i in range(3):
                    apart2 += (middle[c, i] - 0.5 * (start[k, i] + end[k, i])) ** 2
                if apart2 < reach * reach:
                    first[found], second[found] = c, capsules + k
                    found += 1
    for c in range(capsules):
        for box in range(boxes):
            k = rounds + box
            if wanted[c, k] and hard[k]:
                reach, apart2 = size[c] + further[k], 0.0
                for j in range(3):
                    x = 0.0
                    for i in range(3):
                        x += R[box, i, j] * (middle[c, i] - centre[box, i])
                    apart2 += max(abs(x) - half[box, j], 0.0) ** 2
                if apart2 < reach * reach:
                    first[found], second[found] = c, capsules + k
                    found += 1
    return found


# --- The nearest pairs, as operators are told of them ---------------------------------------------

SHOWN = 4
"""Number of nearest pairs in telemetry [1]."""


class Gap(NamedTuple):
    """One pair, as it is told to operators."""

    link: str
    other: str
    gap: float
    """Distance of the surfaces, of the commanded arm [m]."""
    active: bool
    """True while its barrier bends or slows the motion."""


class Shown(NamedTuple):
    """Nearest pairs of one tick, for telemetry: their names are looked up on request."""

    near: NearPairs
    scene: Scene | None
    links: tuple[str, ...]
    """Names of the capsules' links (c,)."""
    active: Flags
    """Whose barrier acts (k,)."""

    def gaps(self, most: int = SHOWN, only_active: bool = False) -> tuple[Gap, ...]:
        """Return the nearest pairs, the nearest first."""
        near, scene, found = self.near, self.scene, []
        for i in _nearest(near.gap, self.active, most, only_active).tolist():
            obstacle = int(near.obstacle[i])
            if scene is None or obstacle < 0:
                other = self.links[int(near.second[i])]
            else:
                other = scene.names[obstacle]
            link = self.links[int(near.first[i])]
            found.append(Gap(link, other, float(near.gap[i]), bool(self.active[i])))
        return tuple(found)


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


# --- Control points on the arm: their distances from obstacles, and the slope of the least of them
#
# They are the centres of the cell's virtual spheres.

ALIKE: Final = 0.005
"""Distances that differ by so much are nearly one, and their slopes are mixed [m]. Where another
point or obstacle becomes the nearest, the direction to go turns over; it does not jump."""


class ControlPointDistances(NamedTuple):
    """Distances of the control points from obstacles at one posture."""

    each: Array
    """Of each to the nearest surface (s,) [m]; infinite without obstacles."""
    slope: Array
    """Of the least of them in the joint angles (n,) [m/rad]."""

    @property
    def least(self) -> float:
        """The least of them [m]."""
        return float(self.each.min())


class ControlPoints:
    """The centres of one cell's virtual spheres."""

    def __init__(self, cell: Cell, spheres: tuple[VirtualSphereSection, ...]) -> None:
        """Place them. Raises `ConfigError` for one on a link that there is not, or that stands."""
        self._forest = Forest(cell)
        placed = [self._place(cell, i, sphere) for i, sphere in enumerate(spheres)]
        self._body: Index = np.array([body for body, _ in placed], dtype=np.int64)
        self._moves = self._forest.moves(self._body)
        self._centre = np.array([p for _, p in placed])

    def look(
        self, q: Array, scene: Scene | None, T_world_base: Pose | None = None
    ) -> ControlPointDistances:
        """Return the distances at joint angles q (n,) [rad]."""
        if scene is not None:
            frames = self._forest.frames(q[None], T_world_base)
            centre = _placed(frames, self._body, self._centre)
            away = apart(centre, scene)
            if away.distance.size:
                joints = frames, self._forest.axes(frames), self._forest.tree.prismatic
                return ControlPointDistances(*_mixed(joints, self._moves, centre, away[:]))
        return ControlPointDistances(np.full(len(self._centre), np.inf), np.zeros(len(q)))

    def _place(self, cell: Cell, i: int, sphere: VirtualSphereSection) -> tuple[int, Array]:
        where = f"{cell.path}: priority.spheres[{i}].link: value '{sphere.link}'"
        try:
            body, T = self._forest.body_of(f"{cell.prefix}{sphere.link}")
        except KeyError:
            raise ConfigError(f"{where}: no such link in {cell.robot.urdf}") from None
        if body == 0:
            raise ConfigError(f"{where}: no joint of the arm moves it")
        return body, T.R @ np.array(sphere.centre) + T.p


@compiled(ARRAY4, INDEX, MATRIX)
def _placed(frames: Array, body: Index, centre: Array) -> Array:
    """Return the centres (s, 3) of spheres on bodies (s,), in World, by frames (1, n, 3, 4)."""
    found = np.empty(centre.shape)
    for s in range(len(body)):
        for i in range(3):
            found[s, i] = frames[0, body[s] - 1, i, 3]
            for k in range(3):
                found[s, i] += frames[0, body[s] - 1, i, k] * centre[s, k]
    return found


@compiled(record(ARRAY4, ARRAY3, FLAGS), FLAGS2, MATRIX, record(MATRIX, ARRAY3))
def _mixed(
    joints: tuple[Array, Array, Flags], moves: Flags, centre: Array, apart: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return the least distance of each point (s,), and the slope of the least of all (n,).

    `joints` are frames (1, n, 3, 4) and axes (1, n, 3), and which are prismatic (n,); `moves` (s,
    n) tells which joints move the points at `centre` (s, 3); `apart` is a record `Apart`.
    """
    (frames, axes, prismatic), (distance, normal) = joints, apart
    points, obstacles = distance.shape
    each, slope = np.full(points, np.inf), np.zeros(axes.shape[1])
    for s in range(points):
        for k in range(obstacles):
            each[s] = min(each[s], distance[s, k])
    least, total = each.min(), 0.0
    for s in range(points):
        x = y = z = 0.0
        for k in range(obstacles):
            share = math.exp((least - distance[s, k]) / ALIKE)
            x += share * normal[s, k, 0]
            y += share * normal[s, k, 1]
            z += share * normal[s, k, 2]
            total += share
        for j in range(axes.shape[1]):
            if not moves[s, j]:
                continue
            a, b, c = axes[0, j, 0], axes[0, j, 1], axes[0, j, 2]
            if not prismatic[j]:  # the axis times the way from it to the centre
                u = centre[s, 0] - frames[0, j, 0, 3]
                v = centre[s, 1] - frames[0, j, 1, 3]
                w = centre[s, 2] - frames[0, j, 2, 3]
                a, b, c = b * w - c * v, c * u - a * w, a * v - b * u
            slope[j] += a * x + b * y + c * z
    return each, slope / total
