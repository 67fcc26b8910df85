"""The part of a backbone inside tunnels: circular arcs and straights, one after the other.

Inside, the curve is where the tunnel is: its curvature is a travelling wave κ(s − s1) (Chirikjian &
Burdick, eqs. 7 and 15). A segment turns about an axis that is fixed in its own frame, whose x axis
is the tangent: `bend` about z (to the left), `climb` about −y (upward). There is no chart, so that
a tunnel may climb straight up, where the paper's quasi-torsion is singular (T = ±π/2).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from ...compiled import ARRAY3, INDEX, MATRIX, NUMBER, TABLE, VECTOR, compiled, record
from ...scene import Index
from ...spatial import Array, Pose, rotation_exp

ARCS = record(VECTOR, ARRAY3, VECTOR)
"""`Arcs` as kernels take it."""


class Turn(NamedTuple):
    """One segment of a tunnel: how long it is, and how far it turns."""

    length: float
    """[m]"""
    bend: float = 0.0
    """To the left, about the segment's own z [rad]."""
    climb: float = 0.0
    """Upward, about its own −y [rad]."""


class Arcs(NamedTuple):
    """k arcs one after the other, in World; a straight line goes on from the last."""

    starts: Array
    """Arc length from the entrance to each, and to the end of the last (k + 1,) [m]."""
    frames: Array
    """Of each, and of the line after the last: start, tangent there, and where it turns to
    (k + 1, 3, 3): rows."""
    curvature: Array
    """(k + 1,), 0 of a straight [1/m]."""

    @classmethod
    def from_entrance(cls, T_world_entrance: Pose, turns: Sequence[Turn]) -> Self:
        """Lay segments one after the other from the entrance on."""
        T = T_world_entrance
        starts, frames, curvature = [0.0], [], []
        for length, bend, climb in turns:
            angle = math.hypot(bend, climb)
            inward = np.array([0.0, bend, climb]) / angle if angle else np.array([0.0, 1.0, 0.0])
            frames.append(np.stack((T.p, T.R[:, 0], T.R @ inward)))
            curvature.append(angle / length)
            starts.append(starts[-1] + length)
            way = _point(length, curvature[-1])
            p = T.p + way[0] * T.R[:, 0] + way[1] * (T.R @ inward)
            T = Pose(T.R @ rotation_exp(np.array([0.0, -climb, bend])), p)
        frames.append(np.stack((T.p, T.R[:, 0], T.R[:, 1])))
        return cls(np.array(starts), np.array(frames), np.array([*curvature, 0.0]))

    @classmethod
    def of_all(cls, each: "Sequence[Arcs]") -> Self:
        """Return arcs that begin where those before end."""
        ends = np.cumsum([arcs.length for arcs in each])
        begins = np.concatenate(([0.0], ends[:-1]))
        starts = [arcs.starts[:-1] + s for arcs, s in zip(each, begins, strict=True)]
        return cls(
            np.concatenate((*starts, ends[-1:])),
            np.concatenate((*(arcs.frames[:-1] for arcs in each), each[-1].frames[-1:])),
            np.concatenate((*(arcs.curvature[:-1] for arcs in each), [0.0])),
        )

    @property
    def end(self) -> Pose:
        """Where the last arc ends: x along the tangent, y to where a bend to the left turns."""
        p, x, y = self.frames[-1]
        return Pose(np.column_stack((x, y, np.cross(x, y))), p)

    @property
    def length(self) -> float:
        """Of all arcs together [m]."""
        return float(self.starts[-1])

    def at(self, depths: Array) -> tuple[Array, Array]:
        """Return points (m, 3) [m] and tangents (m, 3) at arc lengths (m,) from the entrance [m].

        Before it and after the last arc the curve is straight.
        """
        points, tangents = np.empty((len(depths), 3)), np.empty((len(depths), 3))
        _at(self[:], depths, points, tangents)
        return points, tangents


def _point(length: float, curvature: float) -> tuple[float, float]:
    """Return how far an arc goes along its first tangent, and aside [m]."""
    if abs(curvature * length) < 1e-9:
        return length, 0.5 * curvature * length * length
    angle = curvature * length
    return math.sin(angle) / curvature, (1.0 - math.cos(angle)) / curvature


