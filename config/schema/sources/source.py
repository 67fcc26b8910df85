"""What the sections of all sources have in common."""

from typing import ClassVar, Literal

from pydantic import Field

from ..section import Section, Vector6


class Source(Section):
    """A source's switch and gain, and what they depend on."""

    NEEDS: ClassVar[Literal["force_torque", "camera"] | None] = None
    """Sensor without which it stays off."""
    CLOSES_A_LOOP: ClassVar[bool] = False
    """Its gain turns an error of the pose into a rate [1/s], so the loop's delay bounds it."""

    enabled: bool = Field(True, description="switch at start")
    gain: Vector6
