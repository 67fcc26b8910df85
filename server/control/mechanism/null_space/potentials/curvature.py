"""How much the potential bends along a self-motion."""

from typing import Final

import numpy as np

from ....compiled import MATRIX, NUMBER, VECTOR, compiled
from ....spatial import Array

_REGULAR: Final = 1e-9
"""Added to J Jᵀ, so that its inverse stays finite at a singularity [m²]."""


@compiled(MATRIX, VECTOR)
def weighed(J: Array, b: Array) -> Array:
    """Return (J Jᵀ)⁻¹ b (m,) of a Jacobian J (m, n), finite at a singularity too."""
    m, x = len(b), b.copy()
    A = np.empty((m, m))
    for i in range(m):
        for k in range(m):
            A[i, k] = _REGULAR * (i == k)
            for j in range(J.shape[1]):
                A[i, k] += J[i, j] * J[k, j]
    for i in range(m):
        # No pivot can be less, but for rounding.
        A[i, i] = max(A[i, i], _REGULAR)
        for k in range(i + 1, m):
            part = A[k, i] / A[i, i]
            x[k] -= part * x[i]
            for j in range(i, m):
                A[k, j] -= part * A[i, j]
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            x[i] -= A[i, k] * x[k]
        x[i] /= A[i, i]
    return x


@compiled(VECTOR, MATRIX, VECTOR, MATRIX, VECTOR, NUMBER)
def curvature(
    way: Array, J: Array, torque: Array, J_ahead: Array, torque_ahead: Array, step: float
) -> float:
    """Return the curvature of V along the self-motion that starts in direction `way` (n,).

    Jacobians (m, n) and torques −∂V/∂q (n,) are those here and a small `step` [rad] straight ahead.
    What the straight way leaves the tool's pose by counts too: with λ = (JJᵀ)⁻¹Jτ, the force that
    holds the tool, the curvature is −[(τ' − τ)·d − λ·J'd] / step [N·m/rad].
    """
    m, n = J.shape
    pull = np.zeros(m)
    for i in range(m):
        for j in range(n):
            pull[i] += J[i, j] * torque[j]
    hold, change = weighed(J, pull), 0.0
    for j in range(n):
        bend = torque_ahead[j] - torque[j]
        for i in range(m):
            bend -= hold[i] * (J_ahead[i, j] - J[i, j])
        change += bend * way[j]
    return -change / step
