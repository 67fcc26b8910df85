"""The one table of topics that cross Zenoh, by their keys, and how large each message may be."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum, StrEnum, auto
from functools import cache, cached_property
from math import ceil
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, Self, Union, get_args, get_origin

from annotated_types import MaxLen
from pydantic import BaseModel

from .messages import messages as m
from .messages import messages as motion
from .messages import perception as moving
from .messages import requests
from .messages.messages import Drive, Insert, Reflection, ReflectionRequest
from .messages.perception import (
    AvoidanceRequest,
    CameraPicture,
    ContourNews,
    ObstacleNews,
    ScanPoints,
    Sighting,
    StoreView,
    VideoPiece,
)
from .messages.rig import RigFault, RigTruth
from .messages.telemetry import Description, Event, RecordedTick, State

# --- How large a message of a kind can be, from its fields' types: what is larger is refused unread
#
# A kind whose fields are not all bounded, such as telemetry with names of a cell's own choice,
# has no bounds.

_HEAD: Final = 5
"""Longest head of a string or container in MessagePack [B]."""

_NUMBER: Final = 9
"""Longest number, with its head [B]."""

_UTF8: Final = 4
"""Bytes that a character may take [1]."""


@dataclass(frozen=True)
class Bounds:
    """Most that MessagePack takes for one value, and for the parts that it is made of."""

    size: int
    """Bytes in all, however long-winded the writer [B]."""
    text: int = 0
    """Longest string, or name of a field [B]."""
    binary: int = 0
    """Longest byte string [B]."""
    array: int = 0
    """Elements of the longest array [1]."""
    fields: int = 0
    """Entries of the message's map; no other map is in it [1]."""

    def covering(self, *others: "Bounds") -> "Bounds":
        """Return bounds for any one of several values."""
        each = (self, *others)
        return Bounds(
            max(b.size for b in each),
            max(b.text for b in each),
            max(b.binary for b in each),
            max(b.array for b in each),
        )


@cache
def bounds_of(kind: type[BaseModel]) -> Bounds | None:
    """Return the bounds of messages of a kind, None where a field has none."""
    values = [_bounds(field.annotation, field.metadata) for field in kind.model_fields.values()]
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return None
    # The version is a field of its own, `v`.
    names = [_text(name) for name in (*kind.model_fields, "v")]
    size = _HEAD + _NUMBER + sum(b.size for b in (*known, *names))
    one = names[0].covering(*names, *known)
    return Bounds(size, one.text, one.binary, one.array, len(names))


def _bounds(kind: Any, metadata: Iterable[object] = ()) -> Bounds | None:
    """Return the bounds of a field's type, None where it has none."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _bounds(parts[0], (*parts[1:], *metadata))
    longest = _longest(metadata)
    if origin in (Union, UnionType):
        return _any_of(_bounds(part, metadata) for part in parts)
    if origin is Literal:
        return _any_of(_text(value) for value in parts)
    if origin is tuple:
        return _array(parts, longest)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return _any_of(_text(member.value) for member in kind)
    if kind in (int, float, bool, NoneType):
        return Bounds(_NUMBER)
    if longest is not None and kind is str:
        return Bounds(_HEAD + _UTF8 * longest, text=_UTF8 * longest)
    if longest is not None and kind is bytes:
        return Bounds(_HEAD + longest, binary=longest)
    return None


def _longest(metadata: Iterable[object]) -> int | None:
    """Return the length that a field's constraints allow, None for any."""
    for item in metadata:
        if isinstance(item, MaxLen):
            return item.max_length
        nested = getattr(item, "metadata", None)  # a Field within Annotated
        if nested and (found := _longest(nested)) is not None:
            return found
    return None


def _array(parts: tuple[Any, ...], longest: int | None) -> Bounds | None:
    if parts[-1] is Ellipsis:
        if longest is None:
            return None
        parts = (parts[0],) * longest
    elements = [_bounds(part) for part in parts]
    known = [element for element in elements if element is not None]
    if len(known) < len(elements):
        return None
    inside = known[0].covering(*known)
    size = _HEAD + sum(element.size for element in known)
    return Bounds(size, inside.text, inside.binary, max(inside.array, len(parts)))


def _any_of(several: Iterable[Bounds | None]) -> Bounds | None:
    each = list(several)
    known = [bounds for bounds in each if bounds is not None]
    return known[0].covering(*known) if len(known) == len(each) else None


