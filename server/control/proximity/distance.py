"""Distances in closed form: of segments and points from segments and boxes, and their gaps."""

import math
from typing import Final, NamedTuple

import numpy as np

from ..compiled import (
    ARRAY3,
    ARRAY4,
    COUNTS,
    FLAGS,
    FLAGS2,
    INDEX,
    MATRIX,
    NUMBER,
    ROW,
    TABLE,
    VECTOR,
    compiled,
    inner_kernel,
    record,
)
from ..linalg import (
    Rows,
    Vector,
    cross,
    dot,
    further,
    minus,
    norm,
    row_of,
    times,
    turned,
    turned_back,
)
from ..scene import Flags, Index, Scene
from ..spatial import Array

# --- Arrays that belong together, as the kernels of this room take them: plain tuples in one order

PlacedArrays = tuple[Array, Array, Array]
PLACED: Final = record(ARRAY4, ARRAY4, ARRAY3)
"""`capsules.Placed`."""

Bodies = tuple[Array, Flags, Flags]
BODIES: Final = record(VECTOR, FLAGS2, FLAGS)
"""Radii of capsules (c,) [m], which joints move them (c, n), which joints are prismatic (n,)."""

Pairs = tuple[Index, Index]
PAIRS: Final = record(INDEX, INDEX)
"""Of k pairs: the capsule `first` (k,) and the thing `second` (k,), as `distance.py` counts it."""

Obstacles = tuple[Array, Array, Array, Array, Array]
OBSTACLES: Final = record(MATRIX, MATRIX, ARRAY3, MATRIX, MATRIX)
"""`Scene.segments`: ends (m, 3) of rounds; attitudes (b, 3, 3), centres and half sides (b, 3)."""

Near = tuple[Array, Array, Array]
NEAREST: Final = record(VECTOR, MATRIX, MATRIX)
"""`gaps.Nearest`."""
MEASURED: Final = record(ROW, TABLE, TABLE)
"""The same, to be filled in."""

Motion = tuple[Array, Array, Array, Array]
MOTION: Final = record(VECTOR, MATRIX, VECTOR, MATRIX)
"""`clearance`, `velocity`, `speed` and `observed` of a `Scene`."""


# --- Distances of segments from segments and boxes, in closed form --------------------------------
#
# Things are counted: first the arm's capsules, then the scene's rounds, then its boxes. All are
# taken without their radii. The normal points from the second thing to the first: moving the
# first along it widens the distance.

TOUCHING = 1e-9
"""Closer than this there is no direction between nearest points [m]."""

_PARALLEL = 1e-12
"""Sine squared of the angle below which two segments have no one nearest place [1]."""

_TINY = 1e-300


@inner_kernel
def _node(ends: Array, s: int, c: int, e: int) -> Vector:
    return ends[s, c, e, 0], ends[s, c, e, 1], ends[s, c, e, 2]


@inner_kernel
def _attitude(R: Array, i: int) -> Rows:
    return (
        (R[i, 0, 0], R[i, 0, 1], R[i, 0, 2]),
        (R[i, 1, 0], R[i, 1, 1], R[i, 1, 2]),
        (R[i, 2, 0], R[i, 2, 1], R[i, 2, 2]),
    )


@inner_kernel
def _part(t: float) -> float:
    return min(max(t, 0.0), 1.0)


# --- a segment and a segment -----------------------------------------------------------------


@inner_kernel
def _between_segments(a: Vector, u: Vector, c: Vector, v: Vector) -> tuple[float, float]:
    """Return where a + s u and c + t v are nearest: s and t (after Ericson 2005, section 5.1.9)."""
    r = minus(a, c)
    uu, vv, uv, ur, vr = dot(u, u), dot(v, v), dot(u, v), dot(u, r), dot(v, r)
    sine2 = uu * vv - uv * uv
    s = 0.5
    if sine2 > _PARALLEL * uu * vv:
        s = _part((uv * vr - ur * vv) / sine2)
    t = _part((uv * s + vr) / max(vv, _TINY))
    return _part((uv * t - ur) / max(uu, _TINY)), t


