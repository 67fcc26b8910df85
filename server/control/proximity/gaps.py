"""Gaps of near pairs: radii and promises of their surfaces, and slopes in the joint angles."""

from typing import NamedTuple

import numpy as np

from ..compiled import MATRIX, NUMBER, VECTOR, compiled
from ..scene import Index
from ..spatial import Array
from .records import BODIES, MOTION, NEAREST, PAIRS, PLACED, Bodies, Motion, Near, Pairs, Placed


class Nearest(NamedTuple):
    """Where k pairs of things are nearest."""

    distance: Array
    """(k,) [m]; below zero for a segment inside a box: how far it has to come out."""
    normal: Array
    """(k, 3)."""
    place: Array
    """On the first thing (k, 3) [m]."""


@compiled(MATRIX, PAIRS, VECTOR, NUMBER, VECTOR, MOTION)
def _surfaces(
    normal: Array, pairs: Pairs, link_radius: Array, own_clearance: float, radius: Array,
    motion: Motion,
) -> tuple[Array, Array, Array, Index]:  # fmt: skip
    """Return radii, promise, speed and obstacle (k,) of `NearPairs`; `radius` is that of rounds."""
    (first, second), (clearance, velocity, speed) = pairs, motion
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


@compiled(PLACED, BODIES, PAIRS, MATRIX, MATRIX)
def slopes(placed: Placed, bodies: Bodies, pairs: Pairs, normal: Array, place: Array) -> Array:
    """Return the slopes (k, n) of distances: the normal (k, 3) times the Jacobian of the place.

    A second link's place lies on the same normal: joints that move both change no distance.
    """
    (_, frames, axes), (_, moves, prismatic), (first, second) = placed, bodies, pairs
    rows = np.zeros((len(first), axes.shape[1]))
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
    return rows


@compiled(
    PLACED, BODIES, PAIRS, NEAREST, NUMBER, VECTOR,
    MOTION,
)  # fmt: skip
def described(
    placed: Placed, bodies: Bodies, pairs: Pairs,
    near: Near, own_clearance: float, radius: Array, motion: Motion,
) -> tuple[Array, Array, Array, Array, Array, Index, Array]:  # fmt: skip
    """Return radii, gap, promise, rows, speed, obstacle and carried of `NearPairs`.

    `placed` and `near` are the records of those names; `radius` (m,) is that of rounds [m].
    """
    distance, normal, place = near
    radii, promise, nearer, obstacle = _surfaces(
        normal, pairs, bodies[0], own_clearance, radius, motion
    )
    rows = slopes(placed, bodies, pairs, normal, place)
    return radii, distance - radii, promise, rows, nearer, obstacle, np.zeros(len(distance))
