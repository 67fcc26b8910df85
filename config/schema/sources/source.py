"""Fields that the sections of all sources have in common."""

from collections.abc import Iterator, Set
from typing import ClassVar, Literal

from pydantic import Field

from ..section import Section, Vector6


class SourceSection(Section):
    """A source's switch and gain, and what they depend on."""

    NEEDS: ClassVar[Literal["force_torque", "camera", "contour"] | None] = None
    """Sensor without which it stays off."""
    ERROR_GAIN: ClassVar[str | None] = None
    """Symbol of a gain that turns an error of the pose into a rate [1/s], which the loop's delay
    bounds; None for a gain of another kind."""

    enabled: bool = Field(True, description="switch at start")
    gain: Vector6

    def lacking(self, there: Set[str]) -> Iterator[str]:  # noqa: ARG002 (most lack nothing)
        """Yield the keys whose values need what the cell has not, and what that is.

        `there` are its sensors, "force_torque", "camera" and "contour", and its moving frames.
        """
        yield from ()
