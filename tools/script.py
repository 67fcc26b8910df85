"""Scripts: what operators do over time, and which faults happen meanwhile, in TOML.

    duration_s = 6.0
    [[step]]
    at_s = 0.5
    joystick = { twist = [0.05, 0, 0, 0, 0, 0], expressed_in = "base" }

Times count from the moment the arm is enabled. A stick or jog is streamed at 100 Hz until the next
step of its kind. The same script drives a simulation and a running daemon.
"""

from pathlib import Path
from typing import Annotated, Any, Literal, get_args

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from ..config.load import ConfigError, read_toml, script_path
from ..protocols import messages as m
from ..protocols import motion
from ..protocols.topics import TOPICS

KEYS = tuple(topic.key for topic in TOPICS)
NonNegative = Annotated[float, Field(ge=0)]


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


class TargetStep(Part):
    """A camera's target that moves straight; the daemon hears where its sight line ends."""

    tag: str = Field(max_length=32)
    sight_line: str | None = Field(None, max_length=32)
    start: m.Place
    to: m.Place
    speed: float = Field(gt=0, le=10)


class Objective(Part):
    """The gain of a redundancy objective."""

    objective: motion.ObjectiveName
    gain: float = Field(ge=0, le=10)
    posture: str | None = Field(None, max_length=32)


class Gain(Part):
    """Gains of one source."""

    source: m.SourceName
    gain: m.Gains
    forced: bool = False


class Switch(Part):
    """A source on or off."""

    source: m.SourceName
    on: bool


class PayloadStep(Part):
    """What hangs on the sensor: a name from the cell, or mass [kg] and centre of mass [m]."""

    name: str | None = None
    mass: float | None = None
    com: m.Vector3 = (0.0, 0.0, 0.0)
    bias: m.Vector6 | None = None


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


class MotionStep(Part):
    """How the platform under the arm or the Carrier moves from now on: see `RigMotion`."""

    twist: m.Twist = (0.0,) * 6
    sway: m.Twist = (0.0,) * 6
    period_s: float = Field(4.0, ge=0.2, le=600)


FaultKind = Literal[
    "silence", "fault", "stick", "block", "drop", "delay", "corrupt", "freeze", "push", "emcy",
    "cover", "move", "place", "hand",
]  # fmt: skip


class FaultStep(Part):
    """A fault of the virtual hardware, as `{ kind = "target" }`; `on = false` takes it back."""

    kind: FaultKind
    target: str = Field(max_length=64)
    on: bool = True
    value: float | None = None
    vector: m.Vector3 | None = None

    @model_validator(mode="before")
    @classmethod
    def _kind_is_a_key(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "kind" in data:
            return data
        kinds = [k for k in data if k in get_args(FaultKind)]
        if len(kinds) != 1:
            raise ValueError(f"one fault of {', '.join(get_args(FaultKind))}")
        rest = {k: v for k, v in data.items() if k != kinds[0]}
        return {"kind": kinds[0], "target": data[kinds[0]], **rest}


class ObstacleStep(Part):
    """An obstacle that is put somewhere, moves on at a velocity, or goes.

    What is physical and what the daemon is told are two things: without `physical` it is only
    told, without `tell` it is only there. Of one that moves, news is told 20 times a second, with
    its velocity where `max_acceleration` is given; `silent` ends the news, the obstacle goes on.
    """

    name: str = Field(max_length=32)
    shape: Literal["point", "sphere", "capsule", "box", "sight_line"] | None = None
    xyz: m.Place | None = None
    to: m.Place | None = None
    rpy: m.Attitude | None = None
    half_size: m.Vector3 | None = None
    radius: float | None = None
    velocity: m.Vector3 | None = None
    max_speed: float | None = None
    max_acceleration: float | None = None
    timeout_s: float | None = None
    stale: Literal["keep", "grow", "stop"] | None = None
    clearance: float | None = None
    hard: bool | None = None
    remove: bool = False
    physical: bool = True
    tell: bool = True
    silent: bool = False


class LinkStep(Part):
    """What happens to an operator's connection."""

    cut: bool = False
    delay_s: float = Field(0.0, ge=0, le=60)
    """One way, the same in both directions."""
    jitter: float = Field(0.0, ge=0, le=1)
    loss: float = Field(0.0, ge=0, lt=1)


class Network(Part):
    """The operators' network from the start: round trip, its variation, its losses."""

    rtt_s: float = Field(0.0, ge=0, le=10)
    jitter: float = Field(0.0, ge=0, le=1)
    loss: float = Field(0.0, ge=0, lt=1)
    seed: int = Field(1, ge=0)


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
    """Bytes put on a topic as they are, to see them refused."""

    topic: str
    hex: str = Field(pattern="^([0-9a-fA-F]{2})*$")

    @field_validator("topic")
    @classmethod
    def _is_a_topic(cls, key: str) -> str:
        if key not in KEYS:
            raise ValueError(f"one of {', '.join(KEYS)}")
        return key


class Step(Part):
    """One moment of a script; everything in it happens at `at_s`, in this order."""

    at_s: NonNegative
    operator: m.OperatorName = "operator"
    lease: Literal["acquire", "release"] | None = None
    link: LinkStep | None = None
    mode: Literal["enable", "hold", "resume", "disable", "reset"] | None = None
    protective_stop: bool | None = None
    speed: float | None = Field(None, ge=0.01, le=1)
    store_view: str | None = None
    """Camera whose present view is to be kept."""
    gain: Gain | None = None
    switch: Switch | None = None
    frame: FrameStep | None = None
    payload: PayloadStep | None = None
    gripper: Literal["close", "open"] | None = None
    tare: bool = False
    redundancy: Objective | None = None
    clutch: ClutchStep | None = None
    path_control: Literal["pause", "resume", "abort"] | None = None
    cancel: bool = False
    joystick: Stick | None = None
    jog: Jog | None = None
    position: Target | None = None
    posture: Annotated[str, Field(max_length=32)] | m.JointVector | None = None
    path: PathStep | None = None
    master: MasterStep | None = None
    device: DeviceStep | None = None
    reflection: ReflectionStep | None = None
    force: m.Wrench | WrenchStep | None = None
    target: TargetStep | None = None
    raw: Raw | None = None
    obstacle: ObstacleStep | None = None
    avoidance: bool | None = None
    """Whether clearances are kept."""
    fault: FaultStep | None = None
    platform: MotionStep | None = None
    """How what the arm stands on moves from now on."""
    carrier: MotionStep | None = None
    """How what the CRF may ride on moves from now on."""


class Script(Part):
    """What happens over a run."""

    description: str = ""
    duration_s: float = Field(gt=0, le=3600)
    auto_enable: bool = True
    """The operator takes the lease and enables the arm before time starts."""
    network: Network = Network()
    step: tuple[Step, ...] = ()

    @property
    def steps(self) -> tuple[Step, ...]:
        """The steps in order of time."""
        return tuple(sorted(self.step, key=lambda s: s.at_s))


def load_script(name_or_path: str | Path, base: Path = Path()) -> Script:
    """Load a script: a path, or the name of one that is shipped. Raises `ConfigError`."""
    path = script_path(name_or_path, base)
    try:
        return Script.model_validate(read_toml(path))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        value = str(first["input"])[:60]
        raise ConfigError(f"{path}: {key}: value {value}: {first['msg']}") from None
