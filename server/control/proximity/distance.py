"""Distances of segments from segments and boxes, in closed form.

Things are counted: first the arm's capsules, then the scene's rounds, then its boxes. All are taken
without their radii. The normal points from the second thing to the first: moving the first along it
widens the distance.
"""

import math

import numpy as np

from ..compiled import ARRAY3, ARRAY4, ATTITUDE, COUNT, INDEX, MATRIX, NUMBER, XYZ, compiled
from ..scene import Index
from ..spatial import Array
from .records import MEASURED, OBSTACLES, PAIRS, Near, Obstacles, Pairs

Point = tuple[float, float, float]
Attitude = tuple[Point, Point, Point]

TOUCHING = 1e-9
"""Closer than this there is no direction between nearest points [m]."""

_PARALLEL = 1e-12
"""Sine squared of the angle below which two segments have no one nearest place [1]."""

_TINY = 1e-300


@compiled(MATRIX, COUNT)
def _row(rows: Array, i: int) -> Point:
    return rows[i, 0], rows[i, 1], rows[i, 2]


@compiled(ARRAY4, COUNT, COUNT, COUNT)
def _node(ends: Array, s: int, c: int, e: int) -> Point:
    return ends[s, c, e, 0], ends[s, c, e, 1], ends[s, c, e, 2]


@compiled(ARRAY3, COUNT)
def _attitude(R: Array, i: int) -> Attitude:
    return (
        (R[i, 0, 0], R[i, 0, 1], R[i, 0, 2]),
        (R[i, 1, 0], R[i, 1, 1], R[i, 1, 2]),
        (R[i, 2, 0], R[i, 2, 1], R[i, 2, 2]),
    )


@compiled(XYZ, XYZ)
def _dot(a: Point, b: Point) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled(XYZ, XYZ)
def _minus(a: Point, b: Point) -> Point:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled(XYZ, XYZ, NUMBER)
def _further(a: Point, u: Point, t: float) -> Point:
    return a[0] + t * u[0], a[1] + t * u[1], a[2] + t * u[2]


@compiled(XYZ, NUMBER)
def _times(a: Point, factor: float) -> Point:
    return factor * a[0], factor * a[1], factor * a[2]


@compiled(XYZ, XYZ)
def _cross(a: Point, b: Point) -> Point:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled(XYZ)
def _length(a: Point) -> float:
    return math.sqrt(_dot(a, a))


@compiled(NUMBER)
def _part(t: float) -> float:
    return min(max(t, 0.0), 1.0)


@compiled(ATTITUDE, XYZ)
def _turned(R: Attitude, a: Point) -> Point:
    return _dot(R[0], a), _dot(R[1], a), _dot(R[2], a)


@compiled(ATTITUDE, XYZ)
def _turned_back(R: Attitude, a: Point) -> Point:
    return _further(_further(_times(R[0], a[0]), R[1], a[1]), R[2], a[2])


# --- a segment and a segment -----------------------------------------------------------------


@compiled(XYZ, XYZ, XYZ, XYZ)
def _between_segments(a: Point, u: Point, c: Point, v: Point) -> tuple[float, float]:
    """Return where a + s u and c + t v are nearest: s and t (after Ericson 2005, section 5.1.9)."""
    r = _minus(a, c)
    uu, vv, uv, ur, vr = _dot(u, u), _dot(v, v), _dot(u, v), _dot(u, r), _dot(v, r)
    sine2 = uu * vv - uv * uv
    s = 0.5
    if sine2 > _PARALLEL * uu * vv:
        s = _part((uv * vr - ur * vv) / sine2)
    t = _part((uv * s + vr) / max(vv, _TINY))
    return _part((uv * t - ur) / max(uu, _TINY)), t


@compiled(XYZ, XYZ)
def _across(u: Point, v: Point) -> Point:
    """Return a unit vector across both u and v, or across u where they are parallel."""
    n = _cross(u, v)
    if _length(n) <= TOUCHING * math.sqrt(_dot(u, u) * _dot(v, v)):
        x, y, z = abs(u[0]), abs(u[1]), abs(u[2])
        if x <= y and x <= z:
            n = _cross(u, (1.0, 0.0, 0.0))
        else:
            n = _cross(u, (0.0, 1.0, 0.0)) if y <= z else _cross(u, (0.0, 0.0, 1.0))
    length = _length(n)
    return _times(n, 1.0 / length) if length > 0.0 else (0.0, 0.0, 1.0)


@compiled(XYZ, XYZ, XYZ, XYZ)
def _from_segment(a: Point, u: Point, c: Point, v: Point) -> tuple[float, Point, float]:
    """Return how far a + s u is from c + t v: the distance, the normal, and s."""
    s, t = _between_segments(a, u, c, v)
    out = _minus(_further(a, u, s), _further(c, v, t))
    distance = _length(out)
    return distance, _times(out, 1.0 / distance) if distance >= TOUCHING else _across(u, v), s


