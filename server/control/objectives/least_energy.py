"""Move with the least kinetic energy: spare joints move along where that saves some.

Of all joint rates that do the task, dq = J⁺ẋ + N z, those of least ½ dqᵀ M dq are the ones of the
inertia-weighted pseudo-inverse, M⁻¹Jᵀ(J M⁻¹ Jᵀ)⁻¹ ẋ. Setting the slope along the spare motions B to
zero, B M (J⁺ẋ + Bᵀ y) = 0, gives the z = Bᵀ y that leads there from the task's rates, whatever
resolved them.
"""

import numpy as np

from ..frames import Array

_MASSLESS = 1e-9
"""Keeps a chain without inertia solvable [kg·m²]."""


def rate(dq_task: Array, null: Array, M: Array) -> Array:
    """Return z (n,) [rad/s] for the task's rates (n,) and the mass matrix M (n, n).

    `null` (n − 6, n) has orthonormal rows that span the spare motions.
    """
    BM = null @ M
    A = BM @ null.T + _MASSLESS * np.eye(len(null))
    return np.asarray(-np.linalg.solve(A, BM @ dq_task) @ null)