def _text(text: str) -> Bounds:
    length = len(text.encode())
    return Bounds(_HEAD + length, text=length)


# --- The one table of topics that cross Zenoh; a script's step names its topic by the key here ----
#
# A full key is `telerobot/<cell>/<key>`. With this table, a Zenoh, a MessagePack and a
# cryptography library, any language can drive an arm: `proof.py` says how the lease's
# secret is agreed, `proof.py` what a message of its holder carries.

PREFIX = "telerobot"
"""First part of every key."""

SENDER = r"[a-z][a-z0-9_-]{0,63}"
"""Names of senders in keys; with certificates that of the certificate."""


class Role(StrEnum):
    """Role of a party on the network; access control follows from it (`roles.py`)."""

    DAEMON = "daemon"
    OPERATOR = "operator"
    SENSOR = "sensor"
    OBSERVER = "observer"
    """Listens, and nothing else."""
    RIG = "rig"
    """The virtual hardware."""
    JUDGE = "judge"
    """Gives faults to the virtual hardware, and hears the truth."""
    ROUTER = "router"
    """Passes on what others may say; says nothing itself."""


class Flow(Enum):
    """Who sends on a topic, how, and to whom."""

    COMMAND = ("put", Role.OPERATOR, Role.DAEMON)
    """By the operator who holds the lease, with a proof of it; newest wins; no answer."""
    REQUEST = ("ask", Role.OPERATOR, Role.DAEMON)
    """By an operator, most with a proof of the lease; answered with a `Reply`."""
    SENSOR = ("put", Role.SENSOR, Role.DAEMON, Role.OPERATOR, Role.OBSERVER)
    """Read without a lease: it is no order, and it counts only as long as the tick that it
    belongs to is recent. People are shown it, too. While the arm is enabled it can move it,
    inside bounds of the cell that `telerobot check` tells: a picture once the lease holder has
    stored a view and switched vision on; a frame where motion is relative to it, or to World on
    a Base that moves, at rest, too; an obstacle turns aside or stops what somebody asks for,
    and pushes the elbow where the cell has a field or virtual spheres; a contour slows a base
    down, and folds the arm of one that is driven ahead. A sensor may put only on the keys that
    it is certified for."""
    PICTURE = ("put", Role.SENSOR, Role.OPERATOR, Role.OBSERVER)
    """For people's eyes: the daemon does not read it."""
    TELEMETRY = (
        "put", Role.DAEMON,
        Role.OPERATOR, Role.SENSOR, Role.OBSERVER, Role.RIG, Role.JUDGE,
    )  # fmt: skip
    RIG_COMMAND = ("put", Role.JUDGE, Role.RIG)
    # Virtual cameras are sensors, and see where the rig says that things are; people see it drawn.
    RIG_TELEMETRY = ("put", Role.RIG, Role.SENSOR, Role.OPERATOR, Role.OBSERVER, Role.JUDGE)

    def __init__(self, verb: str, sender: Role, *receivers: Role) -> None:
        self.asks = verb == "ask"
        self.sender = sender
        self.receivers = frozenset(receivers)


class Life(Enum):
    """How long a command is true."""

    STREAM = auto()
    """Now only: expires by age, then fades."""
    GOAL = auto()
    """Until replaced, cancelled, or the lease ends."""
    ONCE = auto()
    """An act."""


