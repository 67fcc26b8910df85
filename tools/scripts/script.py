"""Scripts: tables, steps, messages and expectations, as TOML files say them."""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    InstanceOf,
    ValidationError,
    field_validator,
    model_validator,
)
from pydantic_core import ErrorDetails

from ...config.errors import nearest
from ...config.load import ConfigError, read_toml, script_path
from ...protocols import topics as t
from ...protocols.codec import CodecError, message_of
from ...protocols.messages import messages as m
from ...protocols.messages.perception import ObstacleNews
from ...protocols.messages.telemetry import State
from ...protocols.topics import Flow, Topic
from ..client.protocol_client import stream_name

# --- Message of a script's step: a topic and its fields, judged as if they came on the wire -------
SPOKEN: dict[str, Topic] = {
    topic.key: topic
    for topic in t.TOPICS
    if topic.flow in (Flow.COMMAND, Flow.REQUEST, Flow.SENSOR, Flow.RIG_COMMAND)
}
"""Topics that a script may send on, by key."""

FILLED: dict[str, Any] = {"seen_tick": 0, "tick": 0, "operator": "operator", "key": bytes(32)}
"""Fields that a sender fills in by itself, with values to judge the others beside."""

KEPT = ("seal", "opens")
"""Fields that belong to one operator's client: secrets of a protective stop."""


@dataclass(frozen=True)
class TopicMessage:
    """A topic and the fields that a step gives; `of` checks them."""

    topic: Topic
    fields: Mapping[str, Any]

    @classmethod
    def of(cls, topic: Topic, fields: object) -> "TopicMessage":
        """Return the message of plain fields. Raises `ValueError`: topic, field, value, bound."""
        if not isinstance(fields, Mapping):
            raise ValueError(
                f"{topic.key}: value {str(fields)[:40]}: a table of fields is expected"
            )
        own = [name for name in (*FILLED, *KEPT) if name in fields]
        if own and own[0] in topic.message.model_fields:
            raise ValueError(f"{topic.key}: {own[0]}: is filled in by its sender")
        filled = {k: v for k, v in FILLED.items() if k in topic.message.model_fields}
        try:
            message = message_of(topic, {**fields, **filled})
        except CodecError as error:
            raise ValueError(f"{topic.key}: {error.detail}") from None
        return cls(topic, {name: getattr(message, name) for name in fields})

    def make(self, tick: int) -> m.Message:
        """Return the message, for topics that no operator speaks on; sensors' carry their tick."""
        stamp = {"tick": tick} if "tick" in self.topic.message.model_fields else {}
        return self.topic.message(**stamp, **self.fields)


# --- Tables of a script that are no message: motions over time, a device, the network, raw bytes
KEYS = tuple(topic.key for topic in t.TOPICS)

SCRIPT = "script"  # name under which a script tells of obstacles, where no certificate has another


class ScriptTable(BaseModel):
    """A table of a script: unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class MovingMaster(ScriptTable):
    """A master device whose handle moves at a twist; its pose is streamed."""

    twist: m.Twist
    expressed_in: m.Frame = m.Frame.CRF


class HandleMotion(ScriptTable):
    """A force-reflecting handle and the hand on it; an absent field keeps its value.

    `hand` is the hand's intended place, from the handle's centre [m], in the axes of
    `expressed_in`, reached within `seconds`. As a stick (`rate`) the deflection asks for a rate, as
    a master (`pose`) the motion leads the tool.
    """

    mode: Literal["rate", "pose"] | None = None
    hand: m.Vector3 | None = None
    seconds: float = Field(0.5, gt=0, le=60)
    held: bool | None = None
    expressed_in: m.Frame | None = None


class MovingTarget(ScriptTable):
    """A camera's target that moves straight, and news of where its sight line ends."""

    tag: str = Field(max_length=32)
    sight_line: str | None = Field(None, max_length=32)
    start: m.Place
    to: m.Place
    speed: float = Field(gt=0, le=10)


