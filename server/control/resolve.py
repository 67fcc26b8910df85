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

At σ = 0 there is more than one motion that the tool hardly feels, and v is any of them. The one
that counts bends most: the eigenvalue of uᵀ (∂J/∂q · a) b over that whole space that is largest in
size. The way home along it can be gone in two senses, elbow up and elbow down; joint limits decide
where they leave only one open.
"""

import math
from typing import NamedTuple

import numpy as np

from ...config.schema import Resolve
from .compiled import MATRIX, NUMBER, VECTOR, compiled
from .frames import Array
from .jacobian_rate import curvatures
from .svd import svd

_CURVED = 0.05
"""Curvature from which a singularity counts as a boundary of the workspace [m/rad²]."""

_BRAKING = 3.0
"""Deceleration with which joints approach a boundary of the workspace [rad/s²]."""

_TRAVEL = 0.4
"""A way home with less joint travel than this is not taken if the other has more [rad]."""


class Resolved(NamedTuple):
    """Joint rates for a tool rate."""

    dq: Array
    """Task part (n,) [rad/s]."""
    null: Array
    """Orthonormal rows (n − 6, n) that span the spare motions: I − J⁺J = nullᵀ null."""
    sigma_min: float
    """Least singular value of the weighted Jacobian [m]."""
    singular: bool
    """True where damping acts on what was asked."""


class Travel(NamedTuple):
    """How far each joint may still go (n,) [rad]."""

    below: Array
    above: Array

    def along(self, direction: Array) -> float:
        """Return how far all joints can go along a unit direction (n,) before one is stopped."""
        room = np.where(direction > 0.0, self.above, self.below)
        return float((room / np.maximum(np.abs(direction), 1e-9)).min())


def resolve(J: Array, twist: Array, p: Resolve, travel: Travel | None = None) -> Resolved:
    """Resolve a twist (6,) [m/s, rad/s] with a chain's Jacobian J (6, n), same axes and point.

    Rotations weigh `p.characteristic_length` metres per radian. `travel` tells which way home from
    a singularity joint limits leave open.
    """
    length = p.characteristic_length
    Jw = _weighted(J, length)
    U, s, Vt = svd(Jw)
    rank_rows, sigma_min = len(s), float(s[-1])
    along, dq = _answered(U, s, Vt, twist, length)
    if sigma_min >= 2.0 * p.singular_region:
        return Resolved(dq, Vt[rank_rows:], sigma_min, False)
    weight = np.array([1.0, 1.0, 1.0, length, length, length])
    gains = np.empty(rank_rows)
    way_home = np.zeros(J.shape[1])
    singular = False
    for i in range(rank_rows):
        sigma = float(s[i])
        d = float(along[i])
        gains[i] = _damped_gain(sigma, p)
        if sigma >= 2.0 * p.singular_region or abs(d) <= 1e-9:
            continue
        # Below the floor, what the tool hardly feels is more than v.
        last = sigma < p.floor and i == rank_rows - 1
        unfelt = Vt[int((s >= p.singular_region).sum()) :] if last else Vt[i : i + 1]
        direction, curvature = _most_bent(J, unfelt, weight * U[:, i])
        if curvature * d > 0.0:
            gains[i] = _homeward_gain(gains[i], sigma, abs(curvature), p)
            if sigma < p.floor:
                slope = d * float(U[:, i] @ (Jw @ direction))
                way_home += gains[i] * abs(d) * _sense(direction, slope, travel)
                gains[i] = 0.0
        else:
            gains[i] = _outward_gain(gains[i], sigma, abs(curvature), abs(d), p)
        singular = singular or gains[i] < 0.999 / sigma
    dq = Vt[:rank_rows].T @ (gains * along) + way_home
    # Rows of V belong to real task directions even where σ is small: motion in the null space
    # must not disturb them.
    return Resolved(dq, Vt[rank_rows:], sigma_min, singular)


def _most_bent(J: Array, basis: Array, u: Array) -> tuple[Array, float]:
    """Return the unit motion in `basis` (m, n) that bends most, and its curvature along `u` (6,).

    `u` is weighted.
    """
    bend = curvatures(J, basis, u)
    if len(basis) == 1:
        return basis[0], float(bend[0, 0])
    values, vectors = np.linalg.eigh(bend)
    best = int(np.argmax(np.abs(values)))
    return np.asarray(vectors[:, best] @ basis), float(values[best])


def _sense(direction: Array, slope: float, travel: Travel | None) -> Array:
    """Return the direction or its opposite: uphill, unless joint limits bar it more."""
    uphill = direction if slope >= 0.0 else -direction
    if travel is None:
        return uphill
    return uphill if travel.along(uphill) >= min(_TRAVEL, travel.along(-uphill)) else -uphill


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


@compiled(MATRIX, NUMBER)
def _weighted(J: Array, length: float) -> Array:
    Jw = np.empty(J.shape)
    for i in range(6):
        for j in range(J.shape[1]):
            Jw[i, j] = J[i, j] if i < 3 else length * J[i, j]
    return Jw


@compiled(MATRIX, VECTOR, MATRIX, VECTOR, NUMBER)
def _answered(U: Array, s: Array, Vt: Array, twist: Array, length: float) -> tuple[Array, Array]:
    """Return the parts (r,) of the weighted twist along U, and rates (n,) that answer each in full.

    From U (6, 6), singular values (r,) and Vt (n, n) of the weighted Jacobian.
    """
    along, dq = np.zeros(len(s)), np.zeros(len(Vt))
    for i in range(len(s)):
        for k in range(6):
            along[i] += U[k, i] * (twist[k] if k < 3 else length * twist[k])
        rate = along[i] / s[i]
        for j in range(len(dq)):
            dq[j] += rate * Vt[i, j]
    return along, dq
