"""What is near the arm: links against obstacles and against each other, far pairs culled cheaply.

A pair is a capsule of the arm (`first`) and another thing (`second`), counted as in `distance.py`.
Those of two capsules come first, then those with rounds, then those with boxes.
"""

import math
from typing import NamedTuple

import numpy as np

from ....config.load import Cell
from ..compiled import (
    ARRAY3,
    ARRAY4,
    FLAGS,
    FLAGS2,
    INDEX,
    INDEX2,
    MATRIX,
    NUMBER,
    VECTOR,
    compiled,
)
from ..scene import Flags, Index, Scene, empty
from ..spatial import Array
from .capsules import Links, Placed
from .distance import measured, shortfall

NEIGHBOURS = 2
"""Links that so many joints part, or fewer, may overlap by design [1]."""

_NOTHING = empty()


class Near(NamedTuple):
    """The nearest places of k pairs of things."""

    distance: Array
    """(k,) [m]; below zero for a segment inside a box: how far it has to come out."""
    normal: Array
    """(k, 3)."""
    place: Array
    """On the first thing (k, 3) [m]."""


class Neighbours(NamedTuple):
    """The pairs that are near at one posture, and how; all arrays have one row per pair."""

    first: Index
    second: Index
    placed: Placed
    near: Near
    radii: Array
    """What the surfaces are nearer than the segments [m]."""
    gap: Array
    """Distance of the surfaces [m]."""
    promise: Array
    """Distance that is promised [m]."""
    rows: Array
    """Slope of the gap in the joint angles (k, n) [m/rad]."""
    speed: Array
    """Speed at which the second may come nearer [m/s]."""
    obstacle: Index
    """Index of the second in the scene; −1 for links."""
    carried: Array
    """Speed at which a moving Base carries the first (k,) [m/s]."""

    @property
    def size(self) -> int:
        """Number of pairs."""
        return len(self.gap)


class Around:
    """Finds what is near the arm of one cell."""

    def __init__(self, cell: Cell, links: Links) -> None:
        self.links = links
        avoidance = cell.config.avoidance
        self._own_clearance = avoidance.self_clearance
        self._contacts = {(c.link, c.other) for c in avoidance.allowed_contacts}
        self._size = links.half_length + links.radius
        self._own = self._own_pairs(avoidance.self_clearance + avoidance.margin)
        self._of: tuple[tuple[str, ...], Flags] | None = None

    def look(self, placed: Placed, scene: Scene | None, room: Array, ahead_s: float) -> Neighbours:
        """Return the pairs at one posture that are nearer than promised plus `room` (c,) [m].

        `room` is how far each capsule may come; `ahead_s` the time for which what moves counts.
        """
        scene = _NOTHING if scene is None else scene
        links, rounds, boxes = self.links, scene.rounds, scene.boxes
        further = scene.clearance
        if scene.moves:
            every = np.arange(len(scene.names))
            further = further + scene.growth(every, np.array([ahead_s]))[0]
        first, second = _within(
            placed.ends, self._size, room, self._own, self._own_clearance,
            rounds.start, rounds.end, rounds.radius, boxes.R, boxes.centre, boxes.half,
            further, self._wanted(scene), scene.hard,
        )  # fmt: skip
        near = self._measured(placed.ends, first, second, scene)
        radii, gap, promise, rows, speed, obstacle, none = _told(
            placed.frames, placed.axes, links.chain.prismatic, links.body, links.radius,
            first, second, near.distance, near.normal, near.place, self._own_clearance,
            rounds.radius, scene.clearance, scene.velocity, scene.speed,
        )  # fmt: skip
        return Neighbours(
            first, second, placed, near, radii, gap, promise, rows, speed, obstacle, none
        )

    def shortfall(
        self, ends: Array, near: Neighbours, pairs: Index, wanted: Array, scene: Scene | None
    ) -> float:
        """Return by how much distances fall short of what is wanted at worst [m]; 0 for not.

        `ends` (s, c, 2, 3) are the capsules' at s postures in World; the scene stands still.
        `wanted` (s, p) [m], between segments, is that of `pairs` (p,) of those that are near.
        """
        scene = _NOTHING if scene is None else scene
        rounds, boxes = scene.rounds, scene.boxes
        return shortfall(
            ends, pairs, near.first, near.second, wanted,
            rounds.start, rounds.end, boxes.R, boxes.centre, boxes.half,
        )  # fmt: skip

    def _measured(self, ends: Array, first: Index, second: Index, scene: Scene) -> Near:
        """Return where pairs are nearest."""
        r, b = scene.rounds, scene.boxes
        return Near(*measured(ends, first, second, r.start, r.end, b.R, b.centre, b.half))

    def _wanted(self, scene: Scene) -> Flags:
        """Return which capsules and obstacles (c, k) may be kept apart at all."""
        if self._of is None or self._of[0] != scene.names:
            allowed = np.array(
                [
                    [body > 0 and (link, name) not in self._contacts for name in scene.names]
                    for link, body in zip(self.links.links, self.links.body, strict=True)
                ],
                dtype=bool,
            )
            self._of = (scene.names, allowed.reshape(len(self.links.links), -1))
        return self._of[1]

    def _own_pairs(self, least: float) -> Index:
        """Return the pairs of links to keep apart: no neighbours, none that meet at neutral."""
        links = self.links
        found = [
            (i, j)
            for j in range(len(links.capsules))
            for i in range(j)
            if links.body[j] - links.body[i] > NEIGHBOURS
            and not {(links.links[i], links.links[j]), (links.links[j], links.links[i])}
            & self._contacts
        ]
        pairs = np.array(found, dtype=np.int64).reshape(-1, 2)
        ends = links.place(np.zeros((1, links.chain.n))).ends
        apart = self._measured(ends, pairs[:, 0], pairs[:, 1], _NOTHING).distance
        return np.asarray(pairs[apart - links.radius[pairs].sum(axis=1) > least])


