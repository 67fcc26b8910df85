"""Rays of one scan as points in the odometry's frame, each placed at its own instant.

Between two instants at which the joints are known (knots) the scanner's pose is interpolated
linearly, matrix by matrix: over one control period that is right to 0.1 mm at 2 m.

Kernels; the rules are in `server/control/compiled.py`.
"""

from typing import NamedTuple

import numpy as np

from ...control.compiled import (
    ARRAY3,
    COUNT,
    FLAGS,
    MARKS,
    MATRIX,
    NUMBER,
    ROW,
    TABLE,
    VECTOR,
    compiled,
)
from ...control.scene import Flags
from ...control.spatial import Array


class Knots(NamedTuple):
    """Poses of the scanner, and the arm's capsules, at k instants; all in the odometry's frame."""

    time_s: Array
    """(k,) [s], rising."""
    R: Array
    """Attitude of the scanner (k, 3, 3): x straight ahead, z along the mirror's axis."""
    p: Array
    """Place of the mirror (k, 3) [m]."""
    ends: Array
    """Both ends of the c capsules (k, 2c, 3) [m]."""


def place(time_s: Array, angle: Array, distance: Array, knots: Knots) -> Array:
    """Return the points (n, 3) [m] of rays at instants (n,) [s]; NaN for rays without an echo.

    Angles (n,) [rad] count from the scanner's right, about z; π/2 is straight ahead.
    """
    points = np.empty((len(time_s), 3))
    _place(time_s, angle, distance, knots.time_s, knots.R, knots.p, points)
    return points


def own_rays(time_s: Array, points: Array, knots: Knots, reach: Array) -> Flags:
    """Return which of n points lie on the arm itself (n,) [bool].

    `reach` (c,) [m] is the radius of each capsule, grown by the margin within which a point cannot
    be told from the arm.
    """
    own = np.zeros(len(time_s), dtype=np.bool_)
    _own(time_s, points, knots.time_s, knots.ends, reach, own)
    return own


@compiled(NUMBER, VECTOR, COUNT)
def _between(time_s: float, knot_s: Array, k: int) -> tuple[int, int, float]:
    """Return the knots before and behind an instant, from knot k on, and its share of the way."""
    last = knot_s.shape[0] - 1
    while k < last - 1 and time_s > knot_s[k + 1]:
        k += 1
    n = min(k + 1, last)
    span = knot_s[n] - knot_s[k]
    return k, n, 0.0 if span <= 0.0 else (time_s - knot_s[k]) / span


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, ARRAY3, MATRIX, TABLE)
def _place(
    time_s: Array,
    angle: Array,
    distance: Array,
    knot_s: Array,
    R: Array,
    p: Array,
    points: Array,
) -> None:
    k = 0
    for i in range(time_s.shape[0]):
        k, n, t = _between(time_s[i], knot_s, k)
        x, y = distance[i] * np.sin(angle[i]), -distance[i] * np.cos(angle[i])
        for a in range(3):
            rx = R[k, a, 0] + t * (R[n, a, 0] - R[k, a, 0])
            ry = R[k, a, 1] + t * (R[n, a, 1] - R[k, a, 1])
            points[i, a] = p[k, a] + t * (p[n, a] - p[k, a]) + rx * x + ry * y


@compiled(VECTOR, MATRIX, VECTOR, ARRAY3, VECTOR, MARKS)
def _own(
    time_s: Array, points: Array, knot_s: Array, ends: Array, reach: Array, own: Flags
) -> None:
    k = 0
    for i in range(time_s.shape[0]):
        k, n, t = _between(time_s[i], knot_s, k)
        for c in range(reach.shape[0]):
            along, length, off = 0.0, 0.0, 0.0
            for a in range(3):
                start = ends[k, 2 * c, a] + t * (ends[n, 2 * c, a] - ends[k, 2 * c, a])
                end = ends[k, 2 * c + 1, a] + t * (ends[n, 2 * c + 1, a] - ends[k, 2 * c + 1, a])
                along += (points[i, a] - start) * (end - start)
                length += (end - start) * (end - start)
            share = 0.0 if length <= 0.0 else min(1.0, max(0.0, along / length))
            for a in range(3):
                start = ends[k, 2 * c, a] + t * (ends[n, 2 * c, a] - ends[k, 2 * c, a])
                end = ends[k, 2 * c + 1, a] + t * (ends[n, 2 * c + 1, a] - ends[k, 2 * c + 1, a])
                way = points[i, a] - start - share * (end - start)
                off += way * way
            if off <= reach[c] * reach[c]:
                own[i] = True
                break


def bridged(angle: Array, distance: Array, own: Flags) -> Array:
    """Return distances (n,) [m] of a scan in which gaps of own rays are bridged; NaN where not.

    A straight line, the least squares of distances *from* it, goes through three neighbours on each
    side of a gap. It is refused where one of them is off by more than `STRAIGHT`, where a neighbour
    has no echo, and where a gap is wider than `WIDEST` (Zhang, section 3: figures 9 and 10).
    """
    found = distance.copy()
    found[own] = np.nan
    _bridge(angle, found.copy(), own, found)
    return found


BESIDE = 3
"""Neighbours of a gap, on each side, that a line goes through [1]."""
STRAIGHT = 0.04
"""A neighbour may be off the line by so much [m]."""
WIDEST = 1.0
"""A gap is at most so wide [m]."""


@compiled(VECTOR, VECTOR, FLAGS, ROW)
def _bridge(angle: Array, distance: Array, own: Flags, found: Array) -> None:
    n, i = distance.shape[0], 0
    while i < n:
        if not own[i]:
            i += 1
            continue
        first = i
        while i < n and own[i]:
            i += 1
        if first < BESIDE or i + BESIDE > n:
            continue
        mx, my, whole = 0.0, 0.0, True
        for j in range(2 * BESIDE):
            r = first - BESIDE + j if j < BESIDE else i + j - BESIDE
            whole = whole and not own[r] and not np.isnan(distance[r])
            mx += distance[r] * np.cos(angle[r]) / (2 * BESIDE)
            my += distance[r] * np.sin(angle[r]) / (2 * BESIDE)
        if not whole:
            continue
        xx, xy, yy = 0.0, 0.0, 0.0
        for j in range(2 * BESIDE):
            r = first - BESIDE + j if j < BESIDE else i + j - BESIDE
            x, y = distance[r] * np.cos(angle[r]) - mx, distance[r] * np.sin(angle[r]) - my
            xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
        turn = 0.5 * np.arctan2(2.0 * xy, xx - yy)  # of the line of least squares
        nx, ny = -np.sin(turn), np.cos(turn)
        c, worst = nx * mx + ny * my, 0.0
        for j in range(2 * BESIDE):
            r = first - BESIDE + j if j < BESIDE else i + j - BESIDE
            x, y = distance[r] * np.cos(angle[r]), distance[r] * np.sin(angle[r])
            worst = max(worst, abs(nx * x + ny * y - c))
        a, b = first - 1, i
        wx = distance[a] * np.cos(angle[a]) - distance[b] * np.cos(angle[b])
        wy = distance[a] * np.sin(angle[a]) - distance[b] * np.sin(angle[b])
        if worst > STRAIGHT or wx * wx + wy * wy > WIDEST * WIDEST:
            continue
        for r in range(first, i):
            onto = nx * np.cos(angle[r]) + ny * np.sin(angle[r])
            if abs(onto) > 1e-6 and c / onto > 0.0:
                found[r] = c / onto
