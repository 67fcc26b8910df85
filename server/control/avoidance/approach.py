"""How fast a gap may close: only so fast that the arm can still stop before it is used up.

v ≤ √(b² + 2 a' d) − b with b = a'·lag + w, where d is the room, less the way w·lag of something
that comes nearer at w meanwhile; a' a part of the deceleration that the joints have along the gap;
lag the time that jerk and period take before braking acts.
"""

import math
from typing import NamedTuple

import numpy as np

from ..compiled import FLAG, MATRIX, NUMBER, VECTOR, compiled
from ..frames import Array

BRAKING = 0.7
"""Part a'/A of the deceleration that is counted on."""

RETURN_RATE = 1.0
"""Inside a bound the gap is widened at this rate [1/s], times how far inside it is, or will be
before anything can be done about what comes."""

RETURN_SPEED = 0.02
"""And at most so fast [m/s]."""


class Rows(NamedTuple):
    """Barriers on joint rates: A dq ≥ low."""

    A: Array
    """(m, n)."""
    low: Array
    """(m,)."""


class Braking:
    """What n joints can brake, at full or reduced acceleration."""

    def __init__(self, acceleration: Array, jerk: Array, period_s: float) -> None:
        self._acceleration = acceleration
        self._ramp_s = float((acceleration / jerk).max())
        self._period_s = period_s

    def lag(self, factor: float) -> float:
        """Return the time before braking acts [s]; `factor` scales the acceleration."""
        return 2.0 * (factor * self._ramp_s + self._period_s)

    def stop_way(self, speed: Array, factor: float) -> Array:
        """Return how far each joint goes at most until it stands, from a speed (n,) [rad/s]."""
        braking = 0.5 * speed / (factor * self._acceleration)
        return np.asarray(speed * (self.lag(factor) + braking))

    def rows(self, slopes: Array, room: Array, closing: Array, factor: float, widen: bool) -> Rows:
        """Return the barriers of gaps with slopes (m, n), room (m,) [m] and closing speed [m/s].

        With `widen`, a gap beyond its bound is widened gently; else it just does not close.
        """
        lag, acceleration = self.lag(factor), factor * self._acceleration
        return Rows(slopes, -_speeds(slopes, room, closing, acceleration, lag, widen))


@compiled(MATRIX, VECTOR, VECTOR, VECTOR, NUMBER, FLAG)
def _speeds(
    slopes: Array, room: Array, closing: Array, acceleration: Array, lag: float, widen: bool
) -> Array:
    """Return the speeds (m,) [m/s] at which gaps may close: the law of this page.

    Of all motions with one approach speed, the one with the least joint rates has the deceleration
    that is counted on; `acceleration` (n,) is the joints'.
    """
    found = np.empty(len(slopes))
    for i in range(len(slopes)):
        size2, slowest = 0.0, 1e-12
        for j in range(len(acceleration)):
            size2 += slopes[i, j] * slopes[i, j]
            slowest = max(slowest, abs(slopes[i, j]) / acceleration[j])
        a = BRAKING * size2 / slowest
        b = a * lag + closing[i]
        left = room[i] - closing[i] * lag
        found[i] = math.sqrt(b * b + 2.0 * a * max(left, 0.0)) - b
        if widen:
            found[i] -= min(RETURN_RATE * max(-left, 0.0), RETURN_SPEED)
    return found