@compiled(
    ARRAY4, VECTOR, VECTOR, INDEX2, NUMBER,
    MATRIX, MATRIX, VECTOR, ARRAY3, MATRIX, MATRIX,
    VECTOR, FLAGS2, FLAGS,
)  # fmt: skip
def _within(
    ends: Array, length: Array, room: Array, own: Index, own_clearance: float,
    start: Array, end: Array, radius: Array, R: Array, centre: Array, half: Array,
    further: Array, wanted: Flags, hard: Flags,
) -> tuple[Index, Index]:  # fmt: skip
    """Return the pairs whose surroundings meet: balls around segments, and the boxes themselves.

    `ends` (1, c, 2, 3) are the capsules', of which each reaches `length` (c,) from its middle, and
    `room` (c,) around that; `own` (p, 2) are their pairs. `further` is what each obstacle reaches
    beyond its surface [m]. Only `wanted` (c, k) pairs with `hard` obstacles (k,) count.
    """
    capsules, rounds, boxes, size = ends.shape[1], len(start), len(centre), length + room
    most = len(own) + capsules * (rounds + boxes)
    first, second = np.empty(most, dtype=np.int64), np.empty(most, dtype=np.int64)
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
    return first[:found].copy(), second[:found].copy()


@compiled(MATRIX, INDEX, INDEX, VECTOR, NUMBER, VECTOR, VECTOR, MATRIX, VECTOR)
def _surfaces(
    normal: Array, first: Index, second: Index, link_radius: Array, own_clearance: float,
    radius: Array, clearance: Array, velocity: Array, speed: Array,
) -> tuple[Array, Array, Array, Index]:  # fmt: skip
    """Return the radii, promise, speed and obstacle (k,) that `Neighbours` has of each pair.

    `radius` is that of rounds; `clearance`, `velocity` (m, 3) and `speed` are those of obstacles.
    """
    k, capsules = len(first), len(link_radius)
    radii, promise, nearer = np.empty(k), np.empty(k), np.zeros(k)
    obstacle = np.empty(k, dtype=np.int64)
    for i in range(k):
        radii[i], promise[i], obstacle[i] = link_radius[first[i]], own_clearance, -1
        if second[i] < capsules:
            radii[i] += link_radius[second[i]]
            continue
        thing = second[i] - capsules
        obstacle[i], promise[i] = thing, clearance[thing]
        if thing < len(radius):
            radii[i] += radius[thing]
        closing = speed[thing]
        for j in range(3):
            closing += normal[i, j] * velocity[thing, j]
        nearer[i] = max(closing, 0.0)
    return radii, promise, nearer, obstacle


@compiled(ARRAY4, ARRAY3, FLAGS, INDEX, INDEX, INDEX, MATRIX, MATRIX)
def _slopes(
    frames: Array, axes: Array, prismatic: Flags, body: Index,
    first: Index, second: Index, normal: Array, place: Array,
) -> Array:  # fmt: skip
    """Return the slopes (k, n) of distances: the normal (k, 3) times the Jacobian of the place.

    A second link's place lies on the same normal, so that only the joints between the two count.
    `frames` (1, n, 3, 4) and `axes` (1, n, 3) are the joints', `body` (c,) the capsules'.
    """
    rows = np.zeros((len(first), axes.shape[1]))
    for k in range(len(first)):
        nx, ny, nz = normal[k, 0], normal[k, 1], normal[k, 2]
        ahead = body[first[k]]
        behind = body[second[k]] if second[k] < len(body) else 0
        for j in range(min(ahead, behind), max(ahead, behind)):
            zx, zy, zz = axes[0, j, 0], axes[0, j, 1], axes[0, j, 2]
            if prismatic[j]:
                slope = nx * zx + ny * zy + nz * zz
            else:
                x = place[k, 0] - frames[0, j, 0, 3]
                y = place[k, 1] - frames[0, j, 1, 3]
                z = place[k, 2] - frames[0, j, 2, 3]
                slope = nx * (zy * z - zz * y) + ny * (zz * x - zx * z) + nz * (zx * y - zy * x)
            rows[k, j] = slope if j < ahead else -slope
    return rows


@compiled(
    ARRAY4, ARRAY3, FLAGS, INDEX, VECTOR,
    INDEX, INDEX, VECTOR, MATRIX, MATRIX, NUMBER,
    VECTOR, VECTOR, MATRIX, VECTOR,
)  # fmt: skip
def _told(
    frames: Array, axes: Array, prismatic: Flags, body: Index, link_radius: Array,
    first: Index, second: Index, distance: Array, normal: Array, place: Array,
    own_clearance: float, radius: Array, clearance: Array, velocity: Array, speed: Array,
) -> tuple[Array, Array, Array, Array, Array, Index, Array]:  # fmt: skip
    """Return radii, gap, promise, rows, speed, obstacle and carried of `Neighbours`.

    By where pairs are nearest, as in `Near`, and what `_surfaces` and `_slopes` need.
    """
    radii, promise, nearer, obstacle = _surfaces(
        normal, first, second, link_radius, own_clearance, radius, clearance, velocity, speed
    )
    rows = _slopes(frames, axes, prismatic, body, first, second, normal, place)
    return radii, distance - radii, promise, rows, nearer, obstacle, np.zeros(len(first))
