"""Move with the least kinetic energy: spare joints move along where that saves some.

Of all joint rates that do the task, dq = J⁺ẋ + N z, those of least ½ dqᵀ M dq are the ones of the
inertia-weighted pseudo-inverse, M⁻¹Jᵀ(J M⁻¹ Jᵀ)⁻¹ ẋ. Setting the slope along the spare motions B to
zero, B M (J⁺ẋ + Bᵀ y) = 0, gives the z = Bᵀ y that leads there from the task's rates, whatever
resolved them. With spare motions E orthogonal in M, each
takes its own: z = −Σ e (eᵀ M dq) / (eᵀ M e).
"""

from typing import Final

import numpy as np

from ....compiled import MATRIX, ROW, VECTOR, compiled
from ....joints import Joints
from ....spatial import Array
from ...kinematics import Mechanism
from ..objective import Objective, View

_MASSLESS: Final = 1e-9
"""Keeps a chain without inertia solvable [kg·m²]."""


class LeastEnergy(Objective):
    """Saves kinetic energy of the motion that the task asks for."""

    def __init__(self, joints: Joints, mechanism: Mechanism) -> None:
        self._mechanism = mechanism

    def rate(self, view: View) -> Array:
        """Return the joint rates (n,) that lead to the least energy at a gain of 1 [rad/s]."""
        return saving(view.dq_task, view.null, self._mechanism.mass_matrix(view.q))


def saving(dq_task: Array, null: Array, M: Array) -> Array:
    """Return z (n,) [rad/s] for the task's rates (n,) and the mass matrix M (n, n).

    `null` (n − rank, n) has orthonormal rows that span the spare motions.
    """
    z = np.zeros(len(dq_task))
    _save(dq_task, null, M, z)
    return z


@compiled(VECTOR, MATRIX, MATRIX, ROW)
def _save(dq_task: Array, null: Array, M: Array, z: Array) -> None:
    n = len(dq_task)
    momentum = np.zeros(n)
    for i in range(n):
        for j in range(n):
            momentum[i] += M[i, j] * dq_task[j]
    E = null.copy()
    ME = np.empty(E.shape)
    for r in range(len(E)):
        for before in range(r):
            common = 0.0
            for i in range(n):
                common += E[r, i] * ME[before, i]
            for i in range(n):
                E[r, i] -= common * E[before, i]
        size2 = saved = 0.0
        for i in range(n):
            ME[r, i] = _MASSLESS * E[r, i]
            for j in range(n):
                ME[r, i] += M[i, j] * E[r, j]
            size2 += E[r, i] * ME[r, i]
            saved += E[r, i] * momentum[i]
        for i in range(n):
            z[i] -= saved / size2 * E[r, i]
            ME[r, i] /= size2  # so that E need not be made of size one
