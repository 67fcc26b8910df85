"""The last check before the bus: finite, bounded, continuous with what was sent, or refused.

It never clamps: a refused command means the quick stop, with the reason.
"""

import math

import numpy as np

from ..compiled import MATRIX, VECTOR, compiled
from ..spatial import Array

TOLERANCE = 1e-3
"""Relative tolerance of the finite differences [1]."""

ROUNDING = 1e-11
"""Rounding of a joint angle in double precision, generously [rad]."""


class Gate:
    """Bounds (n,) that every sent posture keeps."""

    def __init__(
        self,
        joints: tuple[str, ...],
        lower: Array,
        upper: Array,
        velocity: Array,
        acceleration: Array,
        jerk: Array,
        period_s: float,
    ) -> None:
        self._joints = joints
        self._lower = lower
        self._upper = upper
        T = period_s
        more = 1.0 + TOLERANCE
        self._steps = np.array(
            [
                more * velocity * T + 2 * ROUNDING,
                more * acceleration * T**2 + 4 * ROUNDING,
                more * jerk * T**3 + 8 * ROUNDING,
            ]
        )
        self._units = (("speed", "rad/s", T), ("acceleration", "rad/s²", T**2),
                       ("jerk", "rad/s³", T**3))  # fmt: skip

    def refusal(self, q: Array, sent: tuple[Array, Array, Array]) -> str | None:
        """Return why posture q (n,) may not be sent after `sent` (newest first), or None."""
        what, j, value = _broken(q, *sent, self._lower, self._upper, self._steps)
        if what == _FINE:
            return None
        joint = self._joints[j]
        if what == _NO_NUMBER:
            return f"{joint}: command is {q[j]}"
        if what == _OUTSIDE:
            low, high = self._lower[j], self._upper[j]
            return f"{joint}: position {q[j]:.6f} outside {low:.6f} to {high:.6f} rad"
        name, unit, scale = self._units[what]
        bound = self._steps[what, j] / scale
        return f"{joint}: {name} {value / scale:.4g} beyond {bound:.4g} {unit}"


_FINE, _NO_NUMBER, _OUTSIDE = -1, -2, -3
"""Faults beside the order of a difference that is too large: 0, 1 or 2."""


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, MATRIX)
def _broken(
    q: Array, last: Array, second: Array, third: Array, lower: Array, upper: Array, steps: Array
) -> tuple[int, int, float]:
    """Return what is wrong with q (n,), with which joint most, and the difference that is."""
    n = len(q)
    for j in range(n):
        if not np.isfinite(q[j]):
            return _NO_NUMBER, j, q[j]
    worst, most = 0, 0.0
    for j in range(n):
        low = min(lower[j], last[j]) - ROUNDING
        high = max(upper[j], last[j]) + ROUNDING
        beyond = max(low - q[j], q[j] - high)
        if beyond > most:
            worst, most = j, beyond
    if most > 0.0:
        return _OUTSIDE, worst, most
    differences = np.empty((3, n))
    for j in range(n):
        differences[0, j] = q[j] - last[j]
        differences[1, j] = differences[0, j] - (last[j] - second[j])
        differences[2, j] = differences[1, j] - (last[j] - 2.0 * second[j] + third[j])
    for order in range(3):
        most = 1.0
        for j in range(n):
            ratio = abs(differences[order, j]) / steps[order, j]
            if math.isnan(ratio):  # what was sent is no number: no joint behind this one hides it
                return order, j, differences[order, j]
            if ratio > most:
                worst, most = j, ratio
        if most > 1.0:
            return order, worst, differences[order, worst]
    return _FINE, 0, 0.0