@dataclass(frozen=True)
class Topic:
    """One row: key, message, direction, life, usual rate. What is congested is dropped."""

    key: str
    message: type[m.Message]
    flow: Flow
    life: Life = Life.ONCE
    rate_hz: float | None = None
    """Rate that a well-behaved sender keeps to; None: when needed."""
    largest: int | None = None
    """Largest payload [B] of a message whose fields do not tell it (`topics.py`)."""
    unread: int = 8
    """So many unread messages are kept; older ones are dropped for newer ones."""
    told_with: str = ""
    """Key of the sensor whose certificate covers this topic, too."""
    by_sender: bool = False
    """Its full key may go on with its sender's name, `KEY/NAME`: what one tells is its own."""
    by_camera: bool = False
    """Its full key goes on with a camera's name: who looks at one camera hears that one alone."""
    sender: str = ""
    """Name of who sends, of a topic `by_sender`; of the camera, of one `by_camera`."""

    @cached_property
    def max_bytes(self) -> int:
        """Longer payloads are refused unread [B]."""
        bounds = bounds_of(self.message)
        if self.largest is not None:
            return self.largest
        if bounds is None:
            raise TypeError(f"{self.key}: nothing bounds its messages")
        return bounds.size

    @cached_property
    def needs_proof(self) -> bool:
        """True where only the lease's holder is heard, and has to prove the lease (`proof.py`)."""
        return issubclass(self.message, m.Command)

    def every(self, period_s: float) -> int:
        """Return the number of periods [s] between two messages that keep to its rate [1]."""
        return 1 if self.rate_hz is None else max(1, ceil(1.0 / (self.rate_hz * period_s) - 1e-9))

    def by(self, sender: str) -> Self:
        """Return this topic as one sender, or of one camera; itself where keys name neither."""
        return replace(self, sender=sender) if self.by_sender or self.by_camera else self

    def full_key(self, cell: str) -> str:
        """Return the Zenoh key of this topic in a cell."""
        named = f"/{self.sender}" if self.sender else ""
        return f"{PREFIX}/{cell}/{self.key}{named}"

    def heard_key(self, cell: str) -> str:
        """Return the key expression to listen on: that of all senders, or all cameras."""
        if self.by_camera and not self.sender:
            return self.put_key(cell)
        return self.full_key(cell) + ("/**" if self.by_sender else "")

    def put_key(self, cell: str) -> str:
        """Return the key expression that the right to put on it names: that of all cameras."""
        return f"{PREFIX}/{cell}/{self.key}/*" if self.by_camera else self.full_key(cell)

    def sender_on(self, full_key: str, cell: str) -> str | None:
        """Return who sent on a full key: empty for nobody by name; None if it is another key."""
        own, _, name = full_key.partition(self.full_key(cell))
        if own or not (name == "" or (self.by_sender and re.fullmatch(f"/{SENDER}", name))):
            return None
        return name.removeprefix("/")


def _command(key: str, message: type[m.Message], life: Life, rate_hz: float | None = None) -> Topic:
    return Topic(f"cmd/{key}", message, Flow.COMMAND, life, rate_hz)


def _request(key: str, message: type[m.Message]) -> Topic:
    return Topic(f"operator/{key}", message, Flow.REQUEST)


KEEPALIVE = _command("keepalive", m.Keepalive, Life.ONCE, 10)
JOYSTICK = _command("joystick", m.JoystickTwist, Life.STREAM, 100)
POSITION = _command("position", m.PositionTarget, Life.GOAL)
FORCE = _command("force", m.DesiredWrench, Life.GOAL)
JOG = _command("jog", m.JointJog, Life.STREAM, 100)
SELF_MOTION = _command("self_motion", m.SelfMotion, Life.STREAM, 100)
ARM_ANGLE = _command("arm_angle", m.ArmAngle, Life.GOAL)
POSTURE = _command("posture", m.PostureMove, Life.GOAL)
PATH = _command("path", motion.PathMotion, Life.GOAL)
MASTER_POSE = _command("master_pose", motion.MasterPose, Life.STREAM, 100)
DRIVE = _command("drive", Drive, Life.STREAM, 100)
INSERT = _command("insert", Insert, Life.GOAL)
CANCEL = _command("cancel", m.CancelGoals, Life.ONCE)

SIGHTING = Topic("sensor/vision", Sighting, Flow.SENSOR, Life.STREAM, 20)
# News of one obstacle must not push out another's.
OBSTACLE = Topic(
    "sensor/obstacle", ObstacleNews, Flow.SENSOR, Life.STREAM, 20, unread=128,
    by_sender=True,
)  # fmt: skip
"""An obstacle is its first sender's: nobody else moves or removes it."""
CONTOUR = Topic("sensor/contour", ContourNews, Flow.SENSOR, Life.STREAM, 25)
PICTURE = Topic("view/picture", CameraPicture, Flow.PICTURE, Life.STREAM, 5, told_with=SIGHTING.key)
"""Only while somebody looks."""
VIDEO = Topic(
    "view/video", VideoPiece, Flow.PICTURE, Life.STREAM, 20, told_with=SIGHTING.key, by_camera=True,
    unread=64,
)  # fmt: skip
"""Only while somebody looks at that camera large."""
SCAN = Topic("view/scan", ScanPoints, Flow.PICTURE, Life.STREAM, 25, told_with=CONTOUR.key)
"""As a recorder hears it. STATE, DESCRIPTION, REFLECTION and TICK go while somebody listens."""
FRAME_NEWS = Topic("sensor/frame", moving.FrameNews, Flow.SENSOR, Life.STREAM, 50)