@compiled(ARCS, VECTOR, TABLE, TABLE)
def _at(arcs: tuple[Array, Array, Array], depths: Array, points: Array, tangents: Array) -> None:
    """Write points and tangents (m, 3) at arc lengths (m,) from the entrance [m]."""
    starts, frames, curvature = arcs
    last = len(curvature) - 1
    for m in range(len(depths)):
        k = 0
        while k < last and depths[m] >= starts[k + 1]:
            k += 1
        way, c = depths[m] - starts[k], curvature[k]
        if depths[m] < 0.0:
            c = 0.0
        along, aside, cosine, sine = way, 0.0, 1.0, 0.0
        if c * way > 1e-9:
            cosine, sine = math.cos(c * way), math.sin(c * way)
            along, aside = sine / c, (1.0 - cosine) / c
        for i in range(3):
            t, n = frames[k, 1, i], frames[k, 2, i]
            points[m, i] = frames[k, 0, i] + along * t + aside * n
            tangents[m, i] = cosine * t + sine * n


@compiled(ARCS, NUMBER, NUMBER, VECTOR)
def _foot(
    arcs: tuple[Array, Array, Array], low: float, high: float, point: Array
) -> tuple[float, float]:
    """Return the least distance of a point (3,) to the curve between two arc lengths, and where.

    All in [m]. Arc by arc: the foot on a circle is under the point, at an end where it is off it.
    """
    starts, frames, curvature = arcs
    least, where = math.inf, low
    last = len(curvature) - 1
    for k in range(last + 1):
        begin = -math.inf if k == 0 else starts[k]
        begin, end = max(low, begin), high if k == last else min(high, starts[k + 1])
        if begin > end:
            continue
        x = y = square = 0.0
        for i in range(3):
            d = point[i] - frames[k, 0, i]
            x += d * frames[k, 1, i]
            y += d * frames[k, 2, i]
            square += d * d
        c = curvature[k]
        if c > 0.0:
            angle = math.atan2(c * x, 1.0 - c * y)
            middle = 0.5 * c * (begin + end - 2.0 * starts[k])
            angle -= 2.0 * math.pi * math.floor((angle - middle) / (2.0 * math.pi) + 0.5)
            way = starts[k] + angle / c
        else:
            way = starts[k] + x
        way = min(max(way, begin), end)
        along, aside = way - starts[k], 0.0
        if c * along > 1e-9:
            along, aside = math.sin(c * along) / c, (1.0 - math.cos(c * along)) / c
        off = math.sqrt(max(0.0, square - x * x - y * y + (x - along) ** 2 + (y - aside) ** 2))
        if off < least:
            least, where = off, way
    return least, where


@compiled(ARCS, MATRIX, VECTOR, NUMBER, INDEX)
def off_centre(
    arcs: tuple[Array, Array, Array],
    points: Array,
    depths: Array,
    window: float,
    upto: Index,
) -> tuple[float, int]:
    """Return how far the farthest of points (m, 3) is off the tunnel's centre line [m], and which.

    A point is looked for within `window` of where it ought to be, its arc length from the entrance
    (m,): another passage of the same tunnel may run beside it. Points before the entrance, or
    beyond the end of arc `upto` (1,), are in the open, and do not count; −1 where none does.
    """
    starts = arcs[0]
    most, which = 0.0, -1
    for m in range(len(points)):
        low, high = depths[m] - window, depths[m] + window
        if high < 0.0 or low > starts[upto[0]]:
            continue
        off, where = _foot(arcs, low, high, points[m])
        if 0.0 <= where <= starts[upto[0]] and off > most:
            most, which = off, m
    return most, which


@compiled(ARCS, ARRAY3, VECTOR, NUMBER, INDEX)
def links_off_centre(
    arcs: tuple[Array, Array, Array],
    points: Array,
    depths: Array,
    window: float,
    upto: Index,
) -> float:
    """Return how far links' ends and middles are off the centre line at most [m], as `off_centre`.

    Of postures whose points are (s, n + 1, 3), the arc lengths of which are `depths` (n + 1,).
    """
    n = len(depths)
    both, at = np.empty((2 * n - 1, 3)), np.empty(2 * n - 1)
    for i in range(n):
        at[i] = depths[i]
        if i > 0:
            at[n + i - 1] = 0.5 * (depths[i - 1] + depths[i])
    most = 0.0
    for s in range(len(points)):
        for i in range(n):
            for k in range(3):
                both[i, k] = points[s, i, k]
                if i > 0:
                    both[n + i - 1, k] = 0.5 * (points[s, i - 1, k] + points[s, i, k])
        most = max(most, off_centre(arcs, both, at, window, upto)[0])
    return most
