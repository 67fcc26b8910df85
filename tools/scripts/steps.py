"""What operators do in a script, each as a table of its own."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from ...config.schema.null_space.redundancy import ObjectiveName
from ...config.schema.sources.sources import SourceName
from ...protocols.messages import messages as m
from ...protocols.messages import motion
from ...protocols.topics import TOPICS

KEYS = tuple(topic.key for topic in TOPICS)


class Part(BaseModel):
    """A table of a script: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Stick(Part):
    """A stick twist [m/s, rad/s], streamed; without a twist the stream falls silent."""

    twist: m.Twist | None = None
    relative_to: m.Frame = m.Frame.CRF
    expressed_in: m.Frame = m.Frame.CRF


class Jog(Part):
    """Joint rates [rad/s], streamed; without rates the stream falls silent."""

    rates: m.JointVector | None = None


class Target(Part):
    """A target pose of the MRF [m, rad]."""

    xyz: m.Place
    rpy: m.Attitude
    relative_to: m.Frame = m.Frame.CRF
    expressed_in: m.Frame | None = None
    speed: float | None = Field(None, gt=0, le=10)


class PathStep(Part):
    """A path: waypoints with speeds, or twists with durations; see `PathMotion`."""

    waypoints: tuple[motion.Waypoint, ...] = ()
    speeds: tuple[motion.PathSpeed, ...] = ()
    blend: float = Field(0.0, ge=0, le=1)
    twists: tuple[m.Twist, ...] = ()
    durations_s: tuple[motion.Duration, ...] = ()
    relative_to: m.Frame = m.Frame.CRF
    expressed_in: m.Frame | None = None

    @model_validator(mode="after")
    def _is_a_path(self) -> "PathStep":
        complaint = motion.complaint_of_path(
            len(self.waypoints), len(self.speeds), len(self.twists), len(self.durations_s)
        )
        if complaint:
            raise ValueError(complaint)
        return self


class MasterStep(Part):
    """A master device that moves at a twist, its pose streamed; without one it falls silent."""

    twist: m.Twist | None = None
    expressed_in: m.Frame = m.Frame.CRF


class ClutchStep(Part):
    """The master's clutch and scales; what is not given stays."""

    engaged: bool | None = None
    translation: float | None = Field(None, ge=0, le=10)
    rotation: float | None = Field(None, ge=0, le=10)


class Objective(Part):
    """The gain of a redundancy objective."""

    objective: ObjectiveName
    gain: float = Field(ge=0, le=10)
    posture: str | None = Field(None, max_length=32)


class Gain(Part):
    """Gains of one source."""

    source: SourceName
    gain: m.Gains
    forced: bool = False


class Switch(Part):
    """A source on or off."""

    source: SourceName
    on: bool


class PayloadStep(Part):
    """What hangs on the sensor: a name, or mass [kg] and centre of mass [m], or `unknown`."""

    name: str | None = None
    mass: float | None = None
    com: m.Vector3 = (0.0, 0.0, 0.0)
    bias: m.Vector6 | None = None
    unknown: bool = False


class FrameStep(Part):
    """A new MRF or CRF: see `FrameRequest`."""

    frame: Literal["mrf", "crf"]
    xyz: m.Place = (0.0, 0.0, 0.0)
    rpy: m.Attitude = (0.0, 0.0, 0.0)
    relative_to: m.Frame | None = None
    origin_only: bool = False
    moves_with: Literal["world", "base", "carrier"] | None = None

    @model_validator(mode="after")
    def _fits(self) -> "FrameStep":
        if self.frame == "mrf" and self.moves_with is not None:
            raise ValueError("the MRF moves with the Wrist")
        return self


class WrenchStep(Part):
    """A desired wrench [N, N·m] in axes that are not the MRF's."""

    wrench: m.Wrench
    expressed_in: m.Frame = m.Frame.MRF


class DeviceStep(Part):
    """A force-reflecting handle and the hand on it; what is not given stays.

    `hand` is where the hand means to be, from the handle's centre [m], in the axes of
    `expressed_in`, within `seconds`. As a stick (`rate`) its deflection asks for a rate, as a
    master (`pose`) its motion leads the tool.
    """

    mode: Literal["rate", "pose"] | None = None
    hand: m.Vector3 | None = None
    seconds: float = Field(0.5, gt=0, le=60)
    held: bool | None = None
    expressed_in: m.Frame | None = None


class ReflectionStep(Part):
    """The protection of force reflection, on or off."""

    protected: bool


class Raw(Part):
    """Bytes put on a topic as they are, to see them refused.

    `proof` is what is attached: bytes again, or "lease" for a proof of the operator's lease.
    """

    topic: str
    hex: str = Field(pattern="^([0-9a-fA-F]{2})*$")
    proof: str = Field("", pattern="^(lease|([0-9a-fA-F]{2})*)$")

    @field_validator("topic")
    @classmethod
    def _is_a_topic(cls, key: str) -> str:
        if key not in KEYS:
            raise ValueError(f"one of {', '.join(KEYS)}")
        return key
