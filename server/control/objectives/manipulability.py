"""Keep away from singularities: uphill in manipulability (Scott & Carignan 2008, eqs. 20–21).

w = √det(J Jᵀ), and its slope ∂w/∂q_k = w · tr((J Jᵀ)⁻¹ ∂_kJ Jᵀ). Rotations may weigh any length per
radian: that scales w and its slope by one constant, which is the gain's business.

The derivative of a serial chain's Jacobian is known in closed form: of two joints, the one nearer
to the base turns what the other does, ∂_k v_j = ω_min(j,k) × v_max(j,k), and ∂_k ω_j = ω_k × ω_j
for k < j, else 0. With G = (J Jᵀ)⁻¹ J, rows [g; h], the trace is G : ∂_kJ, and by the rules of the
triple product

    ω_k · Σ_{j≥k} (v_j × g_j + ω_j × h_j)  +  v_k · Σ_{j<k} (g_j × ω_j).
"""

import math

import numpy as np

from ..frames import Array

REGULAR = 1e-14
"""Added to J Jᵀ, so that the slope stays finite at a singularity [m²]."""


def manipulability(J: Array) -> float:
    """Return w of a Jacobian J (m, n), m ≤ n."""
    return math.sqrt(max(0.0, float(np.linalg.det(J @ J.T))))


def rate(J: Array) -> Array:
    """Return the slope ∂w/∂q (n,) for a chain's Jacobian J (6, n), as joint rates at gain 1."""
    A = J @ J.T
    A.flat[::7] += REGULAR
    w = math.sqrt(max(0.0, float(np.linalg.det(A))))
    G = np.linalg.solve(A, J)
    n = J.shape[1]
    v, omega, g, h = J[:3], J[3:], G[:3], G[3:]
    (ax, ay, az), (bx, by, bz) = np.hstack([v, omega, g]), np.hstack([g, h, omega])
    turned = np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
    outboard = (turned[:, :n] + turned[:, n : 2 * n])[:, ::-1].cumsum(axis=1)[:, ::-1]
    inboard = turned[:, 2 * n :].cumsum(axis=1) - turned[:, 2 * n :]
    return np.asarray(w * ((omega * outboard).sum(axis=0) + (v * inboard).sum(axis=0)))
