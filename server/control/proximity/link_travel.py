"""How near links may come: by motions of the joints, and carried by a Base that moves."""

import math
from typing import Final

import numpy as np

from ..compiled import ARRAY3, ARRAY4, FLAGS, INDEX, MATRIX, NUMBER, VECTOR, compiled
from ..scene import Flags, Index
from ..spatial import Array

CURVED: Final = 1e-9
"""Below this sum of ways a lever does not grow [1]."""


@compiled(ARRAY4, ARRAY3, ARRAY4, INDEX, FLAGS)
def levers(frames: Array, axes: Array, ends: Array, body: Index, prismatic: Flags) -> Array:
    """Return the levers (c, n) of capsules at the first of s postures, as `Links.levers` says.

    `ends` (s, c, 2, 3) are theirs, `frames` (s, n, 3, 4) and `axes` (s, n, 3) the joints'.
    """
    lever = np.zeros((len(body), axes.shape[1]))
    for c in range(len(body)):
        for j in range(body[c]):
            if prismatic[j]:
                lever[c, j] = 1.0
                continue
            farthest = 0.0
            for e in range(2):
                length2, along = 0.0, 0.0
                for i in range(3):
                    arm = ends[0, c, e, i] - frames[0, j, i, 3]
                    length2 += arm * arm
                    along += arm * axes[0, j, i]
                farthest = max(farthest, length2 - along * along)
            lever[c, j] = math.sqrt(farthest)
    return lever


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


@compiled(ARRAY4, ARRAY3, ARRAY4, INDEX, FLAGS, VECTOR, VECTOR, NUMBER, NUMBER, NUMBER)
def surroundings(
    frames: Array, axes: Array, ends: Array, body: Index, prismatic: Flags,
    speed: Array, acceleration: Array, factor: float, lag: float, beside: float,
) -> tuple[Array, Array]:  # fmt: skip
    """Return the levers (c, n), and how far around each capsule things matter (c,) [m].

    That is as far as it gets before joints at `speed` (n,) stand, who brake at `factor` times
    `acceleration` (n,) after `lag` [s], and `beside` [m].
    """
    lever, way = levers(frames, axes, ends, body, prismatic), np.empty(len(speed))
    for j in range(len(speed)):
        way[j] = speed[j] * (lag + 0.5 * speed[j] / (factor * acceleration[j]))
    return lever, travel(lever, way) + beside


@compiled(MATRIX, MATRIX, INDEX, VECTOR, VECTOR)
def carried(
    normal: Array, lever: Array, obstacle: Index, speed: Array, twist: Array
) -> tuple[Array, Array]:
    """Return `speed` and `carried` (k,), as in `Neighbours`, where Base moves with a twist (6,).

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


@compiled(MATRIX, VECTOR, VECTOR, INDEX, INDEX, VECTOR, VECTOR)
def doubtful(
    lever: Array, way: Array, room: Array, first: Index, second: Index, gap: Array, most: Array
) -> tuple[bool, Index, Array]:
    """Return the pairs that may come below `most` (k,) [m], and how much closer each may come [m].

    `way` (n,) is how far joints move at most, `lever` (c, n) the capsules'. The first result is
    whether any capsule leaves its `room` (c,) [m]: then other pairs matter, too.
    """
    gone = travel(lever, way)
    pairs, closer = np.empty(len(gap), dtype=np.int64), np.empty(len(gap))
    found, leaves = 0, False
    for c in range(len(gone)):
        leaves = leaves or gone[c] > room[c]
    for i in range(len(gap)):
        together = gone[first[i]]
        if second[i] < len(gone):
            together += gone[second[i]]
        if gap[i] - together < most[i]:
            pairs[found], closer[found] = i, together
            found += 1
    return leaves, pairs[:found].copy(), closer[:found].copy()
