"""Joints that are commanded directly: jogged one by one, led to a posture, or beside the tool.

The rates z of joints that fold are both a source's, J z, and a redundancy objective's, the rest
(`reflex` in either table).
"""

from collections.abc import Callable
from typing import Final

import numpy as np

from ..inputs import Fold
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

    def folding(self, fold: Fold, q: Array, J: Array, factor: float) -> Array:
        """Return joint rates (n,) from q (n,) to a posture that the arm folds to, in proportion.

        J (6, n) is the tool's, `factor` the reduced-speed setting.
        """
        goal = np.where(np.isnan(fold.posture), q, fold.posture)
        dq = self.rates(q, None, goal, factor)
        if dq is None:
            return np.zeros(len(q))
        v = float(np.linalg.norm(J[:3] @ dq))
        return dq * min(1.0, factor * fold.speed / max(v, 1e-12))


def at_posture(q: Array, posture: Array) -> bool:
    """Return whether joints at q (n,) have reached a posture (n,)."""
    return bool(np.abs(posture - q).max() < REACHED)


FOLDING: Final = "reflex"
"""Name of what folds an arm, among the sources and the objectives."""
