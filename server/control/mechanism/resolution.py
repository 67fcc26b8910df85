"""Tool rates into joint rates: dq = J⁺ẋ + (I − J⁺J) z (Williams 1997, eqs. 2 and 7).

Exact away from singularities. Near one, damping grows smoothly as the singular value falls,
λᵢ² = λm² (1 − (σᵢ/σ₀)²), so nothing jumps, and |dq| ≤ |ẋ| / (2 λm √(1 − λm²/σ₀²)).
Damping alone would let an arm creep ever closer to a singularity that bounds its workspace, such
as the stretched elbow, and then hold it there: at σ = 0 the joints hear nothing of a command to
come back. So the direction that a small singular value belongs to is looked at one derivative
further (`singularity.py`). For a fixed twist the rates are a continuous function of the posture,
but for one choice: the side to which an elbow at σ ≈ 0 bends.

Some arms never reach some axes: a planar chain moves in three, five joints in five. What is asked
along the others is not answered, and does not count as a singularity.
"""

from typing import NamedTuple

import numpy as np

from ....config.schema.cell import ResolveSection
from ..compiled import COUNT, MATRIX, NUMBER, ROW, VECTOR, compiled
from ..spatial import Array
from .singularity import Directions, Travel, answer
from .svd import svd


class Resolved(NamedTuple):
    """Joint rates for a tool rate."""

    dq: Array
    """Task part (n,) [rad/s]."""
    null: Array
    """Orthonormal rows (n − rank, n) that span the spare motions: I − J⁺J = nullᵀ null."""
    sigma_min: float
    """Least singular value of the weighted Jacobian, of axes that the arm reaches at all [m]."""
    singular: bool
    """True where damping acts on what was asked."""
    way_home: Array | None = None
    """The part (n,) of dq that leads home from a singularity, whose side is chosen; None: none."""


def resolve(
    J: Array, twist: Array, p: ResolveSection, travel: Travel | None = None, rank: int | None = None
) -> Resolved:
    """Resolve a twist (6,) [m/s, rad/s] with a chain's Jacobian J (6, n), same axes and point.

    Rotations weigh `p.characteristic_length` metres per radian. `travel` tells which way home from
    a singularity joint limits leave open; `rank` how many axes the arm reaches anywhere, the lesser
    of 6 and n by default.
    """
    length = p.characteristic_length
    U, s, Vt = svd(J, length)
    rank = len(s) if rank is None else rank
    sigma_min = float(s[rank - 1])
    along, dq = np.zeros(6), np.zeros(len(Vt))
    _answer(U, s, Vt, twist, length, rank, along, dq)
    # Rows of V belong to real task directions even where σ is small: motion in the null space
    # must not disturb them.
    null = Vt[rank:]
    if sigma_min >= 2.0 * p.singular_region:
        return Resolved(dq, null, sigma_min, False)
    sigma = np.zeros(6)
    sigma[:rank] = s[:rank]
    found = answer(Directions(J, length, U, sigma, Vt[:rank], null, along), p, travel)
    return Resolved(found.dq, null, sigma_min, found.singular, found.way_home)


@compiled(MATRIX, VECTOR, MATRIX, VECTOR, NUMBER, COUNT, ROW, ROW)
def _answer(
    U: Array,
    s: Array,
    Vt: Array,
    twist: Array,
    length: float,
    rank: int,
    along: Array,
    dq: Array,
) -> None:
    """Write the parts (6,) of the weighted twist along U, and rates (n,) that answer in full.

    From U (6, 6), singular values (r,) and Vt (n, n) of the weighted Jacobian. Of the parts the
    first `rank` are answered. Both are zeros before.
    """
    for i in range(6):
        for k in range(6):
            along[i] += U[k, i] * (twist[k] if k < 3 else length * twist[k])
        if i < rank:
            rate = along[i] / s[i]
            for j in range(len(dq)):
                dq[j] += rate * Vt[i, j]
