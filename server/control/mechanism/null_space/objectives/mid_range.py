"""Keep joints near the middle of their range (Scott & Carignan 2008, eqs. 17–19, as a rate)."""

import numpy as np

from ....spatial import Array

WIDEST = np.pi
"""Ranges beyond ±π pull no harder than this one [rad]."""


class MidRange:
    """A spring to mid-range, weaker for joints with more room."""

    def __init__(self, lower: Array, upper: Array) -> None:
        self._middle = 0.5 * (lower + upper)
        half = np.minimum(0.5 * (upper - lower), WIDEST)
        self._weight = half.min() / half

    def rate(self, q: Array) -> Array:
        """Return the joint rates (n,) at joint angles q (n,) [rad], for a gain of 1 /s [rad/s]."""
        return np.asarray(self._weight * (self._middle - q))
