"""How much of a measured wrench is answered at once, when the load may not be as declared.

A load of mass m that is declared and is not there reads like a force −m a, with a how the tool
accelerates: to answer it feeds a back, with m times the mobility that the tool has without it, and
with the delay of bus and drives. From about 1 on the arm swings by itself. So what lasts is
answered in full, and of what changes as large a share as keeps that product at `GAIN`. It stays
above `LEAST`: the same load makes the law's own loop too stiff, which the answer makes up for.
"""

import math

import numpy as np

from ..compiled import MATRIX, NUMBER, VECTOR, compiled
from ..spatial import Array

GAIN = 1.0
"""The feedback of an acceleration by a load that is not there, at most [1]."""
LEAST = 0.2
"""The share of a change that is always answered at once [1]."""
LASTS_HZ = 2.0
"""Corner of the low-pass that tells what lasts [Hz]."""


@compiled(MATRIX, MATRIX, VECTOR, NUMBER)
def share_at_once(inverse: Array, J: Array, at: Array, mass: float) -> float:
    """Return the share (0 to 1) of a wrench's change that is answered at once.

    `inverse` (n, n) is M⁻¹ with the load of `mass` [kg], which is at `at` (3,) [m] in the frame of
    J (6, n). The mobility is judged by its Frobenius norm, 1 to √3 times that of the freest way.
    """
    n = J.shape[1]
    of_load = np.empty((3, n))
    for j in range(n):
        of_load[0, j] = J[0, j] + J[4, j] * at[2] - J[5, j] * at[1]
        of_load[1, j] = J[1, j] + J[5, j] * at[0] - J[3, j] * at[2]
        of_load[2, j] = J[2, j] + J[3, j] * at[1] - J[4, j] * at[0]
    squares = 0.0
    for a in range(3):
        for b in range(3):
            mobility = 0.0
            for i in range(n):
                for j in range(n):
                    mobility += of_load[a, i] * inverse[i, j] * of_load[b, j]
            squares += mobility * mobility
    part = mass * math.sqrt(squares)  # of the inertia that moves with it; without it, 1 − part
    if part <= GAIN * (1.0 - part):
        return 1.0
    return max(LEAST, GAIN * (1.0 - part) / part)


@compiled(MATRIX, VECTOR, VECTOR, NUMBER)
def held_back(J: Array, wrench: Array, lasting: Array, share: float) -> Array:
    """Return the joint torques (n,) of a wrench (6,) that are not answered at once [N·m]."""
    out = np.zeros(J.shape[1])
    for j in range(len(out)):
        for i in range(6):
            out[j] += (1.0 - share) * J[i, j] * (wrench[i] - lasting[i])
    return out
