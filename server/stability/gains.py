"""Check of the gains that an operator asks for against the stability bounds."""

from collections.abc import Callable

from ...config.load import Cell
from ...config.schema.sources.source import SourceSection
from .following import following_refusal
from .force_loop import BUS_PERIODS, DRIVE_PERIODS, bound, force_axis, vision_periods


def gain_check(cell: Cell) -> Callable[[str, tuple[float, ...]], str | None]:
    """Return the check: source and gains (6,) to why they would be unstable, or None."""
    period, sections = cell.config.timing.period_s, cell.config.sources.each

    def judge(source: str, gains: tuple[float, ...]) -> str | None:
        section = sections[source]
        if section.NEEDS == "force_torque" and cell.config.mechanism.force_torque is None:
            return "the cell has no force/torque sensor"
        for i, gain in enumerate(gains):
            if section.ERROR_GAIN is not None:
                loop, limit = gain * period, bound(error_delay_periods(cell, section))
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


def error_delay_periods(cell: Cell, section: SourceSection) -> float:
    """Return the delay of the loop that a gain of the pose's error closes [periods]."""
    return vision_periods(cell) if section.NEEDS == "camera" else BUS_PERIODS + DRIVE_PERIODS
