"""How fast each joint may go, given the room ahead of it: joint limits and the leash.

A joint may approach a limit only as fast as it can still stop before it:
v ≤ √(b² + 2 a' d) − b with b = a'·lag, d the room, a' a part of the deceleration, and lag the
time that jerk and period take before braking acts. The leash slows a command that runs ahead of
its joint, from half its length on. Motion away is always free.
"""

from typing import NamedTuple

import numpy as np

from ..frames import Array

BRAKING = 0.7
"""Part a'/A of the deceleration that is counted on."""

RETURN_RATE = 1.0
"""A joint beyond its bound is led back at this rate [1/s], times how far it is."""


class Room(NamedTuple):
    """Bounds on joint rates (n,) [rad/s], and which joint is near what."""

    low: Array
    high: Array


class JointRoom:
    """Rate bounds from position limits and from the leash, for n joints."""

    def __init__(
        self,
        lower: Array,
        upper: Array,
        acceleration: Array,
        jerk: Array,
        velocity: Array,
        leash: Array,
        period_s: float,
    ) -> None:
        self._lower = lower
        self._upper = upper
        self._a = BRAKING * acceleration
        self._b = self._a * 2.0 * (acceleration / jerk + period_s)
        self._velocity = velocity
        self._leash = leash

    def approach(self, room: Array) -> Array:
        """Return the greatest rate (n,) towards a bound that is `room` (n,) [rad] away."""
        inside = np.maximum(room, 0.0)
        speed = np.sqrt(self._b**2 + 2.0 * self._a * inside) - self._b
        return np.asarray(np.where(room >= 0.0, speed, RETURN_RATE * room))

    def limits(self, q: Array) -> Room:
        """Return the rate bounds that joint limits set at q (n,) [rad]."""
        return Room(-self.approach(q - self._lower), self.approach(self._upper - q))

    def leash(self, following_error: Array) -> Room:
        """Return the rate bounds that the leash sets; `following_error` is command − joint."""
        # Beyond the leash a command may stand still: the drive, not the command, comes back.
        ahead = following_error / self._leash
        low = -self._velocity * np.clip(2.0 * (1.0 + ahead), 0.0, 1.0)
        high = self._velocity * np.clip(2.0 * (1.0 - ahead), 0.0, 1.0)
        return Room(low, high)