@inner_kernel
def _across(u: Vector, v: Vector) -> Vector:
    """Return a unit vector across both u and v, or across u where they are parallel."""
    n = cross(u, v)
    if norm(n) <= TOUCHING * math.sqrt(dot(u, u) * dot(v, v)):
        x, y, z = abs(u[0]), abs(u[1]), abs(u[2])
        if x <= y and x <= z:
            n = cross(u, (1.0, 0.0, 0.0))
        else:
            n = cross(u, (0.0, 1.0, 0.0)) if y <= z else cross(u, (0.0, 0.0, 1.0))
    length = norm(n)
    return times(1.0 / length, n) if length > 0.0 else (0.0, 0.0, 1.0)


@inner_kernel
def _from_segment(a: Vector, u: Vector, c: Vector, v: Vector) -> tuple[float, Vector, float]:
    """Return how far a + s u is from c + t v: the distance, the normal, and s."""
    s, t = _between_segments(a, u, c, v)
    out = minus(further(a, s, u), further(c, t, v))
    distance = norm(out)
    return distance, times(1.0 / distance, out) if distance >= TOUCHING else _across(u, v), s


@inner_kernel
def _from_segment_at_least(a: Vector, u: Vector, c: Vector, v: Vector) -> float:
    middles = norm(minus(further(a, 0.5, u), further(c, 0.5, v)))
    return middles - 0.5 * (norm(u) + norm(v))


# --- a segment and a box, in the axes of the box ---------------------------------------------


@inner_kernel
def _beyond(x: Vector, half: Vector) -> Vector:
    """Return how far a point is beyond the sides of a box, along each axis."""
    return (
        x[0] - min(max(x[0], -half[0]), half[0]),
        x[1] - min(max(x[1], -half[1]), half[1]),
        x[2] - min(max(x[2], -half[2]), half[2]),
    )


@inner_kernel
def _passing(p: float, u: float, side: float) -> float:
    return _part((side - p) / u) if abs(u) > _TINY else 0.0


@inner_kernel
def _beside_box(p: Vector, u: Vector, half: Vector) -> float:
    """Return t, 0 to 1, where p + t u is nearest to a box; the middle of many such places.

    The squared distance is convex, with a slope that is linear between the places where the segment
    passes the planes of the sides.
    """
    last, first, level = 0.0, 1.0, 0.0
    down, up = -np.inf, np.inf
    for t in (
        0.0, _passing(p[0], u[0], -half[0]), _passing(p[0], u[0], half[0]),
        _passing(p[1], u[1], -half[1]), _passing(p[1], u[1], half[1]),
        _passing(p[2], u[2], -half[2]), _passing(p[2], u[2], half[2]), 1.0,
    ):  # fmt: skip
        slope = dot(_beyond(further(p, t, u), half), u)
        if slope < 0.0:
            last, down = max(last, t), max(down, slope)
        else:
            first, up = min(first, t), min(up, slope)
        if slope <= 0.0:
            level = max(level, t)
    if up == 0.0:
        return 0.5 * (first + level)
    if down == -np.inf:
        return first
    return last + (first - last) / (1.0 - up / down)


@inner_kernel
def _depth(p: Vector, u: Vector, half: Vector, n: Vector) -> float:
    """Return how far along a unit vector n a segment is inside a box."""
    size = abs(n[0]) * half[0] + abs(n[1]) * half[1] + abs(n[2]) * half[2]
    return size - min(dot(n, p), dot(n, further(p, 1.0, u)))


@inner_kernel
def _way_out(p: Vector, u: Vector, half: Vector) -> tuple[float, Vector, float]:
    """Return the shortest way out for a segment that cuts a box: separating axes, one by one.

    Its length, its direction, and where on the segment the deepest end is; the middle, where the
    segment lies across the way out.
    """
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    least, way = np.inf, x
    for axis in (x, y, z, cross(u, x), cross(u, y), cross(u, z)):
        length = norm(axis)
        if length > TOUCHING:
            for sign in (1.0, -1.0):
                n = times(sign / length, axis)
                depth = _depth(p, u, half, n)
                if depth < least:
                    least, way = depth, n
    along = dot(way, u)
    if abs(along) < TOUCHING:
        return least, way, 0.5
    return least, way, 1.0 if along < 0.0 else 0.0


@inner_kernel
def _from_box(
    a: Vector, u: Vector, R: Rows, centre: Vector, half: Vector
) -> tuple[float, Vector, float]:
    """Return how far a segment, from a along u, is from a box: as `_from_segment`, in World."""
    p, u = turned_back(R, minus(a, centre)), turned_back(R, u)
    s = _beside_box(p, u, half)
    out = _beyond(further(p, s, u), half)
    distance = norm(out)
    if distance >= TOUCHING:
        return distance, turned(R, times(1.0 / distance, out)), s
    depth, way, s = _way_out(p, u, half)
    return -depth, turned(R, way), s


