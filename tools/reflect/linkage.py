"""Kinematics of a desktop device: three motors at its base, and a passive gimbal at its end."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

UPPER = 0.14
"""From the shoulder to the elbow [m]."""
FORE = 0.14
"""From the elbow to the gimbal [m]."""


def place(q: Array) -> Array:
    """Return the gimbal's centre (3,) [m] from where it is at q = 0; base axes, z up.

    q (3,) [rad]: the base's turn about z, the upper link's pitch over the horizontal, and the fore
    link's over the vertical, both from the base by a parallel linkage.
    """
    turn, upper, fore = q.tolist()
    reach = UPPER * math.cos(upper) + FORE * math.sin(fore)
    height = UPPER * math.sin(upper) - FORE * math.cos(fore)
    return np.array([reach * math.cos(turn) - UPPER, reach * math.sin(turn), height + FORE])


def jacobian(q: Array) -> Array:
    """Return J_HC (6, 3): the handle's twist is J_HC dq, and joint torques are J_HCᵀ wrench.

    The gimbal is free, so the motors neither turn the handle nor exert a moment on it.
    """
    turn, upper, fore = q.tolist()
    c, s = math.cos(turn), math.sin(turn)
    reach = UPPER * math.cos(upper) + FORE * math.sin(fore)
    out, fore_out = -UPPER * math.sin(upper), FORE * math.cos(fore)
    J = np.zeros((6, 3))
    J[:3] = [
        [-reach * s, out * c, fore_out * c],
        [reach * c, out * s, fore_out * s],
        [0.0, UPPER * math.cos(upper), FORE * math.sin(fore)],
    ]
    return J
