"""Schema of a base on wheels that carries the arm."""

from typing import Literal

from pydantic import Field, model_validator

from ..section import Name, Positive, Section


class WheelsSection(Section):
    """The two driven wheels of a base: joints of the URDF that turn for ever."""

    left: Name = Field(description="joint of the left wheel; it turns about the Base's y axis")
    right: Name = Field(description="joint of the right wheel")
    radius: float = Field(gt=0.01, le=2, description="radius of either wheel [m]")
    track: float = Field(gt=0.05, le=5, description="between their points of contact [m]")

    @model_validator(mode="after")
    def _two(self) -> "WheelsSection":
        if self.left == self.right:
            raise ValueError(f"left and right are one joint: '{self.left}'")
        return self


class DifferentialBaseSection(Section):
    """A base with two driven wheels on one axle; Base is on the floor, midway between them.

    Its x axis points ahead, its z axis up. The wheels' drives are in CSV, whatever the arm's are.
    """

    kind: Literal["differential"] = Field(description="how the base moves")
    wheels: WheelsSection = Field(description="what it rolls on")
    weight: float = Field(
        6.0, ge=0.1, le=100, description="cost of arm motion over wheel motion, in radians [1]"
    )
    speed: float = Field(0.5, gt=0, le=10, description="cmd/drive asks for at most [m/s]")
    angular_speed: float = Field(1.0, gt=0, le=10, description="the same [rad/s]")
    slip: tuple[Positive, Positive] = Field(
        (0.05, 0.05),
        description="odometry that disagrees with news of Base by more means that wheels slip "
        "[m], [rad]",
    )
    correction: tuple[Positive, Positive] = Field(
        (0.05, 0.1),
        description="news of Base corrects the odometry by at most [m/s], [rad/s]",
    )