@inner_kernel
def _from_box_at_least(a: Vector, u: Vector, R: Rows, centre: Vector, half: Vector) -> float:
    middle = turned_back(R, minus(further(a, 0.5, u), centre))
    distance = norm(_beyond(middle, half)) - 0.5 * norm(u)
    return distance if distance > 0.0 else -np.inf  # how deep it may be inside is not known


# --- many pairs ------------------------------------------------------------------------------


@inner_kernel
def _pair(
    ends: Array, s: int, first: int, second: int, within: float, obstacles: Obstacles
) -> tuple[float, Vector, Vector]:
    """Return the distance, normal and place of one pair at one of several postures.

    Of a pair that is not `within` [m], only a lower bound of the distance: no normal, no place.
    """
    start, end, R, centre, half = obstacles
    capsules, normal, part = ends.shape[1], (0.0, 0.0, 0.0), 0.0
    a = _node(ends, s, first, 0)
    u = minus(_node(ends, s, first, 1), a)
    thing, box = second - capsules, second - capsules - len(start)
    if box >= 0:
        turn, middle, sides = _attitude(R, box), row_of(centre, box), row_of(half, box)
        distance = _from_box_at_least(a, u, turn, middle, sides)
        if distance < within:
            distance, normal, part = _from_box(a, u, turn, middle, sides)
    else:
        if thing >= 0:
            b, v = row_of(start, thing), minus(row_of(end, thing), row_of(start, thing))
        else:
            b = _node(ends, s, second, 0)
            v = minus(_node(ends, s, second, 1), b)
        distance = _from_segment_at_least(a, u, b, v)
        if distance < within:
            distance, normal, part = _from_segment(a, u, b, v)
    return distance, normal, further(a, part, u)


def measured(ends: Array, pairs: Pairs, obstacles: Obstacles) -> tuple[Array, Array, Array]:
    """Return distances (k,), normals and places (k, 3), as in `Nearest`, at the first posture.

    `ends` (s, c, 2, 3) are the capsules' at s postures in World [m].
    """
    k = len(pairs[0])
    found = np.empty(k), np.empty((k, 3)), np.empty((k, 3))
    _measure(ends, pairs, obstacles, found)
    return found


@compiled(ARRAY4, PAIRS, OBSTACLES, MEASURED)
def _measure(ends: Array, pairs: Pairs, obstacles: Obstacles, near: Near) -> None:
    (first, second), (distance, normal, place) = pairs, near
    for i in range(len(first)):
        distance[i], normal[i], place[i] = _pair(ends, 0, first[i], second[i], np.inf, obstacles)


@compiled(ARRAY4, PAIRS, INDEX, MATRIX, OBSTACLES)
def violation(ends: Array, pairs: Pairs, which: Index, least: Array, obstacles: Obstacles) -> float:
    """Return the greatest shortfall of distances below `least` (s, p) [m]; 0 where all are kept.

    Of the pairs `which` (p,), at s postures, at which capsules have `ends` (s, c, 2, 3).
    """
    (first, second), worst = pairs, 0.0
    for s in range(len(ends)):
        for i in range(len(which)):
            a, b, within = first[which[i]], second[which[i]], least[s, i] - worst
            distance = _pair(ends, s, a, b, within, obstacles)[0]
            worst = max(worst, least[s, i] - distance)
    return worst


# --- Distances of points from the solid obstacles of a scene: all pairs in one pass ---------------
#
# Sight lines are not solid. Obstacles that move count as far out as they may be now.


class Apart(NamedTuple):
    """Distances of s points from k obstacles."""

    distance: Array
    """To the surfaces (s, k) [m]; below zero inside."""
    normal: Array
    """Away from them (s, k, 3): the slope of the distance; zero on the axis of a round one."""


def apart(points: Array, scene: Scene) -> Apart:
    """Return distances of points (s, 3) [m] in World from each solid obstacle."""
    # Where nothing moves, no speed is the reach.
    reach = scene.reach(0.0) if scene.moves else scene.speed
    return Apart(*_apart(points, scene.segments, scene.rounds.radius, scene.rounds.line, reach))


