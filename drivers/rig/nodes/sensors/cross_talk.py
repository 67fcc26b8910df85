"""How a force/torque sensor with cross-talk answers to a load.

Mounting and cross-talk together are one matrix, and nobody can tell from outside how much of it is
which: an antisymmetric coupling among the forces *is* a small rotation. So cross-talk means here
what is left when that rotation is counted as mounting: it is symmetric among the forces, and among
the moments.
"""

import numpy as np
from numpy.typing import NDArray

from .....protocols.canopen.robotous import COUNTS_PER_NEWTON, COUNTS_PER_NEWTON_METRE

_LENGTH = COUNTS_PER_NEWTON / COUNTS_PER_NEWTON_METRE
"""The moment that fills the sensor's range as much as a newton does [m]."""


def response(cross_talk: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the matrix (6, 6) from the load in the Sensor frame to the reading.

    Each axis shows in each other one of its kind with the part `cross_talk`, and each force in each
    moment with that part of the ranges' ratio; the signs are drawn.
    """
    signs = rng.choice((-1.0, 1.0), size=(6, 6))
    coupling = np.zeros((6, 6))
    for part in (slice(0, 3), slice(3, 6)):
        upper = np.triu(signs[part, part], 1)
        coupling[part, part] = upper + upper.T
    coupling[3:, :3] = _LENGTH * signs[3:, :3]
    matrix: NDArray[np.float64] = np.eye(6) + cross_talk * coupling
    return matrix