@compiled(XYZ, XYZ, XYZ, XYZ)
def _from_segment_at_least(a: Point, u: Point, c: Point, v: Point) -> float:
    middles = _length(_minus(_further(a, u, 0.5), _further(c, v, 0.5)))
    return middles - 0.5 * (_length(u) + _length(v))


# --- a segment and a box, in the axes of the box ---------------------------------------------


@compiled(XYZ, XYZ)
def _beyond(x: Point, half: Point) -> Point:
    """Return how far a point is beyond the sides of a box, along each axis."""
    return (
        x[0] - min(max(x[0], -half[0]), half[0]),
        x[1] - min(max(x[1], -half[1]), half[1]),
        x[2] - min(max(x[2], -half[2]), half[2]),
    )


@compiled(NUMBER, NUMBER, NUMBER)
def _passing(p: float, u: float, side: float) -> float:
    return _part((side - p) / u) if abs(u) > _TINY else 0.0


@compiled(XYZ, XYZ, XYZ)
def _beside_box(p: Point, u: Point, half: Point) -> float:
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
        slope = _dot(_beyond(_further(p, u, t), half), u)
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


@compiled(XYZ, XYZ, XYZ, XYZ)
def _depth(p: Point, u: Point, half: Point, n: Point) -> float:
    """Return how far along a unit vector n a segment is inside a box."""
    size = abs(n[0]) * half[0] + abs(n[1]) * half[1] + abs(n[2]) * half[2]
    return size - min(_dot(n, p), _dot(n, _further(p, u, 1.0)))


@compiled(XYZ, XYZ, XYZ)
def _way_out(p: Point, u: Point, half: Point) -> tuple[float, Point, float]:
    """Return the shortest way out for a segment that cuts a box: separating axes, one by one.

    Its length, its direction, and where on the segment the deepest end is; the middle, where the
    segment lies across the way out.
    """
    x, y, z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    least, way = np.inf, x
    for axis in (x, y, z, _cross(u, x), _cross(u, y), _cross(u, z)):
        length = _length(axis)
        if length > TOUCHING:
            for sign in (1.0, -1.0):
                n = _times(axis, sign / length)
                depth = _depth(p, u, half, n)
                if depth < least:
                    least, way = depth, n
    along = _dot(way, u)
    if abs(along) < TOUCHING:
        return least, way, 0.5
    return least, way, 1.0 if along < 0.0 else 0.0


@compiled(XYZ, XYZ, ATTITUDE, XYZ, XYZ)
def _from_box(
    a: Point, u: Point, R: Attitude, centre: Point, half: Point
) -> tuple[float, Point, float]:
    """Return how far a segment, from a along u, is from a box: as `_from_segment`, in World."""
    p, u = _turned_back(R, _minus(a, centre)), _turned_back(R, u)
    s = _beside_box(p, u, half)
    out = _beyond(_further(p, u, s), half)
    distance = _length(out)
    if distance >= TOUCHING:
        return distance, _turned(R, _times(out, 1.0 / distance)), s
    depth, way, s = _way_out(p, u, half)
    return -depth, _turned(R, way), s


@compiled(XYZ, XYZ, ATTITUDE, XYZ, XYZ)
def _from_box_at_least(a: Point, u: Point, R: Attitude, centre: Point, half: Point) -> float:
    middle = _turned_back(R, _minus(_further(a, u, 0.5), centre))
    distance = _length(_beyond(middle, half)) - 0.5 * _length(u)
    return distance if distance > 0.0 else -np.inf  # how deep it may be inside is not known


# --- many pairs ------------------------------------------------------------------------------


@compiled(ARRAY4, COUNT, COUNT, COUNT, NUMBER, OBSTACLES)
def _pair(
    ends: Array, s: int, first: int, second: int, within: float, obstacles: Obstacles
) -> tuple[float, Point, Point]:
    """Return the distance, normal and place of one pair at one of several postures.

    Of a pair that is not `within` [m], only a lower bound of the distance: no normal, no place.
    """
    start, end, R, centre, half = obstacles
    capsules, normal, part = ends.shape[1], (0.0, 0.0, 0.0), 0.0
    a = _node(ends, s, first, 0)
    u = _minus(_node(ends, s, first, 1), a)
    thing, box = second - capsules, second - capsules - len(start)
    if box >= 0:
        turn, middle, sides = _attitude(R, box), _row(centre, box), _row(half, box)
        distance = _from_box_at_least(a, u, turn, middle, sides)
        if distance < within:
            distance, normal, part = _from_box(a, u, turn, middle, sides)
    else:
        if thing >= 0:
            b, v = _row(start, thing), _minus(_row(end, thing), _row(start, thing))
        else:
            b = _node(ends, s, second, 0)
            v = _minus(_node(ends, s, second, 1), b)
        distance = _from_segment_at_least(a, u, b, v)
        if distance < within:
            distance, normal, part = _from_segment(a, u, b, v)
    return distance, normal, _further(a, u, part)


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
def shortfall(ends: Array, pairs: Pairs, which: Index, least: Array, obstacles: Obstacles) -> float:
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
