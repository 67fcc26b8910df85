"""Gaps of near pairs: radii and promises of their surfaces, and slopes in the joint angles."""

from typing import NamedTuple

import numpy as np

from ..compiled import COUNTS, MATRIX, NUMBER, ROW, TABLE, VECTOR, compiled
from ..scene import Index
from ..spatial import Array
from .records import BODIES, MOTION, NEAREST, PAIRS, PLACED, Bodies, Motion, Near, Pairs, Placed


class NearestPoints(NamedTuple):
    """Where k pairs of things are nearest."""

    distance: Array
    """(k,) [m]; below zero for a segment inside a box: how far it has to come out."""
    normal: Array
    """(k, 3)."""
    place: Array
    """On the first thing (k, 3) [m]."""


@compiled(MATRIX, PAIRS, VECTOR, NUMBER, VECTOR, MOTION, ROW, ROW, ROW, ROW, COUNTS)
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


def slopes(placed: Placed, bodies: Bodies, pairs: Pairs, normal: Array, place: Array) -> Array:
    """Return the slopes (k, n) of distances: the normal (k, 3) times the Jacobian of the place.

    A second link's place lies on the same normal: joints that move both change no distance.
    """
    rows = np.zeros((len(pairs[0]), placed[2].shape[1]))
    _slope(placed, bodies, pairs, normal, place, rows)
    return rows


@compiled(PLACED, BODIES, PAIRS, MATRIX, MATRIX, TABLE)
def _slope(
    placed: Placed, bodies: Bodies, pairs: Pairs, normal: Array, place: Array, rows: Array
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
    placed: Placed, bodies: Bodies, pairs: Pairs,
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
    placed: Placed, bodies: Bodies, pairs: Pairs,
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
