"""How fast a gap may close: only so fast that the arm can still stop before it is used up.

v ≤ √(b² + 2 a' d) − b with b = a'·lag + w, where d is the room, less the way w·lag of something
that comes nearer at w meanwhile; a' a part of the deceleration that the joints have along the gap;
lag the time that jerk and period take before braking acts.

What news shows to come at u > 0 is made way for: the gap is to change at least at u − v, and where
the room is used up by more, at k times that, up to `CATCH_UP` u. So a gap that something closes
comes to rest where it just cannot be lost, and opens again before what was late is.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..compiled import FLAG, MARKS, MATRIX, NUMBER, ROW, TABLE, VECTOR, compiled
from ..scene import Flags
from ..spatial import Array

BRAKING = 0.7
"""Part a'/A of the deceleration that is counted on."""

RETURN_RATE = 1.0
"""Inside a bound the gap is widened at this rate [1/s], times how far inside it is, or will be
before anything can be done about what comes."""

RETURN_SPEED = 0.02
"""And at most so fast [m/s]."""

ASIDE_RATE = 10.0
"""k: inside the bound to something that comes, the gap is widened at this rate [1/s] …"""

CATCH_UP = 2.0
"""… and at most at so many times the speed at which it comes [1]."""


class Rows(NamedTuple):
    """Barriers on joint rates: A dq ≥ low."""

    A: Array
    """(m, n)."""
    low: Array
    """(m,)."""

    @staticmethod
    def of_all(each: "Sequence[Rows]") -> "Rows":
        """Return several as one."""
        return each[0] if len(each) == 1 else Rows(*map(np.concatenate, zip(*each, strict=True)))

    def concern(self, which: Flags, part: slice) -> bool:
        """Return whether any of those that are flagged (m,) has a slope in some joints."""
        return bool(self.A[which, part].any())

    def broken(self, dq: Array) -> tuple[Flags, bool]:
        """Return which of them (m,) the rates dq (n,) [rad/s] break, and whether any."""
        which = np.empty(len(self.low), dtype=bool)
        return which, _break(self.A, self.low, dq, which) > 0


class Walled(NamedTuple):
    """The tool between walls; their slopes are the first three rows of J, and those negated."""

    J: Array
    """Jacobian of the MRF (6, n)."""
    p: Array
    """Where it is (3,) [m]."""
    low: Array
    """Where it has no room left (3,) [m], or (0,): there are no walls."""
    high: Array


class Braking:
    """Braking ability of n joints, at full or reduced acceleration."""

    def __init__(self, acceleration: Array, jerk: Array, period_s: float) -> None:
        self.acceleration = acceleration
        """The joints' in full (n,) [rad/s²]."""
        self._ramp_s = float((acceleration / jerk).max())
        self._period_s = period_s

    def lag(self, factor: float) -> float:
        """Return the time before braking acts [s]; `factor` scales the acceleration."""
        return 2.0 * (factor * self._ramp_s + self._period_s)

    def rows(
        self,
        slopes: Array,
        room: Array,
        closing: tuple[Array, Array],
        tool: Walled,
        factor: float,
        widen: bool,
    ) -> Rows:
        """Return the barriers of gaps with slopes (k, n) and room (k,) [m].

        `closing` are the speeds (k,) [m/s] at which the other side may come nearer, and at which it
        comes and is made way for. Then those of the walls, low ones first. With `widen`, a gap
        beyond its bound is widened gently; else it just does not close.
        """
        acceleration, lag = self.acceleration, self.lag(factor)
        count, n = len(slopes) + 2 * len(tool.low), len(acceleration)
        found = Rows(np.empty((count, n)), np.empty(count))
        _damp(slopes, room, *closing, *tool, acceleration, factor, lag, widen, *found)
        return found


@compiled(
    MATRIX, VECTOR, VECTOR, VECTOR, MATRIX, VECTOR, VECTOR, VECTOR, VECTOR,
    NUMBER, NUMBER, FLAG, TABLE, ROW,
)  # fmt: skip
def _damp(
    gaps: Array, room: Array, closing: Array, coming: Array,
    J: Array, p: Array, low: Array, high: Array,
    acceleration: Array, factor: float, lag: float, widen: bool, slopes: Array, least: Array,
) -> None:  # fmt: skip
    """Write slopes (k + w, n) of gaps and walls, and the rates (k + w,) [m/s] they keep above.

    The law of this page. Of all motions with one approach speed, the one with the least joint rates
    has the deceleration that is counted on; `factor` times `acceleration` (n,) is the joints'.
    """
    k, n = gaps.shape
    m = k + 2 * len(low)
    for i in range(m):
        if i < k:
            slopes[i], left, comes, u = gaps[i], room[i], closing[i], coming[i]
        else:
            axis = (i - k) % 3
            down, comes, u = i < k + 3, 0.0, 0.0
            left = p[axis] - low[axis] if down else high[axis] - p[axis]
            for j in range(n):
                slopes[i, j] = J[axis, j] if down else -J[axis, j]
        size2, slowest = 0.0, 1e-12
        for j in range(n):
            size2 += slopes[i, j] * slopes[i, j]
            slowest = max(slowest, abs(slopes[i, j]) / (factor * acceleration[j]))
        a = BRAKING * size2 / slowest
        b = a * lag + comes
        left -= comes * lag
        least[i] = b - math.sqrt(b * b + 2.0 * a * max(left, 0.0))
        aside = u + least[i]
        if widen:
            least[i] += min(RETURN_RATE * max(-left, 0.0), RETURN_SPEED)
        if u > 0.0:
            least[i] = max(least[i], aside, min(ASIDE_RATE * max(-left, 0.0), CATCH_UP * u))


@compiled(MATRIX, VECTOR, VECTOR, MARKS)
def _break(A: Array, low: Array, dq: Array, broken: Flags) -> int:
    """Write which barriers (m,) the rates dq (n,) break, and return how many."""
    count = 0
    for i in range(len(low)):
        rate = 0.0
        for j in range(len(dq)):
            rate += A[i, j] * dq[j]
        broken[i] = rate < low[i]
        count += broken[i]
    return count
