"""Messages of the lease holder, field by field, with frame, shape and unit.

Every message travels as a MessagePack map of its fields plus `v`, the protocol version
(`codec.py`); `topics.py` says on which key. Quantities are SI; twists are `[v; ω]` and wrenches
`[f; m]`, linear part first; a wrench is what the arm exerts on its environment, at the MRF
origin.
"""

from enum import StrEnum
from typing import Annotated

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


class TaskCommand(Command):
    """Something that concerns one task; without a name the cell's first, or only one."""

    task: Identifier | None = None


class MechanismCommand(Command):
    """Something that concerns one mechanism; without a name the cell's first, or only one."""

    mechanism: Identifier | None = None


class Keepalive(Command):
    """Renews the lease; sent at 10 Hz."""


class JoystickTwist(TaskCommand):
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


class PositionTarget(TaskCommand):
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


class DesiredWrench(TaskCommand):
    """Wrench that the arm shall exert, at the MRF [N, N·m]; a goal.

    In the axes of `expressed_in`, also while these turn.
    """

    wrench: Wrench
    expressed_in: Frame = Frame.MRF


class JointJog(MechanismCommand):
    """Joint rates [rad/s], one per joint, a stream."""

    rates: JointVector


class PostureMove(MechanismCommand):
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


class CancelGoals(TaskCommand):
    """Drops the position target, the posture and the desired wrench; without a task, of all."""
