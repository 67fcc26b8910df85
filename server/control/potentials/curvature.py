"""How much the potential bends along a self-motion."""

import numpy as np

from ..frames import Array

_REGULAR = 1e-9
"""Added to J Jᵀ, so that its inverse stays finite at a singularity [m²]."""


def weighed(J: Array, b: Array) -> Array:
    """Return (J Jᵀ)⁻¹ b (m,) of a Jacobian J (m, n), finite at a singularity too."""
    A = J @ J.T
    A.flat[:: len(A) + 1] += _REGULAR
    return np.asarray(np.linalg.solve(A, b))


def curvature(
    way: Array, J: Array, torque: Array, J_ahead: Array, torque_ahead: Array, step: float
) -> float:
    """Return the curvature of V along the self-motion that starts in direction `way` (n,).

    Jacobians (m, n) and torques −∂V/∂q (n,) are those here and a small `step` [rad] straight ahead.
    What the straight way leaves the tool's pose by counts too: with λ = (JJᵀ)⁻¹Jτ, the force that
    holds the tool, the curvature is −[(τ' − τ)·d − λ·J'd] / step [N·m/rad].
    """
    hold = weighed(J, J @ torque)
    change = (torque_ahead - torque) @ way - hold @ ((J_ahead - J) @ way)
    return -float(change) / step
