"""How near links may come: by motions of the joints, and carried by a Base that moves."""

import math

import numpy as np

from ..compiled import INDEX, MATRIX, VECTOR, compiled
from ..frames import Array
from .distance import Index


@compiled(MATRIX, VECTOR)
def travel(lever: Array, way: Array) -> Array:
    """Return how far capsules move at most (c,) [m] when joints move by no more than `way` (n,).

    The levers (c, n) themselves grow with the motion: D' ≤ Σ way (lever + D), so that
    D ≤ lever·way (exp(σ) − 1)/σ with σ the sum of all ways.
    """
    total = 0.0
    for j in range(len(way)):
        total += way[j]
    growth = math.expm1(total) / total if total > 1e-9 else 1.0
    found = np.zeros(len(lever))
    for c in range(len(lever)):
        for j in range(len(way)):
            found[c] += lever[c, j] * way[j]
        found[c] *= growth
    return found


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


@compiled(VECTOR, INDEX, INDEX, VECTOR, VECTOR)
def doubtful(
    way: Array, first: Index, second: Index, gap: Array, most: Array
) -> tuple[Index, Array]:
    """Return the pairs that may come below `most` (k,), and how much closer each may come [m].

    `way` (c,) is how far capsules move at most.
    """
    pairs, closer = np.empty(len(gap), dtype=np.int64), np.empty(len(gap))
    found = 0
    for i in range(len(gap)):
        together = way[first[i]]
        if second[i] < len(way):
            together += way[second[i]]
        if gap[i] - together < most[i]:
            pairs[found], closer[found] = i, together
            found += 1
    return pairs[:found].copy(), closer[:found].copy()
