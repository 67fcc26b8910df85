"""Acceleration and jerk limits, the verified stop, and the gate: the last check before the bus."""

import math
from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from ..compiled import MATRIX, VECTOR, compiled
from ..joints import Joints
from ..spatial import Array, Motion, nonzero
from .profile import Stop
from .trajectory import TrajectoryError, VelocityPlanner

# --- Acceleration and jerk limits, and the verified stop that makes every command safe ------------
#
# A step is accepted only if, from the state it leads to, the stop of all joints stays inside
# the joint limits all the way, or is no worse than the stop already held in every bound that is
# broken. If not, half the target is tried, a fifth, and among things a twentieth with a stop
# that keeps the joints' shares; then the stop verified one tick earlier goes on. So there is
# always a known way to rest.
#
# Joints that mean something only together, as of two arms on one payload, are a group: they
# stop in proportion, along a straight line.
#
# A judge may have more to say about a stop: by how much it falls short of what is to be kept.
# News from outside may make even the stored stop fall short; then the least bad one is taken.

HEADROOM = 0.9999
"""Part of each bound that is planned with, so that rounding stays inside."""

Way = Literal["together", "apart", "straight"]
"""How joints get to their rates: at the same time, each as soon as it can, or keeping their shares,
then also to rest. Between things on all sides only a straight way, and a straight stop, may open
every gap."""

ATTEMPTS: tuple[tuple[float, Way], ...] = (
    (1.0, "together"), (0.5, "apart"), (0.2, "apart"), (0.05, "straight"),
)  # fmt: skip
"""Parts of the target rates that are tried, and how; the last only where clearances are kept."""


class Limited(NamedTuple):
    """The next commanded motion, and the stop that is verified from it."""

    motion: Motion
    stop: Stop
    stopped: bool
    """True when the stop of the tick before had to take over."""
    worsened: bool = False
    """True when news made even the stop of the tick before fall short of what is to be kept."""


class Commanded(NamedTuple):
    """What joints were last told."""

    motion: Motion
    """What the drives were last told to reach."""
    stop: Stop
    """The verified way to rest from there."""
    sent: tuple[Array, Array, Array]
    """The last three commanded postures (n,), newest first [rad]."""

    @staticmethod
    def at_rest(q: Array) -> "Commanded":
        """Return that of joints at rest at q (n,) that were told nothing else yet."""
        return Commanded(Motion.at_rest(q), Stop.at_rest(q), (q, q, q))

    def followed_by(self, limited: Limited) -> "Commanded":
        """Return the same once the joints are told the next motion."""
        return Commanded(limited.motion, limited.stop, (limited.motion.q, *self.sent[:2]))

    def of(self, part: slice) -> "Commanded":
        """Return that of some joints."""
        a, b, c = self.sent
        return Commanded(self.motion.of(part), self.stop.of(part), (a[part], b[part], c[part]))


StopConstraint = Callable[[Stop], float]
"""By how much a stop falls short of what is to be kept [m]; 0 for one that keeps everything."""

WORSE = 1e-3
"""The stored stop has become worse when it falls short by more than this [m]."""


class Limiter:
    """Keeps joint rates inside acceleration, jerk and position bounds, all (n,)."""

    def __init__(
        self,
        joints: Joints,
        period_s: float,
        groups: Sequence[Sequence[int]] = (),
        parts: Sequence[slice] = (),
    ) -> None:
        """Build it; joints of a group (indices) stop in proportion, others as soon as they can.

        Those of each part, as of one arm, get to their rates together; all where there are none.
        """
        self._lower, self._upper = joints.lower, joints.upper
        self._velocity, self._period_s = (1.0 + TOLERANCE) * joints.velocity, period_s
        self._planner = VelocityPlanner(
            HEADROOM * joints.acceleration, HEADROOM * joints.jerk, groups, parts
        )

    def verified_stop(self, motion: Motion) -> Stop:
        """Return the stop from a motion."""
        return self._planner.stop(motion)

    def step(
        self,
        motion: Motion,
        held: Stop,
        target: Array,
        factor: float,
        judge: StopConstraint | None = None,
    ) -> Limited:
        """Return the motion one period later on the way to joint rates `target` (n,).

        `held` is the stop verified from `motion`; `factor` is the reduced-speed setting, which
        scales the acceleration of joints that are no faster than it allows (speeds are scaled
        before, jerk stays: it decides how promptly the arm reacts). It scales no stop.
        """
        beyond = factor < 1.0 and bool((np.abs(motion.dq) > factor * self._velocity).any())
        self._planner.scale(1.0 if beyond else factor)
        if not nonzero(target) and motion.stands():
            return Limited(motion, held, False)
        least, least_bad = np.inf, None
        for part, way in ATTEMPTS if judge is not None else ATTEMPTS[:3]:
            try:
                candidate, stop = self._tried(motion, target if part == 1.0 else part * target, way)
            except TrajectoryError:
                continue
            if _leaves(stop.low, stop.high, held.low, held.high, self._lower, self._upper):
                continue
            short = 0.0 if judge is None else judge(stop)
            if short <= 0.0:
                return Limited(candidate, stop, False)
            if short < least:
                least, least_bad = short, Limited(candidate, stop, False, worsened=True)
        if judge is not None:
            short = judge(held)
            if short > WORSE:
                return (
                    least_bad if least_bad is not None and least < short else self.go_on(held, True)
                )
        return self.go_on(held)

    def _tried(self, motion: Motion, target: Array, way: Way) -> tuple[Motion, Stop]:
        if way == "straight":
            return self._planner.straight(motion, target, self._period_s)
        return self._planner.step_and_stop(motion, target, self._period_s, way == "together")

    def go_on(self, held: Stop, worsened: bool = False) -> Limited:
        """Return the motion one period further along a verified stop."""
        stop = held.advanced(self._period_s)
        motion = stop.at(0.0)
        motion = Motion.at_rest(motion.q) if stop.finished else motion
        return Limited(motion, stop, True, worsened)


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR)
def _leaves(
    low: Array, high: Array, held_low: Array, held_high: Array, lower: Array, upper: Array
) -> bool:
    """Return whether a stop from `low` to `high` (n,) leaves the limits more than the held one."""
    for i in range(len(low)):
        if low[i] < min(lower[i], held_low[i]) or high[i] > max(upper[i], held_high[i]):
            return True
    return False


# --- The last check before the bus: finite, bounded, continuous with what was sent, or refused ----
#
# It never clamps: a refused command means the quick stop, with the reason.

TOLERANCE = 1e-3
"""Relative tolerance of the finite differences [1]."""

ROUNDING = 1e-11
"""Rounding of a joint angle in double precision, generously [rad]."""


class Gate:
    """Bounds (n,) that every sent posture keeps."""

    def __init__(self, joints: Joints, period_s: float) -> None:
        self._joints = joints.names
        self._lower, self._upper = joints.lower, joints.upper
        T = period_s
        more = 1.0 + TOLERANCE
        self._steps = np.array(
            [
                more * joints.velocity * T + 2 * ROUNDING,
                more * joints.acceleration * T**2 + 4 * ROUNDING,
                more * joints.jerk * T**3 + 8 * ROUNDING,
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
