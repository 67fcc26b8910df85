"""What crosses Zenoh, field by field, with frame, shape and unit.

Every message travels as a MessagePack map of its fields plus `v`, the protocol version
(`codec.py`); `topics.py` says on which key. Quantities are SI; twists are `[v; ω]` and wrenches
`[f; m]`, linear part first; a wrench is what the arm exerts on its environment, at the MRF
origin.
"""

from enum import StrEnum
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

VERSION = 2
"""Protocol version; a message of any other version is refused."""

Vector3 = tuple[float, float, float]
Vector6 = tuple[float, float, float, float, float, float]
Metres = Annotated[float, Field(ge=-100, le=100)]
Angle = Annotated[float, Field(ge=-12.6, le=12.6)]
Speed = Annotated[float, Field(ge=-10, le=10)]
AngularSpeed = Annotated[float, Field(ge=-30, le=30)]
Newtons = Annotated[float, Field(ge=-2000, le=2000)]
NewtonMetres = Annotated[float, Field(ge=-1000, le=1000)]
Gain = Annotated[float, Field(ge=0, le=100)]
Place = tuple[Metres, Metres, Metres]
Attitude = tuple[Angle, Angle, Angle]
Twist = tuple[Speed, Speed, Speed, AngularSpeed, AngularSpeed, AngularSpeed]
Wrench = tuple[Newtons, Newtons, Newtons, NewtonMetres, NewtonMetres, NewtonMetres]
Gains = tuple[Gain, Gain, Gain, Gain, Gain, Gain]
Value = str | int | float | bool | None
"""Value in an event, or of a device."""
JointVector = Annotated[tuple[float, ...], Field(min_length=1, max_length=64)]
Joules = Annotated[float, Field(ge=0, le=1e6)]
Key = Annotated[bytes, Field(min_length=32, max_length=32)]
OperatorName = Annotated[str, Field(min_length=1, max_length=64)]
Identifier = Annotated[str, Field(max_length=32, pattern=r"^[a-z][a-z0-9_]{0,31}$")]
"""Name of something that the cell has, such as a source or a redundancy objective."""
Count = Annotated[int, Field(ge=0, le=2**63 - 1)]


class Frame(StrEnum):
    """A coordinate frame that a command may name."""

    WORLD = "world"
    BASE = "base"
    MRF = "mrf"
    CRF = "crf"
    CARRIER = "carrier"
    WRIST = "wrist"
    SENSOR = "sensor"
    LENS = "lens"
    """Of the camera whose view is kept."""


