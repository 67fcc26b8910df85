"""Step of a script: a time, an operator, and one topic with its fields or one generator."""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, Field, InstanceOf, model_validator

from ...config.errors import nearest
from ...protocols import topics as t
from ...protocols.messages import messages as m
from .generators.tables import (
    DrivenInsertion,
    HandleMotion,
    LinkConditions,
    MovingMaster,
    MovingObstacle,
    MovingTarget,
    Raw,
    ScriptTable,
)
from .message import SPOKEN, TopicMessage

WHEN = ("at_s", "operator", "for_s")
"""Keys of every step."""

GENERATORS = ("silence", "link", "master", "device", "target", "obstacle", "insertion", "raw")
"""Keys of steps that are no message."""

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

    @model_validator(mode="before")
    @classmethod
    def _read(cls, data: Any) -> Any:
        """Take the key beside the common ones for a topic or a generator."""
        if not isinstance(data, Mapping):
            return data
        keys = [key for key in data if key not in WHEN]
        if len(keys) != 1:
            found = ", ".join(map(str, keys)) or "none"
            raise ValueError(
                f"one topic or one of {', '.join(GENERATORS)} is expected, not {found}"
            )
        (key,) = keys
        if key in GENERATORS:
            return data
        topic = SPOKEN.get(key)
        if topic is None:
            raise ValueError(
                f"{key}: neither a topic nor one of {', '.join(GENERATORS)}"
                + nearest(str(key), (*SPOKEN, *GENERATORS))
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
            return frozenset({t.MASTER_POSE.key})
        if self.insertion is not None:
            key, task = t.JOYSTICK.key, self.insertion.task
            return frozenset({f"{key}:{task}" if task else key})
        if self.message is not None and self.message.topic.key in STREAMS:
            fields = self.message.fields
            named = fields.get("task") or fields.get("mechanism")
            key = self.message.topic.key
            return frozenset({f"{key}:{named}" if named else key})
        return frozenset(self.silence)
