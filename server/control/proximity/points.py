"""Distances of points from the solid obstacles of a scene: all pairs in one pass.

Sight lines are not solid. Obstacles that move count as far out as they may be now.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from ..compiled import FLAGS, MATRIX, VECTOR, XYZ, compiled
from ..scene import Flags, Scene
from ..spatial import Array
from .distance import Point
from .records import OBSTACLES, Obstacles

TOUCHING: Final = 1e-9
"""Closer than this there is no direction [m]."""


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


@compiled(XYZ, XYZ)
def _dot(a: Point, b: Point) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled(XYZ, XYZ, XYZ)
def _from_axis(x: Point, start: Point, end: Point) -> tuple[float, Point]:
    """Return the distance of a point from a segment, and the normal."""
    away = (x[0] - start[0], x[1] - start[1], x[2] - start[2])
    way = (end[0] - start[0], end[1] - start[1], end[2] - start[2])
    part = min(1.0, max(0.0, _dot(away, way) / max(_dot(way, way), TOUCHING**2)))
    away = (away[0] - part * way[0], away[1] - part * way[1], away[2] - part * way[2])
    distance = math.sqrt(_dot(away, away))
    size = max(distance, TOUCHING)
    return distance, (away[0] / size, away[1] / size, away[2] / size)


@compiled(XYZ, XYZ)
def _from_box(x: Point, half: Point) -> tuple[float, Point]:
    """Return the distance of a point from a box, and the normal, in the axes of the box."""
    beyond = (abs(x[0]) - half[0], abs(x[1]) - half[1], abs(x[2]) - half[2])
    out = (max(beyond[0], 0.0), max(beyond[1], 0.0), max(beyond[2], 0.0))
    distance = math.sqrt(_dot(out, out))
    if distance < TOUCHING:  # inside, where the shortest way out is through the nearest side
        distance = max(beyond[0], beyond[1], beyond[2])
        if beyond[0] == distance:
            out = (1.0, 0.0, 0.0)
        elif beyond[1] == distance:
            out = (0.0, 1.0, 0.0)
        else:
            out = (0.0, 0.0, 1.0)
    size = math.sqrt(_dot(out, out))
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
                _dot(away, (R[o, 0, 0], R[o, 1, 0], R[o, 2, 0])),
                _dot(away, (R[o, 0, 1], R[o, 1, 1], R[o, 2, 1])),
                _dot(away, (R[o, 0, 2], R[o, 1, 2], R[o, 2, 2])),
            )
            d, out = _from_box(local, (half[o, 0], half[o, 1], half[o, 2]))
            distance[s, k] = d - reach[rounds + o]
            for i in range(3):
                normal[s, k, i] = R[o, i, 0] * out[0] + R[o, i, 1] * out[1] + R[o, i, 2] * out[2]
            k += 1
    return distance, normal