LEASE = _request("lease", requests.LeaseRequest)
RELEASE = _request("release", requests.LeaseRelease)
MODE = _request("mode", requests.ModeRequest)
PROTECTIVE_STOP = _request("protective_stop", requests.ProtectiveStop)
PROTECTIVE_CLEAR = _request("protective_clear", requests.ProtectiveClear)
GAIN = _request("gain", requests.GainRequest)
SWITCH = _request("switch", requests.SwitchRequest)
FRAME = _request("frame", moving.FrameRequest)
SPEED = _request("speed", requests.SpeedRequest)
TARE = _request("tare", requests.TareRequest)
PAYLOAD = _request("payload", requests.PayloadRequest)
ACKNOWLEDGE_LOAD = _request("acknowledge_load", requests.AcknowledgeLoad)
GRIPPER = _request("gripper", requests.GripperRequest)
HOLD_TOGETHER = _request("hold_together", requests.HoldTogether)
MARK = _request("mark", requests.MarkRequest)
REDUNDANCY = _request("redundancy", motion.RedundancyRequest)
FREE_AXES = _request("free_axes", motion.FreeAxesRequest)
VIRTUAL_LINKS = _request("virtual_links", motion.VirtualLinksRequest)
LOAD_SHARES = _request("load_shares", motion.LoadSharesRequest)
TUNNEL = _request("tunnel", motion.TunnelRequest)
PATH_CONTROL = _request("path", motion.PathRequest)
CLUTCH = _request("clutch", motion.ClutchRequest)
STORE_VIEW = _request("store_view", StoreView)
AVOIDANCE = _request("avoidance", AvoidanceRequest)
REFLECT = _request("reflection", ReflectionRequest)

STATE = Topic("tlm/state", State, Flow.TELEMETRY, Life.STREAM, 100, largest=65536)
"""Of every tick, or at periods below 10 ms no more often than that rate."""

EVENT = Topic("tlm/event", Event, Flow.TELEMETRY, largest=65536)
DESCRIPTION = Topic("tlm/description", Description, Flow.TELEMETRY, Life.GOAL, 5, largest=65536)
REFLECTION = Topic("tlm/reflection", Reflection, Flow.TELEMETRY, Life.STREAM, 100)
"""Only of cells that reflect forces."""

TICK = Topic("tlm/tick", RecordedTick, Flow.TELEMETRY, Life.STREAM, 100)
"""As a recorder hears it. STATE, DESCRIPTION, REFLECTION and TICK go while somebody listens."""

HELD = Topic("tlm/obstacle", ObstacleNews, Flow.TELEMETRY, Life.STREAM, 20, unread=128)
"""An obstacle as the daemon holds it, while somebody listens: news that it refused is not."""

RIG_FAULT = Topic("rig/fault", RigFault, Flow.RIG_COMMAND)
RIG_MOTION = Topic("rig/motion", moving.RigMotion, Flow.RIG_COMMAND)
RIG_TRUTH = Topic("rig/truth", RigTruth, Flow.RIG_TELEMETRY, Life.STREAM, 100, largest=65536)

TOPICS: tuple[Topic, ...] = (
    KEEPALIVE, JOYSTICK, POSITION, FORCE, JOG, SELF_MOTION, ARM_ANGLE, POSTURE, PATH, MASTER_POSE,
    DRIVE, INSERT, CANCEL,
    SIGHTING, OBSTACLE, CONTOUR, FRAME_NEWS, PICTURE, VIDEO, SCAN,
    LEASE, RELEASE, MODE, PROTECTIVE_STOP, PROTECTIVE_CLEAR, GAIN, SWITCH, FRAME, SPEED, TARE,
    PAYLOAD, ACKNOWLEDGE_LOAD, GRIPPER, HOLD_TOGETHER, MARK, STORE_VIEW,
    REDUNDANCY, FREE_AXES, VIRTUAL_LINKS, LOAD_SHARES, TUNNEL, PATH_CONTROL, CLUTCH, AVOIDANCE,
    REFLECT,
    STATE, REFLECTION, EVENT, DESCRIPTION, TICK, HELD,
    RIG_FAULT, RIG_MOTION, RIG_TRUTH,
)  # fmt: skip

COMMANDS = tuple(t for t in TOPICS if t.flow is Flow.COMMAND)
SENSORS = tuple(t for t in TOPICS if t.flow is Flow.SENSOR)
REQUESTS = tuple(t for t in TOPICS if t.flow is Flow.REQUEST)
