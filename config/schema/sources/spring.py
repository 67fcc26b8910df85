"""Schema of a virtual fixture."""

from collections.abc import Iterator, Set
from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator

from ..section import Vector3
from .source import SourceSection

Gain = Annotated[float, Field(ge=0, le=100)]


class SpringSection(SourceSection):
    """A virtual fixture: the MRF is pulled to a line or a plane, rate = K_S (way to it)."""

    ERROR_GAIN: ClassVar[str | None] = "K_S"

    gain: tuple[Gain, Gain, Gain, Gain, Gain, Gain] = Field(
        (0.0,) * 6, description="K_S: error to rate, per axis of relative_to [1/s]"
    )
    shape: Literal["line", "plane"] = Field("line", description="what it is pulled to")
    relative_to: Literal["world", "base", "carrier"] = Field(
        "world", description="frame that line or plane are fixed to: World, or one that may move"
    )
    point: Vector3 = Field((0.0, 0.0, 0.0), description="a point of it, in relative_to [m]")
    direction: Vector3 = Field(
        (0.0, 0.0, 1.0), description="of the line, or the plane's normal, in relative_to [1]"
    )
    tool_axis: Vector3 | None = Field(
        None, description="axis of the MRF that is turned into the direction; none: no turning [1]"
    )
    deadband: float = Field(0.0, ge=0, le=1, description="way to it that is let be [m]")
    angular_deadband: float = Field(0.0, ge=0, le=3, description="the same of the angle [rad]")
    speed: float = Field(0.1, gt=0, le=5, description="largest rate that it asks for [m/s]")
    angular_speed: float = Field(0.3, gt=0, le=10, description="the same [rad/s]")

    @field_validator("direction", "tool_axis")
    @classmethod
    def _points_somewhere(
        cls, axis: tuple[float, float, float] | None
    ) -> tuple[float, float, float] | None:
        if axis is not None and sum(x * x for x in axis) < 1e-12:
            raise ValueError("must point somewhere, but is no longer than 1e-6")
        return axis

    def lacking(self, there: Set[str]) -> Iterator[str]:
        """Yield that the frame which the fixture is fixed to does not move."""
        if self.relative_to != "world" and self.relative_to not in there:
            yield (
                f"relative_to: value '{self.relative_to}': there is no "
                f"[frames.{self.relative_to}], so give the fixture in World"
            )
