"""How a serial chain's Jacobian changes while its joints move."""

import numpy as np

from ..compiled import MATRIX, VECTOR, compiled
from ..spatial import Array


@compiled(MATRIX, VECTOR)
def bent(J: Array, dq: Array) -> Array:
    """Return how a chain's Jacobian J (6, n) changes (6, n) [1/s] at joint rates dq (n,).

    In closed form: of two joints, the one nearer to the base turns what the other does,
    ∂_k v_j = ω_min(j,k) × v_max(j,k), and ∂_k ω_j = ω_k × ω_j for k < j, else 0.
    """
    n = J.shape[1]
    out = np.zeros((6, n))
    w = np.zeros(3)  # how the joints inboard turn
    v = np.zeros(3)  # how those outboard move the tool
    for j in range(n):
        v += dq[j] * J[:3, j]
    for j in range(n):
        x, y, z = J[3, j], J[4, j], J[5, j]
        out[3, j] = w[1] * z - w[2] * y
        out[4, j] = w[2] * x - w[0] * z
        out[5, j] = w[0] * y - w[1] * x
        w += dq[j] * J[3:, j]
        v -= dq[j] * J[:3, j]
        vx, vy, vz = J[0, j], J[1, j], J[2, j]
        out[0, j] = w[1] * vz - w[2] * vy + y * v[2] - z * v[1]
        out[1, j] = w[2] * vx - w[0] * vz + z * v[0] - x * v[2]
        out[2, j] = w[0] * vy - w[1] * vx + x * v[1] - y * v[0]
    return out
