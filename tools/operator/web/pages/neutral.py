"""Streams that a page may hold, and what each says once it is let go of."""

from collections.abc import Mapping
from typing import Any, Final

from .....protocols import topics as t

STREAMS: Final = (t.JOYSTICK, t.JOG, t.DRIVE, t.MASTER_POSE)


def stream_name(topic: t.Topic, fields: Mapping[str, Any]) -> tuple[t.Topic, str]:
    """Return what tells one stream from another: its topic, and the task or mechanism."""
    return topic, str(fields.get("task") or fields.get("mechanism") or "")


def neutral(fields: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the same stream asking for nothing; None for one that ends by silence.

    A stick at zero stops at once; one that falls silent only when the daemon's timeout is over.
    A master's pose moves nothing while it stays what it is.
    """
    for key in ("twist", "rates"):
        if key in fields:
            return {**fields, key: [0.0] * len(fields[key])}
    return None
