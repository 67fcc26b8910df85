"""The axis that sweeps to and fro: the rate at which it is asked to go, tick by tick."""

from typing import Final, Self

from ...config.load import Cell

GAIN: Final = 4.0
"""Approach to where the sweep has it [1/s]."""
MOST: Final = 0.9
"""Share of the joint's speed bound that a sweep takes at most [1]: others shall not wait for it."""


class SweptAxis:
    """One axis: which joint, and where it should be now."""

    def __init__(
        self,
        joint: int,
        low: float,
        high: float,
        period_s: float,
        velocity: float,
        control_period_s: float,
    ) -> None:
        self.joint = joint
        """Its place among the joints of its mechanism."""
        self._low, self._high = low, high
        self._rate = 2.0 * (high - low) / period_s
        self._velocity, self._period_s = velocity, control_period_s
        self._at, self._up = low, True

    @classmethod
    def from_cell(cls, cell: Cell) -> Self | None:
        """Return that of a mechanism; None where nothing sweeps."""
        mechanism = cell.config.mechanism
        sweep = mechanism.sweep
        if sweep is None:
            return None
        joint = [j.name for j in cell.robot.joints].index(sweep.joint)
        return cls(
            joint,
            sweep.low,
            sweep.high,
            sweep.period_s,
            mechanism.drives[joint].max_velocity,
            cell.config.timing.period_s,
        )

    def rate(self, q: float, factor: float) -> float:
        """Return the rate [rad/s] for the next period; the axis is commanded to be at q [rad].

        `factor` is the reduced-speed setting: then it sweeps as quickly as it may.
        """
        most = MOST * factor * self._velocity
        rate = min(self._rate, most)
        ahead = rate * self._period_s
        self._at += ahead if self._up else -ahead
        if self._at > self._high:
            self._at, self._up = 2.0 * self._high - self._at, False
        elif self._at < self._low:
            self._at, self._up = 2.0 * self._low - self._at, True
        asked = (rate if self._up else -rate) + GAIN * (self._at - q)
        return min(max(asked, -most), most)