@inner_kernel
def _from_axis(x: Vector, start: Vector, end: Vector) -> tuple[float, Vector]:
    """Return the distance of a point from a segment, and the normal."""
    away = (x[0] - start[0], x[1] - start[1], x[2] - start[2])
    way = (end[0] - start[0], end[1] - start[1], end[2] - start[2])
    part = min(1.0, max(0.0, dot(away, way) / max(dot(way, way), TOUCHING**2)))
    away = (away[0] - part * way[0], away[1] - part * way[1], away[2] - part * way[2])
    distance = math.sqrt(dot(away, away))
    size = max(distance, TOUCHING)
    return distance, (away[0] / size, away[1] / size, away[2] / size)


@inner_kernel
def _point_from_box(x: Vector, half: Vector) -> tuple[float, Vector]:
    """Return the distance of a point from a box, and the normal, in the axes of the box."""
    beyond = (abs(x[0]) - half[0], abs(x[1]) - half[1], abs(x[2]) - half[2])
    out = (max(beyond[0], 0.0), max(beyond[1], 0.0), max(beyond[2], 0.0))
    distance = math.sqrt(dot(out, out))
    if distance < TOUCHING:  # inside, where the shortest way out is through the nearest side
        distance = max(beyond[0], beyond[1], beyond[2])
        if beyond[0] == distance:
            out = (1.0, 0.0, 0.0)
        elif beyond[1] == distance:
            out = (0.0, 1.0, 0.0)
        else:
            out = (0.0, 0.0, 1.0)
    size = math.sqrt(dot(out, out))
    return distance, (
        math.copysign(out[0] / size, x[0]),
        math.copysign(out[1] / size, x[1]),
        math.copysign(out[2] / size, x[2]),
    )


@compiled(MATRIX, OBSTACLES, VECTOR, FLAGS, VECTOR)
def _apart(
    points: Array,
    obstacles: Obstacles,
    radius: Array,
    line: Flags,
    reach: Array,
) -> tuple[Array, Array]:
    """Return distances and normals of points; all but `reach` (m + b,) [m] as in `Scene`."""
    start, end, R, centre, half = obstacles
    rounds, solid = len(radius), len(radius) + len(centre) - line.sum()
    distance, normal = np.empty((len(points), solid)), np.empty((len(points), solid, 3))
    for s in range(len(points)):
        x = (points[s, 0], points[s, 1], points[s, 2])
        k = 0
        for o in range(rounds):
            if line[o]:
                continue
            a, b = (start[o, 0], start[o, 1], start[o, 2]), (end[o, 0], end[o, 1], end[o, 2])
            d, away = _from_axis(x, a, b)
            distance[s, k] = d - radius[o] - reach[o]
            for i in range(3):
                normal[s, k, i] = away[i]
            k += 1
        for o in range(len(centre)):
            away = (x[0] - centre[o, 0], x[1] - centre[o, 1], x[2] - centre[o, 2])
            local = (
                dot(away, (R[o, 0, 0], R[o, 1, 0], R[o, 2, 0])),
                dot(away, (R[o, 0, 1], R[o, 1, 1], R[o, 2, 1])),
                dot(away, (R[o, 0, 2], R[o, 1, 2], R[o, 2, 2])),
            )
            d, out = _point_from_box(local, (half[o, 0], half[o, 1], half[o, 2]))
            distance[s, k] = d - reach[rounds + o]
            for i in range(3):
                normal[s, k, i] = R[o, i, 0] * out[0] + R[o, i, 1] * out[1] + R[o, i, 2] * out[2]
            k += 1
    return distance, normal


# --- Gaps of near pairs: radii and promises of their surfaces, and slopes in the joint angles -----


class NearestPoints(NamedTuple):
    """Where k pairs of things are nearest."""

    distance: Array
    """(k,) [m]; below zero for a segment inside a box: how far it has to come out."""
    normal: Array
    """(k, 3)."""
    place: Array
    """On the first thing (k, 3) [m]."""


