"""Load shares of several grasps on one payload, and the internal forces among them.

Williams 1997, section 3: minimise Σ hᵢᵀWᵢhᵢ subject to Σ Gᵢhᵢ = w, by
hᵢ = Wᵢ⁻¹Gᵢᵀ (Σ GⱼWⱼ⁻¹Gⱼᵀ)⁻¹ w. Wrenches `[f; m]` are those that arms exert on the payload, each
at its own grasp, all in the axes of the MRF; w is their sum at the MRF. Grasps are at p (k, 3) [m],
seen from the MRF: G = [I 0; p̂ I].
"""

import math

import numpy as np

from ..compiled import MATRIX, ROW, TABLE, VECTOR, compiled
from ..spatial import Array


def load_shares(p: Array, weights: Array, wrench: Array) -> Array:
    """Return each grasp's share (k, 6) of a wrench (6,) on the payload.

    `weights` (k, 6) are the diagonals of W: the dearer, the less an arm carries.
    """
    shares = np.empty((len(p), 6))
    _share(p, weights, wrench, shares)
    return shares


def total(p: Array, exerted: Array) -> Array:
    """Return the wrench (6,) on the payload at the MRF, of those at the grasps (k, 6)."""
    wrench = np.empty(6)
    _total(p, exerted, wrench)
    return wrench


def internal(p: Array, exerted: Array) -> Array:
    """Return what of the wrenches at the grasps (k, 6) moves nothing: less their least norm share.

    The weights are one, whatever shares the arms are to carry.
    """
    return exerted - load_shares(p, np.ones(exerted.shape), total(p, exerted))


@compiled(MATRIX)
def greatest(vectors: Array) -> float:
    """Return the greatest size of vectors (k, 3)."""
    most = 0.0
    for i in range(len(vectors)):
        most = max(most, vectors[i, 0] ** 2 + vectors[i, 1] ** 2 + vectors[i, 2] ** 2)
    return math.sqrt(most)


@compiled(MATRIX, MATRIX, ROW)
def _total(p: Array, exerted: Array, wrench: Array) -> None:
    for j in range(6):
        wrench[j] = 0.0
    for i in range(len(p)):
        for j in range(6):
            wrench[j] += exerted[i, j]
        for j in range(3):
            a, b = (j + 1) % 3, (j + 2) % 3
            wrench[3 + j] += p[i, a] * exerted[i, b] - p[i, b] * exerted[i, a]


@compiled(MATRIX, MATRIX, VECTOR, TABLE)
def _share(p: Array, weights: Array, wrench: Array, shares: Array) -> None:
    """Fill in the shares (k, 6), by a Cholesky decomposition of Σ GⱼWⱼ⁻¹Gⱼᵀ."""
    grasps = len(p)
    G, S = np.zeros((grasps, 6, 6)), np.zeros((6, 6))
    for g in range(grasps):
        for i in range(6):
            G[g, i, i] = 1.0
        for i in range(3):
            a, b = (i + 1) % 3, (i + 2) % 3
            G[g, 3 + i, a], G[g, 3 + i, b] = -p[g, b], p[g, a]
        for i in range(6):
            for j in range(i + 1):
                for c in range(6):
                    S[i, j] += G[g, i, c] * G[g, j, c] / weights[g, c]
    y = np.empty(6)
    for i in range(6):
        for j in range(i + 1):
            for c in range(j):
                S[i, j] -= S[i, c] * S[j, c]
            S[i, j] = math.sqrt(S[i, i]) if i == j else S[i, j] / S[j, j]
        y[i] = wrench[i]
        for c in range(i):
            y[i] -= S[i, c] * y[c]
        y[i] /= S[i, i]
    for i in range(5, -1, -1):
        for c in range(i + 1, 6):
            y[i] -= S[c, i] * y[c]
        y[i] /= S[i, i]
    for g in range(grasps):
        for i in range(6):
            shares[g, i] = 0.0
            for c in range(6):
                shares[g, i] += G[g, c, i] * y[c]
            shares[g, i] /= weights[g, i]
