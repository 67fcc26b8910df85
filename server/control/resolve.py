"""Tool rates into joint rates: dq = J⁺ẋ + (I − J⁺J) z (Williams 1997, eqs. 2 and 7).

Exact away from singularities. Near one, damping grows smoothly as the singular value falls,
λᵢ² = λm² (1 − (σᵢ/σ₀)²), so nothing jumps, and |dq| ≤ |ẋ| / (2 λm √(1 − λm²/σ₀²)).

Damping alone would let an arm creep ever closer to a singularity that bounds its workspace, such
as the stretched elbow, and then hold it there: at σ = 0 the joints hear nothing of a command to
come back. So the direction that a small singular value belongs to is looked at one derivative
further. With u the tool direction that fades, v the joint motion that fades with it, and
κ = uᵀ (∂J/∂q · v) v the curvature of the boundary: a command along u against κ leads out of the
workspace, and the motion v that answers it is braked so as to end above σ = 0; one along κ leads
home, and is answered with the full damped gain however small σ is.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...config.schema import Resolve
from .frames import Array

_CURVED = 0.05
"""Curvature from which a singularity counts as a boundary of the workspace [m/rad²]."""

_BRAKING = 3.0
"""Deceleration with which joints approach a boundary of the workspace [rad/s²]."""

_STEP = 1e-4
"""Joint step of the finite difference for the curvature [rad]."""


class Resolved(NamedTuple):
    """Joint rates for a tool rate."""

    dq: Array
    """Task part (n,) [rad/s]."""
    null_projector: Array
    """I − J⁺J with the exact rank (n, n)."""
    sigma_min: float
    """Least singular value of the weighted Jacobian [m]."""
    singular: bool
    """True where damping acts on what was asked."""


def resolve(J: Array, twist: Array, jacobian_at: Callable[[Array], Array], p: Resolve) -> Resolved:
    """Resolve a twist (6,) [m/s, rad/s] with the Jacobian J (6, n), same axes and point.

    `jacobian_at(step)` returns the Jacobian (6, n) after a joint step (n,) from here; it is
    called only near a singularity. Rotations weigh `p.characteristic_length` metres per radian.
    """
    weight = np.array([1.0, 1.0, 1.0] + [p.characteristic_length] * 3)
    U, s, Vt = np.linalg.svd(J * weight[:, None])
    rank_rows = len(s)
    along = U.T[:rank_rows] @ (weight * twist)
    gains = np.empty(rank_rows)
    singular = False
    for i in range(rank_rows):
        sigma = float(s[i])
        d = float(along[i])
        gains[i] = _damped_gain(sigma, p)
        if sigma < 2.0 * p.singular_region and abs(d) > 1e-9:
            stepped = jacobian_at(_STEP * Vt[i])
            curvature = float(U[:, i] @ (weight * ((stepped - J) @ Vt[i]))) / _STEP
            if curvature * d > 0.0:
                gains[i] = _homeward_gain(gains[i], sigma, abs(curvature), p)
            else:
                gains[i] = _outward_gain(gains[i], sigma, abs(curvature), abs(d), p)
            singular = singular or gains[i] < 0.999 / sigma
    V = Vt[:rank_rows]
    dq = V.T @ (gains * along)
    # Rows of V belong to real task directions even where σ is small: motion in the null space
    # must not disturb them.
    null_projector = np.eye(J.shape[1]) - V.T @ V
    return Resolved(dq, null_projector, float(s[-1]), singular)


def _damped_gain(sigma: float, p: Resolve) -> float:
    if sigma >= p.singular_region:
        return 1.0 / sigma
    damping2 = p.damping**2 * (1.0 - (sigma / p.singular_region) ** 2)
    return sigma / (sigma**2 + damping2)


def _homeward_gain(natural: float, sigma: float, curvature: float, p: Resolve) -> float:
    """Return the gain for a command that leads away from the boundary of the workspace."""
    share = min(1.0, curvature / _CURVED)
    # λm is about where the damped gain is greatest: below it, the answer gets no weaker.
    full = _damped_gain(max(sigma, min(p.damping, p.singular_region)), p)
    return (1.0 - share) * natural + share * max(natural, full)


def _outward_gain(natural: float, sigma: float, curvature: float, d: float, p: Resolve) -> float:
    """Return the gain for a command of size d that leads out of the workspace."""
    # A singularity without curvature, as a wrist's, is no boundary: nothing is held off there.
    share = min(1.0, curvature / _CURVED)
    room = max(0.0, sigma - p.floor)
    fastest = math.sqrt(2.0 * _BRAKING * room / max(curvature, 1e-9))
    return (1.0 - share) * natural + share * min(natural, fastest / d)
