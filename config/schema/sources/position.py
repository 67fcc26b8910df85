"""Schema of position control."""

from typing import ClassVar

from pydantic import Field

from ..section import Vector6
from .source import SourceSection


class PositionSection(SourceSection):
    """Target poses: a jerk-limited path, followed with error feedback (K_P)."""

    ERROR_GAIN: ClassVar[str | None] = "K_P"

    gain: Vector6 = Field((2.0,) * 6, description="K_P: error to rate [1/s]")
    speed: float = Field(0.15, gt=0, le=5, description="path speed [m/s]")
    angular_speed: float = Field(0.5, gt=0, le=10, description="path speed [rad/s]")