class Message(BaseModel):
    """Anything that crosses Zenoh: immutable, no unknown fields, finite numbers only."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


# --- commands: what the lease holder sends ---------------------------------------------------


class Command(Message):
    """Everything that needs the lease: it travels with a proof of it (`proof.py`).

    The proof holds the lease's epoch and a sequence number that grows with every message on one
    key; `seen_tick` is the newest telemetry tick that the sender had seen.
    """

    seen_tick: Count


class Keepalive(Command):
    """Renews the lease; sent at 10 Hz."""


class JoystickTwist(Command):
    """Stick rates u of the MRF [m/s, rad/s], a stream: fades when its news stops.

    `relative_to` is the frame that the motion is measured against, `expressed_in` the one whose
    axes the six numbers use. Under a goal, the motion is measured against what the goal is. A stick
    that reflects forces tells in `handle` what energy [J] the hand has put into the network so
    far, has got out of it, and lost of that in the damping which protects the handle; none falls.
    """

    twist: Twist
    relative_to: Frame = Frame.CRF
    expressed_in: Frame = Frame.CRF
    handle: tuple[Joules, Joules, Joules] | None = None


class PositionTarget(Command):
    """Target pose of the MRF, a goal: stays until replaced.

    `xyz` [m] is measured from the origin of `relative_to`, in the axes of `expressed_in`
    (by default the same frame); `rpy` [rad] turns about those fixed axes, starting from the
    attitude of `relative_to`. With `relative_to = "mrf"` it is a displacement from where the
    MRF is when the command arrives.
    """

    xyz: Place
    rpy: Attitude
    relative_to: Frame = Frame.CRF
    expressed_in: Frame | None = None
    speed: float | None = Field(None, ge=1e-4, le=10)
    """Path speed [m/s]; the cell's when absent, never more than the cell's limit."""


class DesiredWrench(Command):
    """Wrench that the arm shall exert, at the MRF [N, N·m]; a goal.

    In the axes of `expressed_in`, also while these turn.
    """

    wrench: Wrench
    expressed_in: Frame = Frame.MRF


class JointJog(Command):
    """Joint rates [rad/s], one per joint, a stream."""

    rates: JointVector


class PostureMove(Command):
    """Joint posture to move to: a name from the cell or angles [rad].

    A goal that ends when it is reached, or when the stick is moved. While it is under way, the
    other sources wait; afterwards they act again, and the joints stand until one asks for more.
    """

    posture: str | None = Field(None, max_length=32)
    q: JointVector | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> "PostureMove":
        if (self.posture is None) == (self.q is None):
            raise ValueError("give either posture or q")
        return self


class CancelGoals(Command):
    """Drops the position target, the posture and the desired wrench."""


# --- telemetry --------------------------------------------------------------------------------


class State(Message):
    """What the daemon knows and did, every tick.

    Poses are `[x, y, z, roll, pitch, yaw]` of the MRF in World; `target_mrf` is the pose that the
    position source leads to. `sources` holds each source's twist as it entered the sum, at the MRF
    origin in World axes; `twist` is the sum before limiting. `view` is the tag in the Lens as last
    accepted, and `view_age_ticks` how old that picture is. `command_age_ticks` is how old the
    snapshot was that the last accepted command was based on.
    `limits` names what is limiting now. `wrench_sensor` is the sensor's reading, sign turned but
    with weight and bias in it; `payload` the mass [kg] and centre of mass in the Sensor frame [m]
    that are taken off it; `gripper_closed` what the gripper was told, if it was.
    `gains` are those in effect, ramped and as their schedules
    say, `on` the sources' switches. `self_motion` is what the null space was asked to do [rad/s],
    `objectives` each redundancy objective's gain and the size of its part [rad/s]. `potential`
    tells of the field, if anything follows it: its parts [J], and the `slope` that is left of it in
    the self-motions [N·m]; `off_path` is where the virtual link has the tool off its path [m].

    `frames` holds the poses of Base and Carrier, where these may move, as the control has them, and
    `frame_age_ticks` how old the newest news of each is, None when stale; `ground` is what motion
    is relative to. The source `frames` is the twist that moves the MRF along with it.

    `path` tells how far a path is: `leg` of `legs`, counted from 0, the `part` of the leg's time
    that is over, and the `pace`, which a pause takes to 0; `path_mrf` is the pose it has got to.
    `avoiding` says whether clearances are kept, `gaps` the nearest pairs of the commanded arm:
    link, obstacle or other link, distance of their surfaces [m], and whether its barrier acts.
    `spheres` are the distances of virtual spheres' centres from the nearest obstacle [m], if there
    is any, and `priority` is α, the part of a hand's force that avoiding takes away.
    `master` tells of the clutch: whether it is `engaged`, whether a master's pose is `leading` the
    tool, and the scales of `translation` and `rotation`.
    """

    tick: Count
    time_s: float
    mode: str
    q: JointVector
    q_command: JointVector
    dq_command: JointVector
    tau: JointVector
    external_torque: JointVector | None = None
    """Torques of contact that no sensor sees [N·m]; None where it is not watched."""
    following_error: JointVector
    pose_mrf: Vector6
    pose_mrf_measured: Vector6
    pose_crf: Vector6
    ground: str = "world"
    frames: dict[str, Vector6] = Field(default_factory=dict)
    frame_age_ticks: dict[str, Count | None] = Field(default_factory=dict)
    target_mrf: Vector6 | None
    wrench_mrf: Vector6 | None
    wrench_sensor: Vector6 | None = None
    payload: tuple[float, float, float, float] | None = None
    gripper_closed: bool | None = None
    devices: dict[str, dict[str, Value]] = Field(default_factory=dict)
    """What other devices on the bus say, by their names."""
    view: Vector6 | None = None
    view_age_ticks: Count | None = None
    sources: dict[str, Vector6]
    gains: dict[str, Vector6]
    on: dict[str, bool]
    twist: Vector6
    self_motion: JointVector
    objectives: dict[str, tuple[float, float]]
    path: dict[str, float] | None
    path_mrf: Vector6 | None
    master: dict[str, float]
    scale: float
    limits: tuple[str, ...]
    sigma_min: float
    potential: dict[str, float] | None = None
    off_path: Vector3 | None = None
    avoiding: bool = False
    gaps: tuple[tuple[str, str, float, bool], ...] = ()
    spheres: dict[str, float] = Field(default_factory=dict)
    priority: float | None = None
    at_goal: bool
    speed_factor: float
    drives: tuple[str, ...]
    protective_stop: bool
    lease_epoch: Count
    lease_holder: str | None
    last_seq: dict[str, Count]
    command_age_ticks: Count | None
    overruns: Count


class Event(Message):
    """Something that happened, with cause and values. `id` counts every event of a run."""

    id: Count
    tick: Count
    time_s: float
    name: str = Field(max_length=64)
    severity: Literal["info", "warning", "error"]
    detail: str = Field("", max_length=1000)
    values: dict[str, Value] = Field(default_factory=dict)


class Description(Message):
    """What an operator needs to know of a cell before driving it."""

    cell: str
    description: str
    network: Literal["local", "certified", "insecure"]
    """Who may speak to the daemon: its machine, who shows a certificate, or anybody."""
    period_s: float
    joints: tuple[str, ...]
    lower: JointVector
    upper: JointVector
    max_velocity: JointVector
    postures: dict[str, JointVector]
    sources: tuple[str, ...]
    gains: dict[str, Vector6]
    lease_timeout_s: float
    stream_timeout_s: float
    max_command_age_s: float
    versions: dict[str, str]
    buses: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """Devices on each bus, in the order of booting."""
