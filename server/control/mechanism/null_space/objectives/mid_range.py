"""Keep joints near the middle of their range (Scott & Carignan 2008, eqs. 17–19, as a rate)."""

import numpy as np

from ....joints import Joints
from ....spatial import Array
from ...kinematics import Mechanism
from ..objective import Objective, View

WIDEST = np.pi
"""Ranges beyond ±π pull no harder than this one [rad]."""


class MidRange(Objective):
    """A spring to mid-range, weaker for joints with more room."""

    def __init__(self, joints: Joints, mechanism: Mechanism) -> None:
        self._middle = 0.5 * (joints.lower + joints.upper)
        half = np.minimum(0.5 * (joints.upper - joints.lower), WIDEST)
        self._weight = half.min() / half

    def rate(self, view: View) -> Array:
        """Return the joint rates (n,) to mid-range, for a gain of 1 /s [rad/s]."""
        return np.asarray(self._weight * (self._middle - view.q))
