"""Tables of a script that are no message: motions over time, a device, the network, raw bytes."""

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from ....protocols import topics as t
from ....protocols.messages import messages as m
from ....protocols.messages.perception import ObstacleNews
from ..message import TopicMessage

KEYS = tuple(topic.key for topic in t.TOPICS)

SCRIPT = "script"
"""Name under which a script tells of obstacles, where no certificate has another."""


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
    `swing` turns by it about the axis that it is driven along.
    """

    task: m.Identifier | None = None
    velocity: m.Vector3
    """[m/s]"""
    expressed_in: Literal["world", "mrf"] = "mrf"
    way: float = Field(gt=0, le=1)
    """[m]"""
    search: float = Field(0.0, ge=0, le=0.05)
    """[m]"""
    tilt: float = Field(0.0, ge=0, le=0.2)
    """[rad]"""
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
    delay_s: float = Field(0.0, ge=0, le=60)
    """Delay one way, the same in both directions."""
    jitter: float = Field(0.0, ge=0, le=1)
    loss: float = Field(0.0, ge=0, lt=1)


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
