"""Forces and moments of obstacles on the links, their joint torques, and their potential.

A link is a segment that is charged along its length: Scott & Carignan, "A Line-Based Obstacle
Avoidance Technique for Dexterous Manipulator Operations", eqs. 11–16. It meets

- a point, which acts on the whole link in closed form, V = k ∫ ds/r;
- a sight line without radius, charged as well. The paper has it stand for its point closest to
  each link, and reports that this jumps where the two are parallel. Here the link is taken apart
  instead, into the points of a Gauss–Legendre rule, and each meets the whole line in closed form;
- a solid, which acts on the same points from its surface, by the distance to it: V = k / d. The
  nearest point of a convex body moves steadily and the slope of a distance is its normal, so that
  the field is smooth and the torques are the exact slope of the potential.

The closed form loses no precision anywhere. The printed ones are differences of large numbers as
c, the distance from the charge to the link's line, falls to zero. With r1, r2 from the charge to
the link's ends, u along the link, r⊥ the way from the charge to the link's line, L the length and
S = |r1||r2| + r1·r2:

    F  = k [ r⊥ L (|r1| + |r2|) / (|r1||r2| S)  +  u (|r2| − |r1|) / (|r1||r2|) ]
    M1 = k (u × r⊥) L² / (|r2| S)                                    about the link's first end
    V  = k ln[(|r1| + |r2| + L)² / 2S]

Where r1·r2 < 0, S is |r1 × r2|² / (|r1||r2| − r1·r2). On the link itself F grows as 2k/c. A least
distance bounds it: the charge is taken that far aside, in a direction of its own which is square to
all others. So the field stays smooth, and the torques the exact slope of the potential.
"""

import math
from typing import Final

import numpy as np

from ....compiled import (
    ARRAY3,
    COUNT,
    FLAG,
    FLAGS,
    INDEX,
    MATRIX,
    NUMBER,
    ROW,
    VECTOR,
    XYZ,
    compiled,
    record,
)
from ....scene import Flags
from ....spatial import Array
from .geometry import Index, Xyz

Effect = tuple[Xyz, Xyz, float]
"""Effect of one obstacle of strength 1 on a link along u: the force, the t of which u × t is the
moment about the link's first end, and the potential."""

_AT, _WEIGHT = np.polynomial.legendre.leggauss(5)
_RULE: Final = tuple(zip((0.5 * (_AT + 1.0)).tolist(), (0.5 * _WEIGHT).tolist(), strict=True))
"""Where along a link its points are, 0 to 1, and the part of it that each stands for."""
_NONE: Final = 1e-300
"""Avoids division by zero."""
_THIN: Final = 1e-12
"""The same of a segment's squared length [m²], and of a distance with a direction [m]."""
_PARALLEL: Final = 1e-12
"""Squared sine of the angle below which line and link count as parallel."""
_ZERO: Final = (0.0, 0.0, 0.0)


@compiled(MATRIX, COUNT)
def _row(of: Array, i: int) -> Xyz:
    return of[i, 0], of[i, 1], of[i, 2]


