"""Move with the least kinetic energy: spare joints move along where that saves some.

Of all joint rates that do the task, dq = J⁺ẋ + N z, those of least ½ dqᵀ M dq are the ones of the
inertia-weighted pseudo-inverse, M⁻¹Jᵀ(J M⁻¹ Jᵀ)⁻¹ ẋ. Setting the slope in the null space to zero,
N M (J⁺ẋ + N z) = 0, gives the z that leads there from the task's rates, whatever resolved them.
"""

import numpy as np

from ..frames import Array

_MASSLESS = 1e-9
"""Keeps a chain without inertia solvable [kg·m²]."""


def rate(dq_task: Array, null_projector: Array, M: Array) -> Array:
    """Return z (n,) [rad/s] for the task's rates (n,), N (n, n) and the mass matrix M (n, n)."""
    N = null_projector
    NM = N @ M
    # Outside of the null space the identity stands in, so that the sum can be inverted.
    A = NM @ N + (np.eye(len(N)) - N) + _MASSLESS * N
    return np.asarray(-np.linalg.solve(A, NM @ dq_task))
