"""Messages of the lease holder, field by field, with frame, shape and unit."""

import math
from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated, Any, Literal, Self, get_args

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, model_validator

# --- Messages of the lease holder, field by field, with frame, shape and unit ---------------------
#
# Every message travels as a MessagePack map of its fields plus `v`, the protocol version
# (`codec.py`); `topics.py` says on which key. Quantities are SI; twists are `[v; ω]` and
# wrenches `[f; m]`, linear part first; a wrench is what the arm exerts on its environment, at
# the MRF origin.

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

    @classmethod
    def of_valid(cls, **fields: Any) -> Self:
        """Return a message of fields that are known to be valid, each of them given.

        Judges nothing and fills nothing in: `model_construct` takes three times as long.
        """
        message = cls.__new__(cls)
        set_slot = object.__setattr__
        set_slot(message, "__dict__", fields)
        set_slot(message, "__pydantic_fields_set__", set(fields))
        set_slot(message, "__pydantic_extra__", None)
        set_slot(message, "__pydantic_private__", None)
        return message


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


class SelfMotion(MechanismCommand):
    """Rate at which the spare joints move while the tool stays, or goes its way; a stream.

    Of an arm with an arm angle φ that of φ [rad/s], positive right-handed about the way from
    shoulder to wrist. Of another redundant arm a part of its quickest [1]: at ±1 the quickest of
    its joints goes at its bound of self-motion. The direction begins as that in which the middle
    joint turns on, and goes over smoothly while it moves.
    """

    rate: float = Field(ge=-10, le=10)


class ArmAngle(MechanismCommand):
    """Arm angle φ to go to by the shorter way while the tool stays, or goes its way; a goal.

    It is kept once it is reached, until another replaces it, the spare joints are moved otherwise,
    or goals are cancelled.
    """

    angle: float = Field(ge=-3.1416, le=3.1416)
    speed: float | None = Field(None, gt=0, le=10)
    """[rad/s]; the cell's when absent, never more than that."""


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


# --- Messages that drive a mechanism as a whole: an arm into its tunnels, a base on wheels --------
#
# The envelope, units and conventions are those of `messages.py`.


class Drive(MechanismCommand):
    """Speeds that a mechanism is driven at, a stream.

    Of an arm in tunnels the insertion [m/s]: positive inserts, negative withdraws. Of a base on
    wheels v ahead [m/s] and ω about its z axis [rad/s].
    """

    rates: Annotated[tuple[Speed, ...], Field(min_length=1, max_length=2)]


class Insert(MechanismCommand):
    """How deep an arm is to be in its tunnels, a goal: the tip's way from the entrance [m]."""

    depth: float = Field(ge=0, le=100)
    speed: float | None = Field(None, gt=0, le=10)
    """[m/s]; the cell's when absent, never more than that."""


MOST_PIECES = 64
"""Most pieces of a tunnel [1]."""

_Turn = Annotated[float, Field(ge=-math.pi, le=math.pi)]
_PieceLength = Annotated[float, Field(gt=1e-3, le=20)]
_Passage = tuple[_PieceLength, _Turn, _Turn, _Turn]
_Gap = tuple[_PieceLength, Metres, Metres, Metres, Angle, Angle, Angle]


def _kind(piece: object) -> str:
    return (
        "gap" if isinstance(piece, Sequence) and len(piece) > len(get_args(_Passage)) else "piece"
    )


TunnelPiece = Annotated[
    Annotated[_Passage, Tag("piece")] | Annotated[_Gap, Tag("gap")], Discriminator(_kind)
]
"""Length [m], bend, climb and roll [rad], as in a cell's `backbone.tunnel`; seven numbers are a gap
there: its length [m], and the place x, y, z [m], and roll, pitch, yaw [rad], of the next passage's
entrance in World."""


class TunnelRequest(MechanismCommand):
    """Tells an arm its tunnel anew, from the entrance on; without pieces, the cell's holds again.

    The last `open` pieces have no walls. Where the tip is inside, or would come to rest there, the
    tunnel must stay as it is up to there. With drives on, joints are fitted a part in each period,
    half a second for thirty of them, and gaps are solved before, a second or two each; it is
    answered then.
    """

    pieces: tuple[TunnelPiece, ...] = Field(max_length=MOST_PIECES)
    open: int = Field(0, ge=0, le=MOST_PIECES - 1)