@compiled(XYZ, NUMBER, XYZ)
def _plus(a: Xyz, s: float, b: Xyz) -> Xyz:
    """Return a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@compiled(NUMBER, XYZ)
def _times(s: float, a: Xyz) -> Xyz:
    return s * a[0], s * a[1], s * a[2]


@compiled(XYZ, XYZ, XYZ, XYZ)
def _turned(a: Xyz, b: Xyz, c: Xyz, x: Xyz) -> Xyz:
    """Return x in the axes of a box, whose attitude has the rows a, b, c."""
    return _plus(_plus(_times(x[0], a), x[1], b), x[2], c)


@compiled(XYZ, XYZ)
def _dot(a: Xyz, b: Xyz) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled(XYZ, XYZ)
def _cross(a: Xyz, b: Xyz) -> Xyz:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled(XYZ, XYZ)
def direction(p1: Xyz, p2: Xyz) -> tuple[Xyz, float]:
    """Return the unit vector from p1 to p2, and their distance [m]; zero where they coincide."""
    along = _plus(p2, -1.0, p1)
    length = math.sqrt(_dot(along, along))
    return _times(1.0 / max(length, _NONE), along), length


@compiled(XYZ, XYZ, NUMBER, XYZ, NUMBER)
def by_charge(p: Xyz, u: Xyz, length: float, charge: Xyz, least: float) -> Effect:
    """Return what a charge does to a link, that goes from p along u for its `length` [m].

    `least` bounds the distance from below [m]; with 0 there is no bound on the link itself.
    """
    r1 = _plus(p, -1.0, charge)
    # Along the link and square to it, each by itself: nothing cancels later.
    t1 = _dot(r1, u)
    t2 = t1 + length
    across = _plus(r1, -t1, u)
    c2 = _dot(across, across) + max(least * least, _NONE)
    n1, n2 = math.sqrt(t1 * t1 + c2), math.sqrt(t2 * t2 + c2)
    dot, product, total = t1 * t2 + c2, n1 * n2, n1 + n2
    # Where the charge is abreast of the link the sum is a difference: the squares' is exact.
    S = product + dot if dot >= 0.0 else length * length * c2 / max(product - dot, _NONE)
    S = max(S, _NONE)
    w = length / S
    lateral, axial = w * total / product, length * (t1 + t2) / (total * product)
    force = _plus(_times(lateral, across), axial, u)
    return force, _times(w * length / n2, across), math.log((total + length) ** 2 / (2.0 * S))


@compiled(XYZ, XYZ, XYZ, XYZ)
def closest(p1: Xyz, p2: Xyz, start: Xyz, end: Xyz) -> Xyz:
    """Return the point of a segment start–end that is closest to a link p1–p2.

    Where they are parallel no point is closest: the paper takes the middle, with a jump.
    """
    u, v, w = _plus(p2, -1.0, p1), _plus(end, -1.0, start), _plus(p1, -1.0, start)
    uu, vv, uv, uw, vw = _dot(u, u), _dot(v, v), _dot(u, v), _dot(u, w), _dot(v, w)
    square = uu * vv - uv * uv
    if square <= _PARALLEL * uu * vv:
        return _plus(start, 0.5, v)
    # On the link for the whole lines; then on the line for that point, and back, both bounded.
    s = min(1.0, max(0.0, (uv * vw - vv * uw) / square))
    t = min(1.0, max(0.0, (vw + s * uv) / vv))
    s = min(1.0, max(0.0, (t * uv - uw) / uu))
    t = min(1.0, max(0.0, (vw + s * uv) / vv))
    return _plus(start, t, v)


@compiled(XYZ, XYZ, NUMBER, XYZ, XYZ, NUMBER)
def by_line(p: Xyz, u: Xyz, length: float, start: Xyz, end: Xyz, least: float) -> Effect:
    """Return what a line does that is charged all along, with 1 per metre."""
    along, size = direction(start, end)
    force, lever, potential = _ZERO, _ZERO, 0.0
    for part, share in _RULE:
        # What the point does to the line, turned round.
        pull, _, v = by_charge(start, along, size, _plus(p, part * length, u), least)
        force = _plus(force, -share * length, pull)
        lever = _plus(lever, -share * length * part * length, pull)
        potential += share * length * v
    return force, lever, potential


@compiled(NUMBER, NUMBER, NUMBER)
def repelled(distance: float, size: float, least: float) -> tuple[float, float]:
    """Return the force over `size`, and the potential, at a distance from a solid [m].

    The distance counts as d' = d/2 + √(d²/4 + least²): positive, and bounded smoothly.
    """
    root = math.sqrt(0.25 * distance * distance + least * least)
    d = 0.5 * distance + root
    # V = 1/d', and ∂d'/∂d = d' / (d' + least²/d') = d' / 2 root; divided once.
    once = 1.0 / (size * root * d)
    return 0.5 * once, once * size * root


@compiled(XYZ, XYZ, NUMBER, XYZ, XYZ, NUMBER, NUMBER)
def by_round(
    p: Xyz, u: Xyz, length: float, start: Xyz, end: Xyz, radius: float, least: float
) -> Effect:
    """Return what a rounded segment does to a link."""
    along = _plus(end, -1.0, start)
    over = 1.0 / max(_dot(along, along), _THIN)
    force, lever, potential = _ZERO, _ZERO, 0.0
    for part, share in _RULE:
        away = _plus(_plus(p, -1.0, start), part * length, u)
        away = _plus(away, -min(1.0, max(0.0, _dot(away, along) * over)), along)
        size = math.sqrt(_dot(away, away))
        push, v = repelled(size - radius, max(size, _THIN), least)
        charge = share * length
        force = _plus(force, charge * push, away)
        lever = _plus(lever, charge * push * part * length, away)
        potential += charge * v
    return force, lever, potential


@compiled(XYZ, XYZ, NUMBER, XYZ, MATRIX, XYZ, NUMBER)
def by_box(p: Xyz, u: Xyz, length: float, centre: Xyz, R: Array, half: Xyz, least: float) -> Effect:
    """Return what a box with attitude R (3, 3) does to a link.

    Inside, the nearest side counts, its distance negative.
    """
    a, b, c = _row(R, 0), _row(R, 1), _row(R, 2)
    first, along = _turned(a, b, c, _plus(p, -1.0, centre)), _turned(a, b, c, u)
    force, lever, potential = _ZERO, _ZERO, 0.0
    for part, share in _RULE:
        x = _plus(first, part * length, along)
        bx, by, bz = abs(x[0]) - half[0], abs(x[1]) - half[1], abs(x[2]) - half[2]
        out = (max(bx, 0.0), max(by, 0.0), max(bz, 0.0))
        distance = size = math.sqrt(_dot(out, out))
        if size <= 0.0:
            distance, size = max(bx, by, bz), 1.0
            out = (1.0 * (bx >= distance), 1.0 * (by >= distance), 1.0 * (bz >= distance))
        push, v = repelled(distance, size, least)
        charge = share * length
        out = (
            math.copysign(out[0], x[0]),
            math.copysign(out[1], x[1]),
            math.copysign(out[2], x[2]),
        )
        force = _plus(force, charge * push, out)
        lever = _plus(lever, charge * push * part * length, out)
        potential += charge * v
    force = (_dot(a, force), _dot(b, force), _dot(c, force))
    lever = (_dot(a, lever), _dot(b, lever), _dot(c, lever))
    return force, lever, potential


def push(
    screws: Array,
    ends: Array,
    body: Index,
    obstacles: tuple[tuple[Array, Array, Array, Array, Array], Array, Flags],
    k: float,
    k_line: float,
    least: float,
    smooth: bool,
) -> tuple[Array, float]:
    """Return the joint torques (n,) [N·m] and the potential [J] of all links (eqs. 15, 16).

    Joints are `screws` (6, n) about World's origin, links `ends` (m, 2, 3), with `body` (m,) joints
    inboard of each, obstacles `Scene.solids`. Points and solids have the strength k
    [N·m], lines `k_line` per metre [N]; `least` [m] bounds distances from below. Sight lines
    without radius are charged all along where `smooth`, else at their point closest to each link.
    """
    torque = np.zeros(screws.shape[1])
    return torque, _push(screws, ends, body, obstacles, k, k_line, least, smooth, torque)


@compiled(
    *(MATRIX, ARRAY3, INDEX),
    record(record(MATRIX, MATRIX, ARRAY3, MATRIX, MATRIX), VECTOR, FLAGS),
    *(NUMBER, NUMBER, NUMBER, FLAG, ROW),
)
def _push(
    screws: Array,
    ends: Array,
    body: Index,
    obstacles: tuple[tuple[Array, Array, Array, Array, Array], Array, Flags],
    k: float,
    k_line: float,
    least: float,
    smooth: bool,
    torque: Array,
) -> float:
    (start, end, R, centre, half), radius, line = obstacles
    n = screws.shape[1]
    wrench, total = np.zeros((n + 1, 6)), 0.0
    for i in range(len(ends)):
        p1, p2 = _row(ends[i], 0), _row(ends[i], 1)
        u, length = direction(p1, p2)
        if length == 0.0:  # no charge
            continue
        force, lever, potential = _ZERO, _ZERO, 0.0
        for o in range(len(radius)):
            a, b, strength = _row(start, o), _row(end, o), k
            if radius[o] > 0.0 or not (line[o] or a == b):
                f, t, v = by_round(p1, u, length, a, b, radius[o], least)
            elif not line[o]:
                f, t, v = by_charge(p1, u, length, a, least)
            elif smooth:
                f, t, v = by_line(p1, u, length, a, b, least)
                strength = k_line
            else:
                f, t, v = by_charge(p1, u, length, closest(p1, p2, a, b), least)
                strength = k_line
            force, lever = _plus(force, strength, f), _plus(lever, strength, t)
            potential += strength * v
        for o in range(len(centre)):
            f, t, v = by_box(p1, u, length, _row(centre, o), R[o], _row(half, o), least)
            force, lever, potential = _plus(force, k, f), _plus(lever, k, t), potential + k * v
        moment = _plus(_cross(p1, force), 1.0, _cross(u, lever))
        for axis in range(3):
            wrench[body[i], axis] += force[axis]
            wrench[body[i], 3 + axis] += moment[axis]
        total += potential
    for j in range(n - 1, -1, -1):  # a link's wrench acts on the joints inboard of it
        for row in range(6):
            wrench[j, row] += wrench[j + 1, row]
            torque[j] += screws[row, j] * wrench[j + 1, row]
    return total