@inner_kernel
def _face(
    normal: Array, pairs: Pairs, link_radius: Array, own_clearance: float, radius: Array,
    motion: Motion, radii: Array, promise: Array, nearer: Array, comes: Array, obstacle: Index,
) -> None:  # fmt: skip
    """Write radii, promise, speed, approach and obstacle (k,) of `NearPairs`.

    `radius` is that of rounds. Both speeds are zero before.
    """
    (first, second), (clearance, velocity, speed, observed) = pairs, motion
    capsules = len(link_radius)
    for i in range(len(first)):
        radii[i], promise[i], obstacle[i] = link_radius[first[i]], own_clearance, -1
        if second[i] < capsules:
            radii[i] += link_radius[second[i]]
            continue
        thing = second[i] - capsules
        obstacle[i], promise[i] = thing, clearance[thing]
        if thing < len(radius):
            radii[i] += radius[thing]
        closing, approach = speed[thing], 0.0
        for j in range(3):
            closing += normal[i, j] * velocity[thing, j]
            approach += normal[i, j] * observed[thing, j]
        nearer[i], comes[i] = max(closing, 0.0), max(approach, 0.0)


def slopes(
    placed: PlacedArrays, bodies: Bodies, pairs: Pairs, normal: Array, place: Array
) -> Array:
    """Return the slopes (k, n) of distances: the normal (k, 3) times the Jacobian of the place.

    A second link's place lies on the same normal: joints that move both change no distance.
    """
    rows = np.zeros((len(pairs[0]), placed[2].shape[1]))
    _slope(placed, bodies, pairs, normal, place, rows)
    return rows


@compiled(PLACED, BODIES, PAIRS, MATRIX, MATRIX, TABLE)
def _slope(
    placed: PlacedArrays, bodies: Bodies, pairs: Pairs, normal: Array, place: Array, rows: Array
) -> None:
    (_, frames, axes), (_, moves, prismatic), (first, second) = placed, bodies, pairs
    for k in range(len(first)):
        nx, ny, nz = normal[k, 0], normal[k, 1], normal[k, 2]
        other = second[k] if second[k] < len(moves) else -1
        for j in range(axes.shape[1]):
            ahead = moves[first[k], j]
            if ahead == (other >= 0 and moves[other, j]):
                continue
            zx, zy, zz = axes[0, j, 0], axes[0, j, 1], axes[0, j, 2]
            if prismatic[j]:
                slope = nx * zx + ny * zy + nz * zz
            else:
                x = place[k, 0] - frames[0, j, 0, 3]
                y = place[k, 1] - frames[0, j, 1, 3]
                z = place[k, 2] - frames[0, j, 2, 3]
                slope = nx * (zy * z - zz * y) + ny * (zz * x - zx * z) + nz * (zx * y - zy * x)
            rows[k, j] = slope if ahead else -slope


def described(
    placed: PlacedArrays, bodies: Bodies, pairs: Pairs,
    near: Near, own_clearance: float, radius: Array, motion: Motion,
) -> tuple[Array, Array, Array, Array, Array, Array, Index, Array]:  # fmt: skip
    """Return radii, gap, promise, rows, speed, approach, obstacle and carried of `NearPairs`.

    `placed` and `near` are the records of those names; `radius` (m,) is that of rounds [m].
    """
    k = len(pairs[0])
    radii, gap, promise = np.empty(k), np.empty(k), np.empty(k)
    speed, approach = np.zeros(k), np.zeros(k)
    rows, obstacle = np.zeros((k, placed[2].shape[1])), np.empty(k, dtype=np.int64)
    _describe(
        placed, bodies, pairs, near, own_clearance, radius, motion,
        radii, gap, promise, rows, speed, approach, obstacle,
    )  # fmt: skip
    return radii, gap, promise, rows, speed, approach, obstacle, np.zeros(k)


@compiled(
    PLACED, BODIES, PAIRS, NEAREST, NUMBER, VECTOR, MOTION,
    ROW, ROW, ROW, TABLE, ROW, ROW, COUNTS,
)  # fmt: skip
def _describe(
    placed: PlacedArrays, bodies: Bodies, pairs: Pairs,
    near: Near, own_clearance: float, radius: Array, motion: Motion,
    radii: Array, gap: Array, promise: Array, rows: Array, speed: Array, approach: Array,
    obstacle: Index,
) -> None:  # fmt: skip
    distance, normal, place = near
    _face(
        normal, pairs, bodies[0], own_clearance, radius, motion,
        radii, promise, speed, approach, obstacle,
    )  # fmt: skip
    _slope(placed, bodies, pairs, normal, place, rows)
    for i in range(len(distance)):
        gap[i] = distance[i] - radii[i]
