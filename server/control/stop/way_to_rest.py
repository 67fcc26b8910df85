"""A stop: the verified way to rest that every command has."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..spatial import Array
from .motion import Motion
from .velocity_profile import reach, stop_at, stop_postures


class Stop(NamedTuple):
    """A jerk-limited way to rest."""

    start: Motion
    """Where it began."""
    phases: Array
    """How long each part of it lasts, and its jerk (2, k, n) [s, 1/s³]."""
    low: Array
    """Least position of each joint along the whole stop (n,)."""
    high: Array
    """Greatest position of each joint along the whole stop (n,)."""
    duration_s: float
    elapsed_s: float = 0.0

    def advanced(self, by_s: float) -> "Stop":
        """Return the same, further along."""
        return self._replace(elapsed_s=self.elapsed_s + by_s)

    @property
    def to_go_s(self) -> float:
        """Time until the end [s]."""
        return max(0.0, self.duration_s - self.elapsed_s)

    @property
    def finished(self) -> bool:
        """True once the end is reached."""
        return self.elapsed_s >= self.duration_s

    @staticmethod
    def along(start: Motion, phases: Array) -> "Stop":
        """Return the stop from `start` that goes through phases (2, k, n)."""
        low, high, duration_s = reach(*start, phases)
        return Stop(start, phases, low, high, duration_s)

    @staticmethod
    def at_rest(q: Array) -> "Stop":
        """Return the stop of what stands at q (n,)."""
        return Stop.along(Motion.at_rest(q), np.zeros((2, 1, len(q))))

    @staticmethod
    def of_all(each: "Sequence[Stop]") -> "Stop":
        """Return stops that began at one time as one, their freedoms one after the other."""
        if len(each) == 1:
            return each[0]
        most = max(stop.phases.shape[1] for stop in each)
        phases, first = np.zeros((2, most, sum(len(stop.low) for stop in each))), 0
        for stop in each:
            _, k, n = stop.phases.shape
            phases[:, :k, first : first + n] = stop.phases
            first += n
        return Stop(
            Motion.of_all([stop.start for stop in each]),
            phases,
            np.concatenate([stop.low for stop in each]),
            np.concatenate([stop.high for stop in each]),
            max(stop.duration_s for stop in each),
            each[0].elapsed_s,
        )

    def of(self, part: slice) -> "Stop":
        """Return that of some freedoms."""
        start, phases = self.start.of(part), self.phases[:, :, part]
        return Stop(start, phases, self.low[part], self.high[part], self.duration_s, self.elapsed_s)

    def at(self, ahead_s: float = 0.0) -> Motion:
        """Return the motion `ahead_s` after now."""
        return Motion(*stop_at(*self.start, self.phases, self.elapsed_s + ahead_s))

    def postures(self, ahead_s: Array) -> Array:
        """Return the positions (s, n) at times (s,) after now."""
        return stop_postures(*self.start, self.phases, self.elapsed_s + ahead_s)
