"""The last check before the bus: finite, bounded, continuous with what was sent, or refused.

It never clamps: a refused command means the quick stop, with the reason.
"""

import numpy as np

from .frames import Array

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
        self._steps = (
            ("speed", "rad/s", T, more * velocity * T + 2 * ROUNDING),
            ("acceleration", "rad/s²", T**2, more * acceleration * T**2 + 4 * ROUNDING),
            ("jerk", "rad/s³", T**3, more * jerk * T**3 + 8 * ROUNDING),
        )

    def refusal(self, q: Array, sent: tuple[Array, Array, Array]) -> str | None:
        """Return why posture q (n,) may not be sent after `sent` (newest first), or None."""
        if not np.isfinite(q).all():
            j = int(np.argmin(np.isfinite(q)))
            return f"{self._joints[j]}: command is {q[j]}"
        last = sent[0]
        low = np.minimum(self._lower, last) - ROUNDING
        high = np.maximum(self._upper, last) + ROUNDING
        if (q < low).any() or (q > high).any():
            j = int(np.argmax(np.maximum(low - q, q - high)))
            return (
                f"{self._joints[j]}: position {q[j]:.6f} outside "
                f"{self._lower[j]:.6f} to {self._upper[j]:.6f} rad"
            )
        first = q - sent[0]
        second = first - (sent[0] - sent[1])
        third = second - (sent[0] - 2.0 * sent[1] + sent[2])
        for difference, (name, unit, scale, bound) in zip(
            (first, second, third), self._steps, strict=True
        ):
            size = np.abs(difference)
            if (size > bound).any():
                j = int(np.argmax(size / bound))
                return (
                    f"{self._joints[j]}: {name} {difference[j] / scale:.4g} beyond "
                    f"{bound[j] / scale:.4g} {unit}"
                )
        return None
