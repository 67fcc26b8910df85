"""How fast a gap may close: only so fast that the arm can still stop before it is used up.

v ≤ √(b² + 2 a' d) − b with b = a'·lag + w, where d is the room, less the way w·lag of something
that comes nearer at w meanwhile; a' a part of the deceleration that the joints have along the gap;
lag the time that jerk and period take before braking acts.
"""

from typing import NamedTuple

import numpy as np

from ..frames import Array

BRAKING = 0.7
"""Part a'/A of the deceleration that is counted on."""

RETURN_RATE = 1.0
"""Inside a bound the gap is widened at this rate [1/s], times how far inside it is."""

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
        self._jerk = jerk
        self._period_s = period_s

    def lag(self, factor: float) -> float:
        """Return the time before braking acts [s]; `factor` scales the acceleration."""
        ramp = float((self._acceleration / self._jerk).max())
        return 2.0 * (factor * ramp + self._period_s)

    def stop_way(self, speed: Array, factor: float) -> Array:
        """Return how far each joint goes at most until it stands, from a speed (n,) [rad/s]."""
        braking = 0.5 * speed / (factor * self._acceleration)
        return np.asarray(speed * (self.lag(factor) + braking))

    def deceleration(self, slopes: Array, factor: float) -> Array:
        """Return what is counted on along gaps with slopes (m, n) [m/s²].

        Of all motions with one approach speed, the one with the least joint rates brakes like this.
        """
        size = np.abs(slopes)
        slowest = (size / self._acceleration).max(axis=1)
        return np.asarray(BRAKING * factor * (size * size).sum(axis=1) / np.maximum(slowest, 1e-12))

    def rows(self, slopes: Array, room: Array, closing: Array, factor: float, widen: bool) -> Rows:
        """Return the barriers of gaps with slopes (m, n), room (m,) [m] and closing speed [m/s].

        With `widen`, a gap beyond its bound is widened gently; else it just does not close.
        """
        lag = self.lag(factor)
        a = self.deceleration(slopes, factor)
        b = a * lag + closing
        left = room - closing * lag
        speed = np.sqrt(b * b + 2.0 * a * np.maximum(left, 0.0)) - b
        if widen:
            back = np.minimum(RETURN_RATE * np.maximum(-room, 0.0), RETURN_SPEED)
            speed = speed - np.where(closing > 0.0, 0.0, back)
        return Rows(slopes, -speed)
