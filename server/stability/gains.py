"""Judges the gains that an operator asks for: would the loop be stable?"""

from collections.abc import Callable

from ...config.load import Cell
from .following import following_refusal
from .force_loop import BUS_PERIODS, DRIVE_PERIODS, bound, force_axis, vision_periods


def gain_check(cell: Cell) -> Callable[[str, tuple[float, ...]], str | None]:
    """Return a judge: source and gains (6,) to the reason why they would be unstable, or None."""
    period = cell.config.timing.period_s

    def judge(source: str, gains: tuple[float, ...]) -> str | None:
        if source in ("force", "following") and cell.config.mechanism.force_torque is None:
            return "the cell has no force/torque sensor"
        for i, gain in enumerate(gains):
            if source == "position":
                loop, limit = gain * period, bound(BUS_PERIODS + DRIVE_PERIODS)
            elif source == "vision":
                loop, limit = gain * period, bound(vision_periods(cell))
            elif source == "following":
                refusal = following_refusal(cell, i, gain)
                if refusal is not None:
                    return refusal
                continue
            elif source == "force":
                axis = force_axis(cell, i, gain)
                if axis is None:
                    continue
                loop, limit = gain * axis.stiffness * period, axis.bound
            else:
                continue
            if loop >= limit:
                return f"gain[{i}] = {gain:g}: loop gain {loop:.3g}, stable below {limit:.3g}"
        return None

    return judge