class MovingObstacle(ScriptTable):
    """An obstacle in the physics and in the news: placed, moved on at its velocity, or removed.

    Beside the keys below it takes the fields of `sensor/obstacle`: those of its first news. Without
    `physical` it is only told, without `tell` only there. One with a velocity is told 20 times a
    second; `silent` ends the news while it moves on. With `remove` it stands still where it is.
    """

    news: ObstacleNews
    physical: bool = True
    tell: bool = True
    silent: bool = False

    @model_validator(mode="before")
    @classmethod
    def _split(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        own = {key: data[key] for key in ("physical", "tell", "silent") if key in data}
        told = {key: value for key, value in data.items() if key not in own}
        return {**own, "news": TopicMessage.of(t.OBSTACLE, told).make(0)}


class DrivenInsertion(ScriptTable):
    """A tool or payload that a stick drives in until it went its way, and a search where it jams.

    Force control has to be on: the stick presses with its speed over the gain. `search` is the
    radius of the spiral, 0 for none; while it goes round, it leans to and fro by `tilt`, or with
    `swing` turns by it about the axis that it is driven along. That is for a payload with several
    pegs, which is also kept from turning about the others: one peg goes no further than the rest.
    """

    task: m.Identifier | None = None
    velocity: m.Vector3  # [m/s]
    expressed_in: Literal["world", "mrf"] = "mrf"
    way: float = Field(gt=0, le=1)  # [m]
    search: float = Field(0.0, ge=0, le=0.05)  # [m]
    tilt: float = Field(0.0, ge=0, le=0.2)  # [rad]
    swing: bool = False

    @field_validator("velocity")
    @classmethod
    def _goes(cls, velocity: m.Vector3) -> m.Vector3:
        speed = sum(x * x for x in velocity) ** 0.5
        if not 1e-4 <= speed <= 0.1:
            raise ValueError(f"{speed:g} m/s: 0.0001 to 0.1 is expected")
        return velocity


class LinkConditions(ScriptTable):
    """An operator's connection from now on."""

    cut: bool = False
    delay_s: float = Field(0.0, ge=0, le=60)  # delay one way, the same in both directions
    jitter: float = Field(0.0, ge=0, le=1)  # part of the delay by which it varies, each time anew
    loss: float = Field(0.0, ge=0, lt=1)  # part of what is sent that does not arrive


class Until(ScriptTable):
    """What is to be so before the script goes on: all that is given, as its operator sees it.

    The script's time stands still meanwhile, its streams go on. After `timeout_s` the steps of
    `else` take the place of the rest, timed from then; without any the script has failed.
    """

    model_config = ConfigDict(populate_by_name=True)

    timeout_s: float = Field(gt=0, le=3600)
    task: m.Identifier | None = None
    at_goal: Literal[True] | None = None
    distance_m: float | None = Field(None, gt=0, le=10)  # of the measured MRF from its target
    view_error_m: float | None = Field(None, gt=0, le=10)
    view_error_rad: float | None = Field(None, gt=0, le=4)  # from the stored view, at most
    view_error_px: float | None = Field(None, gt=0, le=1e4)  # the same of its picture, rms
    force_n: float | None = Field(None, gt=0, le=1e5)  # at least, of the tool or the payload
    mode: Literal["ready", "enabled", "hold", "fault"] | None = None
    otherwise: "tuple[Step, ...]" = Field((), alias="else")

    @model_validator(mode="after")
    def _asks_something(self) -> "Until":
        asked = self.model_fields_set - {"timeout_s", "task", "otherwise"}
        if not asked or any(step.until is not None for step in self.otherwise):
            raise ValueError("something to wait for is expected, and nothing of it in its else")
        return self

    def missing(self, state: State) -> str | None:
        """Return what is not so yet, with its value; None where all is."""
        told = state.of(self.task)
        if self.mode is not None and state.mode != self.mode:
            return f"mode {state.mode}, {self.mode} is expected"
        if self.at_goal and not told.at_goal:
            return "not at its goal"
        off = (
            None
            if told.target_mrf is None
            else math.dist(told.pose_mrf_measured[:3], told.target_mrf[:3])
        )
        force = None if told.wrench_mrf is None else math.hypot(*told.wrench_mrf[:3])
        view = told.view_error or (None, None)
        for name, found, least in (
            ("distance_m", off, False),
            ("view_error_m", view[0], False),
            ("view_error_rad", view[1], False),
            ("view_error_px", told.view_error_px, False),
            ("force_n", force, True),
        ):
            bound = getattr(self, name)
            if bound is None:
                continue
            if found is None or not (found >= bound if least else found <= bound):
                wanted = Bounds(least=bound) if least else Bounds(most=bound)
                return f"{name}: {_shown(found)}, {wanted} is expected"
        return None


class Network(ScriptTable):
    """The operators' network from the start: round trip, its variation, its losses."""

    rtt_s: float = Field(0.0, ge=0, le=10)
    jitter: float = Field(0.0, ge=0, le=1)
    loss: float = Field(0.0, ge=0, lt=1)
    seed: int = Field(1, ge=0)


class Raw(ScriptTable):
    """Bytes put on a topic unchecked, to see them refused.

    `proof` is the attachment: bytes again, or "lease" for a proof of the operator's lease.
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


# --- Step of a script: a time, an operator, and one topic with its fields or one generator --------
WHEN = ("at_s", "operator", "for_s")  # keys of every step

STREAMS = frozenset(
    topic.key
    for topic in SPOKEN.values()
    if topic.flow is t.Flow.COMMAND and topic.life is t.Life.STREAM
)
"""Keys of commands that are repeated until another replaces or silences them."""


def _stream(key: str) -> str:
    if key.partition(":")[0] not in STREAMS:
        raise ValueError(f"one of {', '.join(sorted(STREAMS))} is expected")
    return key


StreamKey = Annotated[str, AfterValidator(_stream)]


class Step(ScriptTable):
    """One moment of a script: beside its time, one topic with its fields, or one generator."""

    at_s: Annotated[float, Field(ge=0)]
    operator: m.OperatorName = "operator"
    for_s: Annotated[float, Field(gt=0, le=3600)] | None = None
    """Length of a stream [s]; absent, until the next step of its topic."""
    message: InstanceOf[TopicMessage] | None = None
    silence: tuple[StreamKey, ...] = ()
    """Streams that fall silent: all of a topic, or as `cmd/joystick:NAME` that of one task."""
    link: LinkConditions | None = None
    master: MovingMaster | None = None
    device: HandleMotion | None = None
    target: MovingTarget | None = None
    obstacle: MovingObstacle | None = None
    insertion: DrivenInsertion | None = None
    raw: Raw | None = None
    until: Until | None = None

    @model_validator(mode="before")
    @classmethod
    def _read(cls, data: Any) -> Any:
        """Take the key beside the common ones for a topic or a generator."""
        if not isinstance(data, Mapping):
            return data
        keys = [key for key in data if key not in WHEN]
        generators = [name for name in cls.model_fields if name not in (*WHEN, "message")]
        if len(keys) != 1:
            found = ", ".join(map(str, keys)) or "none"
            raise ValueError(
                f"one topic or one of {', '.join(generators)} is expected, not {found}"
            )
        (key,) = keys
        if key in generators:
            return data
        topic = SPOKEN.get(key)
        if topic is None:
            raise ValueError(
                f"{key}: neither a topic nor one of {', '.join(generators)}"
                + nearest(str(key), (*SPOKEN, *generators))
            )
        when = {name: data[name] for name in WHEN if name in data}
        return {**when, "message": TopicMessage.of(topic, data[key])}

    @model_validator(mode="after")
    def _lasts(self) -> "Step":
        if self.for_s is not None and (not self.streams or self.silence):
            raise ValueError(f"for_s: value {self.for_s:g}: only a stream lasts")
        return self

    def says(self, topic: t.Topic) -> Mapping[str, Any] | None:
        """Return the fields of this step's message on a topic; None where it has none."""
        said = self.message
        return said.fields if said is not None and said.topic is topic else None

    @property
    def streams(self) -> frozenset[str]:
        """Streams that begin, change or end here, as `silence` has them."""
        if self.master is not None:
            topic, named = t.MASTER_POSE, ""
        elif self.insertion is not None:
            topic, named = t.JOYSTICK, self.insertion.task or ""
        elif self.message is not None and self.message.topic.key in STREAMS:
            topic, named = stream_name(self.message.topic, self.message.fields)
        else:
            return frozenset(self.silence)
        return frozenset({f"{topic.key}:{named}" if named else topic.key})


Until.model_rebuild()


# --- Expectations of a script: what its run is to reach, judged by the figures of the simulation
#
# [expect]
#     mode = "enabled"
#     tool_error_m = { most = 0.001 }
#     contact_force_n = { least = 9.0, most = 11.0 }
#
# Figures are the physics' own. Where a figure has several values (each peg's depth), all of
# them count. A run that has no such figure has missed it.
class Bounds(ScriptTable):
    """Bounds of a figure, both of them inclusive; an absent one is open."""

    least: float | None = None
    most: float | None = None

    @model_validator(mode="after")
    def _bound_something(self) -> "Bounds":
        if self.least is None and self.most is None:
            raise ValueError("least or most is expected")
        if self.least is not None and self.most is not None and self.least > self.most:
            raise ValueError(f"least {self.least:g} is above most {self.most:g}")
        return self

    def hold(self, values: list[float]) -> bool:
        """Return whether there are values, and all are within."""
        least = -float("inf") if self.least is None else self.least
        most = float("inf") if self.most is None else self.most
        return bool(values) and all(least <= value <= most for value in values)

    def __str__(self) -> str:
        parts = [] if self.least is None else [f"at least {self.least:g}"]
        return " and ".join(parts if self.most is None else [*parts, f"at most {self.most:g}"])


class Expected(NamedTuple):
    """One expectation beside what was found; plain values, a row of the simulation's JSON."""

    figure: str
    expected: str
    found: Any  # value of the figure; None: it was not measured
    met: bool

    def __str__(self) -> str:
        return f"{self.figure}: {_shown(self.found)}, {self.expected} is expected"


class Expectations(ScriptTable):
    """What a run is to reach. Without a mode, it may end in any but FAULT."""

    mode: Literal["ready", "enabled", "hold", "fault"] | None = None  # mode at the end
    events: tuple[str, ...] = ()  # events that are to be told, by name, in any order
    refused: Bounds = Bounds(most=0)  # number of steps that the daemon refuses
    tool_error_m: Bounds | None = None
    tool_error_rad: Bounds | None = None
    """Of the tool from its target, the largest over the last half second."""
    posture_error_rad: Bounds | None = None
    """Of the farthest joint from the posture that was last asked for, at the end."""
    view_error_m: Bounds | None = None
    view_error_rad: Bounds | None = None  # of the Lens from the stored view, at the end
    view_error_px: Bounds | None = None  # of the tag's corners from the stored picture, rms
    contact_force_n: Bounds | None = None
    """Mean over the last second, as a sum of magnitudes over the solids that touch."""
    contact_peak_n: Bounds | None = None  # the greatest such sum in any physics step
    own_contact_n: Bounds | None = None
    """The same of what arms and payload press on themselves and each other."""
    min_clearance_m: Bounds | None = None
    min_between_arms_m: Bounds | None = None
    min_sight_m: Bounds | None = None
    peg_depth_m: Bounds | None = None  # how deep each peg is at the end
    internal_force_n: Bounds | None = None
    stretch_m: Bounds | None = None
    push_n: Bounds | None = None  # of a payload, and what the payload pushes with
    insertion_m: Bounds | None = None
    deepest_m: Bounds | None = None
    """How far the tip of a backbone is in along the centre line: at the end, and at most."""
    centre_error_m: Bounds | None = None
    wall_force_n: Bounds | None = None
    base_travel_m: Bounds | None = None
    odometry_error_m: Bounds | None = None
    odometry_error_rad: Bounds | None = None

    def ends_well(self, mode: str) -> bool:
        """Return whether a run may end in this mode."""
        return mode != "fault" if self.mode is None else mode == self.mode

    def judge(self, summary: Mapping[str, Any]) -> list[Expected]:
        """Return every expectation, beside what a simulation's summary shows."""
        mode = summary["mode"]
        wanted = "any but fault" if self.mode is None else self.mode
        told = {event["name"] for event in summary["events"]}
        rows = [Expected("mode", wanted, mode, self.ends_well(mode))]
        rows += [Expected("event", name, name in told, name in told) for name in self.events]
        return rows + list(self._figures(summary))

    def _figures(self, summary: Mapping[str, Any]) -> Iterator[Expected]:
        for name in type(self).model_fields:
            bounds = getattr(self, name)
            if isinstance(bounds, Bounds):
                found = len(summary[name]) if name == "refused" else summary.get(name)
                yield Expected(name, str(bounds), found, bounds.hold(_values(found)))


def _values(found: Any) -> list[float]:
    if found is None:
        return []
    if isinstance(found, Mapping):
        return list(found.values())
    return list(found) if isinstance(found, list | tuple) else [found]


def _shown(found: Any) -> str:
    if found is None:
        return "not measured"
    if isinstance(found, bool):
        return "told" if found else "not told"
    if isinstance(found, str):
        return found
    return ", ".join(f"{value:.4g}" for value in _values(found))


# --- Scripts: actions of operators, and events around the arm, over time, in TOML -----------------
#
# duration_s = 6.0
#     [[step]]
#     at_s = 0.5
#     for_s = 2.0
#     "cmd/joystick" = { twist = [0.05, 0, 0, 0, 0, 0], expressed_in = "base" }
#     [expect]
#     mode = "enabled"
#
# A step is a topic (`protocols/topics.py`) and the fields of its message. Times count from the
# moment the arm is enabled. The same script drives a simulation and a running daemon.
SAME_S = 1e-9  # steps that are no further apart happen at once [s]


class Script(ScriptTable):
    """A run: its length, its network, its steps."""

    description: str = ""
    duration_s: float = Field(gt=0, le=3600)
    auto_enable: bool = True  # the operator takes the lease and enables the arm before time starts
    network: Network = Network()
    expect: Expectations = Expectations()  # what the run is to reach
    step: tuple[Step, ...] = ()

    @property
    def steps(self) -> tuple[Step, ...]:
        """The steps in order of time; a stream with an end is followed by its silence."""
        return in_order(self.step)


def in_order(steps: Iterable[Step], from_s: float = 0.0) -> tuple[Step, ...]:
    """Return steps in order of time, counted from a time [s], and what ends their streams."""
    moved = (step.model_copy(update={"at_s": from_s + step.at_s}) for step in steps)
    found = sorted(moved, key=lambda step: step.at_s)
    ends = [end for i, step in enumerate(found) if (end := _end(step, found[i + 1 :]))]
    return tuple(sorted([*ends, *found], key=lambda step: step.at_s))


def _end(step: Step, later: list[Step]) -> Step | None:
    """Return the silence after a stream's step; None without an end or before another step."""
    if step.for_s is None:
        return None
    end_s = step.at_s + step.for_s
    for other in later:
        if other.at_s > end_s + SAME_S:
            break
        if other.operator == step.operator and other.streams & step.streams:
            return None
    return Step(at_s=end_s, operator=step.operator, silence=tuple(step.streams))


def load_script(name_or_path: str | Path) -> Script:
    """Load a script: a path, or the name of a shipped one. Raises `ConfigError`."""
    path = script_path(name_or_path, Path())
    document = read_toml(path)
    try:
        return Script.model_validate(document)
    except ValidationError as error:
        raise ConfigError(f"{path}: {_explain(error.errors()[0], document)}") from None


def _explain(error: ErrorDetails, document: dict[str, Any]) -> str:
    """Return one error: the key, the time of its step, the value and the expectation."""
    loc, words = error["loc"], error["msg"].removeprefix("Value error, ")
    key = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in loc).removeprefix(".")
    match loc:
        case ("step", int(i), *_) if "at_s" in document["step"][i]:
            key += f" (at_s = {document['step'][i]['at_s']})"
    value = error["input"]
    shown = "" if isinstance(value, dict) else f"value {str(value)[:60]}: "
    return f"{key}: {shown}{words}"
