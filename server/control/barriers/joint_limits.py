"""How fast each joint may go, given the room ahead of it: joint limits and the leash.

A joint may approach a limit only as fast as it can still stop before it:
v ≤ √(b² + 2 a' d) − b with b = a'·lag, d the room, a' a part of the deceleration, and lag the
time that jerk and period take before braking acts. The leash slows a command that runs ahead of
its joint, from half its length on. Motion away is always free. A joint that stands outside its
limits may stay there or come in, and is not led: enabling an arm moves nothing.
"""

import math
from typing import NamedTuple, Self

import numpy as np

from ..compiled import ROW, VECTOR, compiled
from ..joints import Joints
from ..scene import Index
from ..spatial import Array
from .resisted import Resistance, Resisted, slow

BRAKING = 0.7
"""Part a'/A of the deceleration that is counted on."""


class Room(NamedTuple):
    """Bounds on joint rates (n,) [rad/s], and which joint is near what."""

    low: Array
    high: Array

    def left_by(self, dq: Array) -> list[int]:
        """Return the joints whose rates dq (n,) [rad/s] are outside."""
        outside: list[int] = _outside(dq, self.low, self.high).tolist()
        return outside


class Within(NamedTuple):
    """Joint rates inside their speed bounds, and the bounds that all barriers of joints set."""

    dq: Array
    """All scaled by one share (n,) [rad/s]."""
    share: float
    low: Array
    """Never above `high` (n,) [rad/s]."""
    high: Array
    beyond: bool
    """True where dq is not inside these."""


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
        window: Array | None = None,
    ) -> None:
        self._lower = lower
        self._upper = upper
        self._a = BRAKING * acceleration
        self._b = self._a * 2.0 * (acceleration / jerk + period_s)
        self._velocity = velocity
        self._leash = leash
        self._window = 2.0 * leash if window is None else window
        self._period_s = period_s

    @classmethod
    def of(cls, joints: Joints, period_s: float) -> Self:
        """Build that of one mechanism's joints."""
        return cls(
            joints.lower,
            joints.upper,
            joints.acceleration,
            joints.jerk,
            joints.velocity,
            joints.leash,
            period_s,
            # A window that is wider is for joints that a collision throws back, not for commands.
            np.minimum(joints.following_window, 2.0 * joints.leash),
        )

    def within(self, dq: Array, most: Array, q: Array, error: Array) -> Within:
        """Return rates dq (n,) scaled to the bounds `most` (n,), and what all bounds allow.

        `q` (n,) and what the command is ahead of the joints, `error` (n,), set the others.
        """
        scaled, low, high = np.empty(len(q)), np.empty(len(q)), np.empty(len(q))
        share, beyond = _bound(
            dq, most, q, self._lower, self._upper, self._a, self._b,
            error, self._leash, self._velocity, scaled, low, high,
        )  # fmt: skip
        return Within(scaled, share, low, high, beyond)

    def resisted(
        self, dq: Array, now: Array, way: Array, error: Array, memory: Resistance | None
    ) -> Resisted:
        """Return what is left of rates dq (n,) so that joints keep their following windows.

        Joints go at `now` (n,), and went the `way` (n,) in the tick whose effect is seen; the
        command is ahead of them by `error` (n,).
        """
        if memory is None:
            return Resisted(1.0, -1, Resistance(error, np.zeros(len(error))))
        pressed = np.zeros(len(error))
        share, joint = slow(
            dq, now, way, error, *memory, self._leash, self._window, self._velocity,
            self._a, self._b, self._period_s, pressed,
        )  # fmt: skip
        return Resisted(share, joint, Resistance(error, pressed))

    def approach(self, room: Array) -> Array:
        """Return the greatest rate (n,) towards a bound that is `room` (n,) [rad] away.

        It is 0 beyond the bound, where `room` is negative.
        """
        return _approach(room, self._a, self._b)

    def limits(self, q: Array) -> Room:
        """Return the rate bounds that joint limits set at q (n,) [rad]."""
        return Room(-self.approach(q - self._lower), self.approach(self._upper - q))

    def leash(self, following_error: Array) -> Room:
        """Return the rate bounds that the leash sets; `following_error` is command − joint."""
        low, high = np.empty(len(following_error)), np.empty(len(following_error))
        _leash(following_error, self._leash, self._velocity, low, high)
        return Room(low, high)


@compiled(VECTOR, VECTOR, VECTOR)
def _approach(room: Array, a: Array, b: Array) -> Array:
    out = np.empty(len(room))
    for j in range(len(room)):
        if room[j] >= 0.0:
            out[j] = math.sqrt(b[j] ** 2 + 2.0 * a[j] * room[j]) - b[j]
        else:
            out[j] = 0.0
    return out


@compiled(VECTOR, VECTOR, VECTOR, ROW, ROW)
def _leash(error: Array, leash: Array, velocity: Array, low: Array, high: Array) -> None:
    # Beyond the leash a command may stand still: the drive, not the command, comes back.
    for j in range(len(error)):
        ahead = error[j] / leash[j]
        low[j] = -velocity[j] * min(1.0, max(0.0, 2.0 * (1.0 + ahead)))
        high[j] = velocity[j] * min(1.0, max(0.0, 2.0 * (1.0 - ahead)))


@compiled(
    VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, ROW, ROW, ROW
)
def _bound(
    dq: Array, most: Array, q: Array, lower: Array, upper: Array, a: Array, b: Array,
    error: Array, leash: Array, velocity: Array, scaled: Array, low: Array, high: Array,
) -> tuple[float, bool]:  # fmt: skip
    """Write the arrays of `Within`, and return its share and whether its rates are beyond."""
    n = len(q)
    fastest = 1.0
    for j in range(n):
        ratio = abs(dq[j]) / most[j]
        if not ratio <= fastest:  # what is not a number is not hidden
            fastest = ratio
    share = 1.0 / fastest
    below, above = np.empty(n), np.empty(n)
    for j in range(n):
        below[j], above[j] = q[j] - lower[j], upper[j] - q[j]
    below, above = _approach(below, a, b), _approach(above, a, b)
    _leash(error, leash, velocity, low, high)
    beyond = False
    for j in range(n):
        scaled[j] = share * dq[j]
        if abs(scaled[j]) > most[j]:  # by rounding, which is no reason to name a limit
            scaled[j] = math.copysign(most[j], scaled[j])
        least = max(-below[j], low[j], -most[j])
        greatest = min(above[j], high[j], most[j])
        low[j], high[j] = min(least, greatest), max(least, greatest)
        beyond = beyond or scaled[j] < low[j] or scaled[j] > high[j]
    return share, beyond


@compiled(VECTOR, VECTOR, VECTOR)
def _outside(dq: Array, low: Array, high: Array) -> Index:
    found, count = np.empty(len(dq), dtype=np.int64), 0
    for j in range(len(dq)):
        if dq[j] < low[j] or dq[j] > high[j]:
            found[count] = j
            count += 1
    return found[:count].copy()
