"""Records a run as MCAP: raw frames, states, events, truth; JSON with a schema, for any viewer."""

import base64
import json
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.writer import Writer

from ...protocols.messages.messages import Message

CHUNK_BYTES = 128 * 1024
"""Small chunks: a crash loses no more than one."""

_FRAME_SCHEMA = {
    "type": "object",
    "properties": {
        "id": {"type": "integer"},
        "data": {"type": "string", "contentEncoding": "base64"},
        "sent": {"type": "boolean", "description": "sent by the daemon"},
        "bus": {"type": "integer", "description": "index of the bus in the cell"},
    },
}


ABOUT = "run"
"""The record that says what was run."""


class RecordError(Exception):
    """A file that is no recording: says which, and what is wrong with it."""


class Frame(NamedTuple):
    """One CAN frame of a recording."""

    time_s: float
    can_id: int
    data: bytes
    sent: bool
    bus: int


class Recorder:
    """Writes one MCAP file; a context manager."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb")
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES)
        self._writer.start(profile="", library="telerobot")
        self._channels: dict[str, int] = {}
        self._sequence = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def frame(self, time_s: float, can_id: int, data: bytes, sent: bool, bus: int = 0) -> None:
        """Write a CAN frame."""
        row = {"id": can_id, "data": base64.b64encode(data).decode(), "sent": sent, "bus": bus}
        self._write("can", _FRAME_SCHEMA, time_s, row)

    def message(self, topic: str, time_s: float, message: Message) -> None:
        """Write a message of the protocol."""
        self._write(topic, type(message).model_json_schema(), time_s, message.__dict__)

    def about(self, **facts: str) -> None:
        """Write what is being run."""
        self._writer.add_metadata(ABOUT, facts)

    def close(self) -> None:
        """Finish the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def _write(self, topic: str, schema: dict[str, Any], time_s: float, row: Any) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            schema_id = self._writer.register_schema(
                f"telerobot.{topic}", "jsonschema", json.dumps(schema).encode()
            )
            channel = self._writer.register_channel(topic, "json", schema_id)
            self._channels[topic] = channel
        self._sequence += 1
        stamp = round(time_s * 1e9)
        data = json.dumps(row, default=_fields_of).encode()
        self._writer.add_message(channel, stamp, data, stamp, self._sequence)


def _fields_of(value: object) -> dict[str, Any]:
    """Return the fields of a message within a message."""
    if isinstance(value, Message):
        return value.__dict__
    raise TypeError(f"a {type(value).__name__} cannot be recorded")


def read_frames(path: Path) -> Iterator[Frame]:
    """Yield the CAN frames of a recording, in the order of writing."""
    with path.open("rb") as file:
        rows = list(make_reader(file).iter_messages(topics=["can"]))
    rows.sort(key=lambda row: row[2].sequence)
    for _, _, message in rows:
        row = json.loads(message.data)
        data, bus = base64.b64decode(row["data"]), row.get("bus", 0)
        yield Frame(message.log_time / 1e9, row["id"], data, row["sent"], bus)


def read_messages(path: Path, topics: Sequence[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield topic and row of the messages of a recording, in the order of writing.

    Raises `RecordError` for a file that is none, `OSError` for one that cannot be read.
    """
    with path.open("rb") as file:
        try:
            rows = list(make_reader(file).iter_messages(topics=list(topics)))
        except (McapError, struct.error) as error:
            raise RecordError(f"{path}: not an MCAP recording: {error}") from None
    rows.sort(key=lambda row: row[2].sequence)
    for _, channel, message in rows:
        yield channel.topic, json.loads(message.data)


def read_about(path: Path) -> dict[str, str]:
    """Return what was run, nothing where a recording does not say. Raises as `read_messages`."""
    with path.open("rb") as file:
        try:
            found = [m.metadata for m in make_reader(file).iter_metadata() if m.name == ABOUT]
        except (McapError, struct.error) as error:
            raise RecordError(f"{path}: not an MCAP recording: {error}") from None
    return dict(found[0]) if found else {}
