"""Schema of frames that move: Base, the Carrier of the CRF, their news."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from .section import PoseSection, Section, Vector6

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]


class MovingFrameSection(Section):
    """A frame whose pose comes in on `sensor/frame`; how far its news is believed."""

    timeout_s: float = Field(
        0.25, gt=0, le=5, description="news older than this is stale: the frame comes to rest [s]"
    )
    smoothing_s: float = Field(
        0.06, gt=0, le=2, description="time constant of the filter over its news [s]"
    )
    least_quality: float = Field(0.3, ge=0, le=1, description="news below is not believed [1]")
    speed: float = Field(0.5, gt=0, le=10, description="faster it is never believed to move [m/s]")
    angular_speed: float = Field(0.5, gt=0, le=10, description="the same [rad/s]")
    acceleration: float = Field(
        1.0, gt=0, le=100, description="with more it is never believed to accelerate [m/s²]"
    )
    angular_acceleration: float = Field(1.0, gt=0, le=100, description="the same [rad/s²]")
    extent: tuple[Positive, Positive] | None = Field(
        None,
        description="further from where the cell has it, it is never believed to be [m], [rad]; "
        "none: anywhere",
    )
    slack: tuple[Positive, Positive] = Field(
        (0.02, 0.05), description="difference of two poses that is still noise [m], [rad]"
    )


class FramesSection(Section):
    """Frames that may move. A frame without its table here stands where the cell has it."""

    base: MovingFrameSection | None = Field(
        None, description="Base moves: the arm is on a platform"
    )
    carrier: MovingFrameSection | None = Field(
        None, description="what the CRF may ride on moves: a conveyor, a workpiece"
    )
    T_world_carrier: PoseSection = Field(
        default_factory=PoseSection, description="Carrier in World, until its first news"
    )
    crf_on: Literal["world", "base", "carrier"] = Field(
        "world", description="what the CRF is fixed to, at start"
    )
    T_ground_crf: PoseSection = Field(
        default_factory=PoseSection,
        description="CRF at start on the Base or Carrier that it is fixed to; in World it is "
        "T_world_crf",
    )
    drive_lag_s: float = Field(
        0.0,
        ge=0,
        le=0.2,
        description="how far the joints are behind their interpolated setpoint: foreseen [s]",
    )

    @property
    def moving(self) -> dict[str, MovingFrameSection]:
        """The frames that have news, by name."""
        both = {"base": self.base, "carrier": self.carrier}
        return {name: frame for name, frame in both.items() if frame is not None}

    @model_validator(mode="after")
    def _ground_is_there(self) -> "FramesSection":
        if self.crf_on == "carrier" and self.carrier is None:
            raise ValueError("crf_on is 'carrier': there is no [frames.carrier]")
        return self


class RigMotionSection(Section):
    """How a thing of the virtual world moves: a constant twist, and a sway about its place."""

    twist: Vector6 = Field((0.0,) * 6, description="constant twist, in World [m/s, rad/s]")
    sway: Vector6 = Field((0.0,) * 6, description="amplitude of a sine about its place [m, rad]")
    period_s: float = Field(4.0, ge=0.2, le=600, description="period of the sway [s]")


class RigFramesSection(Section):
    """Motion in the virtual world, and the news that its sensors give of it."""

    platform_mass: float = Field(
        2000.0, gt=0, le=1e6, description="of a platform that carries the arm [kg]"
    )
    platform: RigMotionSection = Field(
        default_factory=RigMotionSection, description="its motion at start"
    )
    carrier: RigMotionSection = Field(
        default_factory=RigMotionSection, description="the Carrier's, at start"
    )
    acceleration: float = Field(
        0.5, gt=0, le=100, description="with which their twists change [m/s², rad/s²]"
    )
    rate_hz: float = Field(50.0, gt=0, le=1000, description="news per second [1/s]")
    latency_s: float = Field(
        0.04, ge=0, le=1, description="from the measurement until the daemon hears [s]"
    )
    noise: tuple[NonNegative, NonNegative] = Field(
        (2e-4, 3e-4), description="standard deviation of each axis of a pose [m], [rad]"
    )
    twists: bool = Field(False, description="true: the news has the frame's twist, too")
    gyroscope: bool = Field(
        False, description="true: of a base on wheels only the heading is measured, by a gyroscope"
    )
    gyroscope_bias: float = Field(
        0.0, ge=-0.1, le=0.1, description="that its heading drifts by [rad/s]"
    )


__all__ = ["FramesSection", "MovingFrameSection", "RigFramesSection", "RigMotionSection"]
