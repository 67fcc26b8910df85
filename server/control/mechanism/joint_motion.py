"""Joints that are commanded directly: jogged one by one, or led to a posture."""

import numpy as np

from ..barriers.joint_limits import JointRoom
from ..parameters import Parameters
from ..spatial import Array
from ..state import Inputs, Intent

GAIN = 4.0
"""Approach to a posture close to it [1/s]."""

REACHED = 2e-4
"""A posture is reached within this angle of every joint [rad]."""


class JointMotion:
    """What is asked of the joints of one cell, in place of a tool motion."""

    def __init__(self, p: Parameters, room: JointRoom) -> None:
        self._velocity, self._room = p.velocity, room

    def rates(self, q: Array, inputs: Inputs) -> Array | None:
        """Return joint rates (n,) at q (n,): the jog's, else a posture's; None for neither.

        Towards a posture all joints go in a straight line, as fast as each can still stop at it.
        """
        if inputs.intent is not Intent.MOVE:
            return None
        if inputs.jog is not None:
            return inputs.jog
        if inputs.posture is None:
            return None
        error = inputs.posture - q
        size = np.maximum(np.abs(error), 1e-9)
        fastest = np.minimum(
            self._room.approach(size), inputs.settings.speed_factor * self._velocity
        )
        return np.asarray(error * min(GAIN, float((fastest / size).min())))


def at_posture(q: Array, posture: Array) -> bool:
    """Return whether joints at q (n,) have reached a posture (n,)."""
    return bool(np.abs(posture - q).max() < REACHED)
