"""Joints that are commanded directly: jogged one by one, or led to a posture."""

from collections.abc import Callable

import numpy as np

from ..spatial import Array

GAIN = 4.0
"""Approach to a posture close to it [1/s]."""

REACHED = 2e-4
"""A posture is reached within this angle of every joint [rad]."""


class JointMotion:
    """Rates of joints that are commanded themselves, in place of a tool motion."""

    def __init__(self, velocity: Array, approach: Callable[[Array], Array]) -> None:
        """Build it for joints with bounds of speed (n,) [rad/s].

        `approach` gives the rates (n,) at which joints can still stop within ways (n,) [rad].
        """
        self._velocity, self._approach = velocity, approach

    def rates(
        self, q: Array, jog: Array | None, posture: Array | None, speed_factor: float
    ) -> Array | None:
        """Return joint rates (n,) at q (n,): the jog's, else a posture's; None for neither.

        Towards a posture all joints go in a straight line, as fast as each can still stop at it.
        """
        if jog is not None:
            return jog
        if posture is None:
            return None
        error = posture - q
        size = np.maximum(np.abs(error), 1e-9)
        fastest = np.minimum(self._approach(size), speed_factor * self._velocity)
        return np.asarray(error * min(GAIN, float((fastest / size).min())))


def at_posture(q: Array, posture: Array) -> bool:
    """Return whether joints at q (n,) have reached a posture (n,)."""
    return bool(np.abs(posture - q).max() < REACHED)