# --- Messages that lead a motion: paths, the master's pose, clutch and scale, the null space ------
#
# The envelope, units and conventions are those of `messages.py`.

MOST = 64
"""Most waypoints or segments of one path [1]."""

Waypoint = tuple[Metres, Metres, Metres, Angle, Angle, Angle]
PathSpeed = Annotated[float, Field(ge=1e-4, le=10)]
Duration = Annotated[float, Field(gt=0, le=600)]


class RedundancyRequest(TaskCommand):
    """Sets the gain of one redundancy objective, 0 for off; the change is ramped.

    `objective` is its name in the cell file, and the bounds there hold here. For `posture`, a name
    from the cell may say which posture to pull to.
    """

    objective: Identifier
    gain: float = Field(ge=0, le=10)
    posture: str | None = Field(None, max_length=32)

    @model_validator(mode="after")
    def _fits(self) -> "RedundancyRequest":
        if self.posture is not None and self.objective != "posture":
            raise ValueError("a posture is for the objective posture")
        return self


class FreeAxesRequest(TaskCommand):
    """Says which axes of its MRF a task leaves free, and holds all others; the change is ramped.

    `axes` are `x`, `y`, `z`, and `rx`, `ry`, `rz` for rotations about these; none: all are held.
    """

    axes: tuple[Literal["x", "y", "z", "rx", "ry", "rz"], ...] = Field(max_length=5)

    @model_validator(mode="after")
    def _once(self) -> "FreeAxesRequest":
        twice = next((name for name in self.axes if self.axes.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f"axis '{twice}' is there twice")
        return self


_Part = Annotated[float, Field(ge=-1, le=1)]


class VirtualLinksRequest(TaskCommand):
    """Sets the virtual links along which the tool may leave its path; what is not given stays.

    `directions` are of one or two links, square to each other, in `axes`; with none of them the
    tool comes back to its path, and stays on it. The other fields are those of the cell file, whose
    bounds hold here. What the links ask of the tool fades, and begins anew; nothing jumps. With
    `reset` the cell's hold again, but for what is given.
    """

    directions: tuple[tuple[_Part, _Part, _Part], ...] | None = Field(None, max_length=2)
    axes: Literal["world", "mrf", "crf", "path"] | None = None
    always: bool | None = None
    stiffness: float | None = Field(None, gt=0, le=1e4)
    reset: bool = False

    @model_validator(mode="after")
    def _says_something(self) -> "VirtualLinksRequest":
        told = (self.directions, self.axes, self.always, self.stiffness)
        if not self.reset and all(each is None for each in told):
            raise ValueError("give directions, axes, always, stiffness, or reset")
        return self


Weight = Annotated[float, Field(ge=1e-3, le=1e3)]
"""Beyond, one arm carries all: what is left of the others' shares is rounding."""


class LoadSharesRequest(TaskCommand):
    """Says how arms share the load of the payload that they hold together; the change is ramped.

    `weights` are the diagonals of W (Williams 1997, section 3) along the axes of the task's MRF, a
    row of forces x, y, z, then moments x, y, z for each of its mechanisms, in their order: the
    dearer, the less one carries. Without rows the cell's hold again. Refused where an arm does not
    bear its part.
    """

    weights: tuple[tuple[Weight, Weight, Weight, Weight, Weight, Weight], ...] = Field(
        (), max_length=8
    )


def complaint_of_path(waypoints: int, speeds: int, twists: int, durations: int) -> str:
    """Return what is wrong with so many of each in one path, or nothing."""
    if bool(waypoints) == bool(twists):
        return "give either waypoints or twists"
    if max(waypoints, twists) > MOST:
        return f"at most {MOST} waypoints or twists"
    if speeds and speeds != waypoints:
        return f"{speeds} speeds for {waypoints} waypoints"
    if durations != twists:
        return f"{durations} durations for {twists} twists"
    return ""


class PathMotion(TaskCommand):
    """A planned motion of the MRF, a goal: waypoints, or timed twists; not both.

    `waypoints` are poses `[x, y, z, roll, pitch, yaw]` [m, rad] in `relative_to` and
    `expressed_in`, read as a position target's are; all of them are placed when the command
    arrives. The way between them is straight, at `speeds` [m/s], one for each, or the cell's. With
    `blend` 0 the tool stops at each; else it turns to the next one within `blend` metres of it, and
    stops at the last.

    `twists` [m/s, rad/s] follow each other for `durations_s` each, in the axes of `expressed_in`
    (by default `relative_to`); with "mrf", in the axes of the moving tool. Between them, and at the
    end, acceleration and jerk are the cell's.
    """

    waypoints: Annotated[tuple[Waypoint, ...], Field(max_length=MOST)] = ()
    speeds: Annotated[tuple[PathSpeed, ...], Field(max_length=MOST)] = ()
    blend: float = Field(0.0, ge=0, le=1)
    twists: Annotated[tuple[Twist, ...], Field(max_length=MOST)] = ()
    durations_s: Annotated[tuple[Duration, ...], Field(max_length=MOST)] = ()
    relative_to: Frame = Frame.CRF
    expressed_in: Frame | None = None

    @model_validator(mode="after")
    def _one_of_two(self) -> "PathMotion":
        complaint = complaint_of_path(
            len(self.waypoints), len(self.speeds), len(self.twists), len(self.durations_s)
        )
        if complaint:
            raise ValueError(complaint)
        return self


class PathRequest(TaskCommand):
    """Pauses the path under way, resumes it, or aborts it; the tool comes to rest smoothly.

    While it is paused, position control holds the tool where the path stands: a stick shifts it
    aside, and on release it returns. An aborted path is gone, and the tool stays where it came to.
    """

    action: Literal["pause", "resume", "abort"]


class MasterPose(TaskCommand):
    """Pose of the operator's master device, a stream: its *motion* moves the MRF.

    `xyz` [m] and `rpy` [rad] are the handle's pose in the device's own base, whose axes are laid
    along those of `expressed_in`. What moves the tool are the increments from one message to the
    next while the clutch is engaged, scaled; so where the device is when it is engaged does not
    matter, and neither engaging nor a change of scale makes the tool jump. `handle` is as that of
    a stick: by it the arm's side knows what energy it may take out of the network.
    """

    xyz: Place
    rpy: Attitude
    expressed_in: Frame = Frame.CRF
    handle: tuple[Joules, Joules, Joules] | None = None


class ClutchRequest(TaskCommand):
    """Engages or disengages the master, stick and pose alike, and scales its motion.

    What is not given stays. A stick that is disengaged asks for nothing; a master pose that is
    disengaged may be moved freely, and the tool stands. The pose mode begins with a request to
    engage, after each enable and after each other goal.
    """

    engaged: bool | None = None
    translation: float | None = Field(None, ge=0, le=10)
    """Scale of translations [1]."""
    rotation: float | None = Field(None, ge=0, le=10)
    """Scale of rotations [1]."""


# --- Messages of force reflection: the force for the operator's handle, and energies --------------
#
# The envelope, units and conventions are those of `messages.py`.


class Reflection(Message):
    """Force of the operator's handle on the hand, every tick (Williams 1997, eq. 6).

    `wrench` [N, N·m] is −K_FR times the MRF's wrench, in the axes that the newest stick or
    master's pose is expressed in: a device makes it with the joint torques `J_HCᵀ wrench`. It is
    for a handle with a `protected` loop unless somebody switched that off.

    `slope` [N·s/m] is the steady force for each rate of the stick, K_FR K_HC / K_F: with the
    handle's own speed per force it makes the loop's gain. `entered` [J] is the energy that the
    arm's port has put into the network so far; it never falls.
    """

    tick: Count
    wrench: Vector6
    slope: float
    entered: float
    protected: bool
    task: Identifier | None = None
    """Whose force it is; None: of the first task, or the only one."""


class ReflectionRequest(TaskCommand):
    """Switches the protection of force reflection against delay off, or on again.

    For experiments: off, a distant handle may bounce. Enabling the arm switches it on.
    """

    protected: bool
