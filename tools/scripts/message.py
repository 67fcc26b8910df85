"""Message of a script's step: a topic and its fields, judged as if they came on the wire."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ...protocols import topics as t
from ...protocols.codec import CodecError, message_of
from ...protocols.messages import messages as m
from ...protocols.topics import Flow, Topic

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
