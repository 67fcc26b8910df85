"""How a force/torque sensor that is mounted askew, with cross-talk, answers to a load.

What mounting and cross-talk do together is one matrix, and nobody can tell from outside how much of
it is which: an antisymmetric coupling among the forces *is* a small rotation. So cross-talk means
here what is left when that rotation is counted as mounting: it is symmetric among the forces, and
among the moments.
"""

import numpy as np
from numpy.typing import NDArray

from ...config.schema import RigForceTorque
from ...protocols.robotous import COUNTS_PER_NEWTON, COUNTS_PER_NEWTON_METRE
from .scene import rotation

_LENGTH = COUNTS_PER_NEWTON / COUNTS_PER_NEWTON_METRE
"""The moment that fills the sensor's range as much as a newton does [m]."""


def response(truth: RigForceTorque, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the matrix (6, 6) from the load in the nominal Sensor frame to the reading.

    Cross-talk: each axis shows in each other one of its kind with the part `cross_talk`, and each
    force in each moment with that part of the ranges' ratio; the signs are drawn.
    """
    signs = rng.choice((-1.0, 1.0), size=(6, 6))
    coupling = np.zeros((6, 6))
    for part in (slice(0, 3), slice(3, 6)):
        upper = np.triu(signs[part, part], 1)
        coupling[part, part] = upper + upper.T
    coupling[3:, :3] = _LENGTH * signs[3:, :3]
    R_nominal_true = rotation(truth.mounting_rpy)
    turn = np.kron(np.eye(2), R_nominal_true.T)
    matrix: NDArray[np.float64] = (np.eye(6) + truth.cross_talk * coupling) @ turn
    return matrix
