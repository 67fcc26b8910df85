"""Would an operator's new gains be stable in this cell?"""

from collections.abc import Callable

from ..config.load import Cell
from .control.stability import sampled_bound

DELAY_PERIODS = 3.5
"""Whole delay of the force loop, with drives, sensor and filter [periods]."""


def gain_bound(cell: Cell) -> Callable[[str, tuple[float, ...]], str | None]:
    """Return a judge: source and gains (6,) to the reason why they would be unstable, or None."""
    period = cell.config.timing.period_s
    limit = sampled_bound(DELAY_PERIODS)
    sensor = cell.config.mechanism.force_torque

    def judge(source: str, gains: tuple[float, ...]) -> str | None:
        stiffness: tuple[float, ...] = (1.0,) * 6
        if source == "joystick":
            return None
        if source == "force":
            if sensor is None:
                return "the cell has no force/torque sensor"
            stiffness = (sensor.stiffest_environment,) * 3
            stiffness += (sensor.stiffest_environment_rotation,) * 3
        for i, (gain, k) in enumerate(zip(gains, stiffness, strict=True)):
            if gain * k * period >= limit:
                return (
                    f"gain[{i}] = {gain:g}: loop gain {gain * k * period:.3g}, "
                    f"stable below {limit:.3g}"
                )
        return None

    return judge
