"""Bounds on the travel of links: by motions of the joints, and carried by a Base that moves."""

import math
from typing import Final

import numpy as np

from ..compiled import (
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
)
from ..scene import Flags, Index
from ..spatial import Array
from .records import PAIRS, PLACED, Pairs, Placed

CURVED: Final = 1e-9
"""Below this sum of ways a lever does not grow [1]."""

_UNIT: Final = 1e-9
"""An axis of a length that differs from 1 by less is of unit length; wheels have shorter ones."""


def levers(placed: Placed, moves: Flags, prismatic: Flags) -> Array:
    """Return the levers (c, n) [m] of capsules at the first posture, as `Capsules.levers` says.

    `moves` (c, n) tells which joints move them, `prismatic` (n,) which joints slide.
    """
    lever = np.zeros(moves.shape)
    _lever(placed, moves, prismatic, lever)
    return lever


@compiled(PLACED, FLAGS2, FLAGS, TABLE)
def _lever(placed: Placed, moves: Flags, prismatic: Flags, lever: Array) -> None:
    ends, frames, axes = placed
    for c in range(len(moves)):
        for j in range(moves.shape[1]):
            if not moves[c, j]:
                continue
            if prismatic[j]:
                lever[c, j] = 1.0
                continue
            farthest, axis2 = 0.0, 0.0
            for i in range(3):
                axis2 += axes[0, j, i] ** 2
            if abs(axis2 - 1.0) < _UNIT:
                axis2 = 1.0
            for e in range(2):
                length2, along = 0.0, 0.0
                for i in range(3):
                    arm = ends[0, c, e, i] - frames[0, j, i, 3]
                    length2 += arm * arm
                    along += arm * axes[0, j, i]
                farthest = max(farthest, length2 - along * along / axis2)
            lever[c, j] = math.sqrt(farthest)


@compiled(MATRIX, VECTOR)
def travel(lever: Array, way: Array) -> Array:
    """Return how far capsules move at most (c,) [m] when joints move by no more than `way` (n,).

    The levers (c, n) themselves grow with the motion: D' ≤ Σ way (lever + D), so that
    D ≤ lever·way (exp(σ) − 1)/σ with σ the sum of all ways.
    """
    total = 0.0
    for j in range(len(way)):
        total += way[j]
    growth = math.expm1(total) / total if total > CURVED else 1.0
    found = np.zeros(len(lever))
    for c in range(len(lever)):
        for j in range(len(way)):
            found[c] += lever[c, j] * way[j]
        found[c] *= growth
    return found


def surroundings(
    placed: Placed, moves: Flags, prismatic: Flags,
    speed: Array, acceleration: Array, factor: float, lag: float, margin: float,
) -> tuple[Array, Array]:  # fmt: skip
    """Return the levers (c, n) [m], and the search radii around capsules (c,) [m].

    A capsule travels so far before joints at `speed` (n,) stand, which brake at `factor` times
    `acceleration` (n,) after `lag` [s]; plus `margin` [m].
    """
    lever, around = np.zeros(moves.shape), np.empty(len(moves))
    _surround(placed, moves, prismatic, speed, acceleration, factor, lag, margin, lever, around)
    return lever, around


@compiled(PLACED, FLAGS2, FLAGS, VECTOR, VECTOR, NUMBER, NUMBER, NUMBER, TABLE, ROW)
def _surround(
    placed: Placed, moves: Flags, prismatic: Flags,
    speed: Array, acceleration: Array, factor: float, lag: float, margin: float,
    lever: Array, around: Array,
) -> None:  # fmt: skip
    _lever(placed, moves, prismatic, lever)
    way = np.empty(len(speed))
    for j in range(len(speed)):
        way[j] = speed[j] * (lag + 0.5 * speed[j] / (factor * acceleration[j]))
    gone = travel(lever, way)
    for c in range(len(gone)):
        around[c] = gone[c] + margin


@compiled(MATRIX, MATRIX, INDEX, VECTOR, VECTOR)
def carried(
    normal: Array, lever: Array, obstacle: Index, speed: Array, twist: Array
) -> tuple[Array, Array]:
    """Return `speed` and `carried` (k,), as in `NearPairs`, where Base moves with a twist (6,).

    `lever` (k, 3) leads from Base to the places [m].
    """
    nearer, fastest = speed.copy(), np.zeros(len(speed))
    wx, wy, wz = twist[3:]
    for i in range(len(speed)):
        if obstacle[i] < 0:
            continue
        x, y, z = lever[i]
        vx = twist[0] + wy * z - wz * y
        vy = twist[1] + wz * x - wx * z
        vz = twist[2] + wx * y - wy * x
        closing = -(normal[i, 0] * vx + normal[i, 1] * vy + normal[i, 2] * vz)
        nearer[i] = max(speed[i] + closing, 0.0)
        fastest[i] = math.sqrt(vx * vx + vy * vy + vz * vz)
    return nearer, fastest


def doubtful(
    lever: Array, way: Array, room: Array, pairs: Pairs, gap: Array, least: Array
) -> tuple[bool, Index, Array]:
    """Return which pairs may come below `least` (k,) [m], and how much closer each may come [m].

    `way` (n,) is how far joints move at most, `lever` (c, n) the capsules'. The first result is
    whether any capsule leaves its `room` (c,) [m]: then other pairs matter, too.
    """
    which, closer = np.empty(len(gap), dtype=np.int64), np.empty(len(gap))
    leaves, found = _doubt(lever, way, room, pairs, gap, least, which, closer)
    return leaves, which[:found], closer[:found]


@compiled(MATRIX, VECTOR, VECTOR, PAIRS, VECTOR, VECTOR, COUNTS, ROW)
def _doubt(
    lever: Array, way: Array, room: Array, pairs: Pairs, gap: Array, least: Array,
    which: Index, closer: Array,
) -> tuple[bool, int]:  # fmt: skip
    """Write what `doubtful` returns; return whether a capsule leaves, and how many there are."""
    (first, second), gone = pairs, travel(lever, way)
    found, leaves = 0, False
    for c in range(len(gone)):
        leaves = leaves or gone[c] > room[c]
    for i in range(len(gap)):
        together = gone[first[i]]
        if second[i] < len(gone):
            together += gone[second[i]]
        if gap[i] - together < least[i]:
            which[found], closer[found] = i, together
            found += 1
    return leaves, found
