"""Acceleration and jerk limits, and the verified stop that makes every command safe.

A step is accepted only if, from the state it leads to, the stop of all joints stays inside the
joint limits all the way, or is no worse than the stop already held in every bound that is broken.
If not, half the target is tried, a fifth, and among things a twentieth with a stop that keeps the
joints' shares; then the stop verified one tick earlier goes on.
So there is always a known way to rest.

Joints that mean something only together, as of two arms on one payload, are a group: they stop in
proportion, along a straight line.

A judge may have more to say about a stop: by how much it falls short of what is to be kept. News
from outside may make even the stored stop fall short; then the least bad one is taken.
"""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from ..compiled import VECTOR, compiled
from ..spatial import Array
from .motion import Motion
from .trajectory import TrajectoryError, VelocityPlanner
from .way_to_rest import Stop

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

    def of(self, part: slice) -> "Limited":
        """Return that of some joints."""
        return Limited(self.motion.of(part), self.stop.of(part), self.stopped, self.worsened)


Judge = Callable[[Stop], float]
"""By how much a stop falls short of what is to be kept [m]; 0 for one that keeps everything."""

WORSE = 1e-3
"""The stored stop has become worse when it falls short by more than this [m]."""


class Limiter:
    """Keeps joint rates inside acceleration, jerk and position bounds, all (n,)."""

    def __init__(
        self,
        lower: Array,
        upper: Array,
        acceleration: Array,
        jerk: Array,
        period_s: float,
        groups: Sequence[Sequence[int]] = (),
        parts: Sequence[slice] = (),
    ) -> None:
        """Build it; joints of a group (indices) stop in proportion, others as soon as they can.

        Those of each part, as of one arm, get to their rates together; all where there are none.
        """
        self._lower = lower
        self._upper = upper
        self._acceleration = HEADROOM * acceleration
        self._jerk = HEADROOM * jerk
        self._period_s = period_s
        self._planner = VelocityPlanner(self._acceleration, self._jerk, groups, parts)
        self._factor = 1.0

    def verified_stop(self, motion: Motion) -> Stop:
        """Return the stop from a motion."""
        return self._planner.stop(motion)

    def step(
        self,
        motion: Motion,
        held: Stop,
        target: Array,
        factor: float,
        judge: Judge | None = None,
    ) -> Limited:
        """Return the motion one period later on the way to joint rates `target` (n,).

        `held` is the stop verified from `motion`; `factor` is the reduced-speed setting, which
        scales the acceleration (speeds are scaled before, jerk stays: it decides how promptly the
        arm reacts).
        """
        if factor != self._factor:
            self._planner.set_bounds(factor * self._acceleration, self._jerk)
            self._factor = factor
        if not np.count_nonzero(target) and motion.stands():
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
