"""Records a run as MCAP: raw frames, states, events, truth; JSON with a schema, for any viewer."""

import base64
import json
import tomllib
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any, Final

from mcap.writer import Writer

from ...config.bundle import to_text
from ...config.load import Cell
from ...protocols.messages.messages import Message
from ...server.recorder import ABOUT, CELL, MEMORY, TICK, KeptTick, pack
from ..operator.web.scene import scene_of
from .run_file import SCENE

CHUNK_BYTES = 128 * 1024  # small chunks: a crash loses no more than one

_SCHEMAS: Final[dict[str, dict[str, Any]]] = tomllib.loads(
    Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
)


class Recorder:
    """Writes one MCAP file."""

    def __init__(self, path: Path) -> None:
        """Open it. Raises `OSError`."""
        self.path = path
        self._file = path.open("wb")
        self._writer = Writer(self._file, chunk_size=CHUNK_BYTES)
        self._writer.start(profile="", library="telerobot")
        self._channels: dict[str, int] = {}
        self._sequence = 0

    def frame(self, time_s: float, can_id: int, data: bytes, sent: bool, bus: int = 0) -> None:
        row = {"id": can_id, "data": data, "sent": sent, "bus": bus}
        self._write("can", lambda: _SCHEMAS["can"], time_s, row)

    def scan(self, time_s: float, points_mm: bytes) -> None:
        """Write the points of a laser scan, as `ScanPoints` has them."""
        self._write("scan", lambda: _SCHEMAS["scan"], time_s, {"points_mm": points_mm})

    def message(self, topic: str, time_s: float, message: Message) -> None:
        """Write a message of the protocol."""
        self._write(topic, type(message).model_json_schema, time_s, message.__dict__)

    def tick(self, row: KeptTick) -> None:
        """Write what a tick looked at and decided, for `telerobot replay`."""
        memory = b"" if row.memory is None else pack(row.memory)
        self.ticks(row.stamp_ns, row.data, memory)

    def about(self, cell: Cell, **facts: str) -> None:
        """Write what is being run: the whole cell, and what a page draws of it."""
        self._writer.add_attachment(0, 0, CELL, "application/json", to_text(cell).encode())
        description, meshes = scene_of(cell)
        self._writer.add_attachment(
            0, 0, SCENE, "application/json", json.dumps(description).encode()
        )
        for address, mesh in meshes.items():
            self._writer.add_attachment(0, 0, address, "model/gltf-binary", mesh)
        version = metadata.version("telerobot")
        self._writer.add_metadata(
            ABOUT, {"cell": str(cell.path.resolve()), "version": version, **facts}
        )

    def proto(self, topic: str, stamp_ns: int, message: Any) -> None:
        """Write a message of protobuf, with its schema."""
        if topic not in self._channels:
            descriptor = message.DESCRIPTOR
            schema = self._writer.register_schema(
                descriptor.full_name, "protobuf", _files_of(descriptor.file)
            )
            self._channels[topic] = self._writer.register_channel(topic, "protobuf", schema)
        self._add(topic, stamp_ns, message.SerializeToString())

    def ticks(self, stamp_ns: int, data: bytes, memory: bytes) -> None:
        """Write a tick that is bytes already, and the memory that it began with, if any."""
        for topic, packed in ((MEMORY, memory), (TICK, data)):
            if packed and topic not in self._channels:
                channel = self._writer.register_channel(topic, "msgpack", 0, {"telerobot": "1"})
                self._channels[topic] = channel
            if packed:
                self._add(topic, stamp_ns, packed)

    @property
    def size(self) -> int:
        """Bytes in the file by now; what is not written yet is not among them."""
        return self._file.tell()

    def flush(self) -> None:
        """Hand what is written to the system: it survives this process. Raises `OSError`."""
        self._file.flush()

    def close(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def _add(self, topic: str, stamp_ns: int, data: bytes) -> None:
        self._sequence += 1
        self._writer.add_message(self._channels[topic], stamp_ns, data, stamp_ns, self._sequence)

    def _write(
        self, topic: str, schema: Callable[[], dict[str, Any]], time_s: float, row: Any
    ) -> None:
        if topic not in self._channels:
            schema_id = self._writer.register_schema(
                f"telerobot.{topic}", "jsonschema", json.dumps(schema()).encode()
            )
            self._channels[topic] = self._writer.register_channel(topic, "json", schema_id)
        self._add(topic, round(time_s * 1e9), json.dumps(row, default=_fields_of).encode())


def _fields_of(value: object) -> dict[str, Any] | str:
    """Return the fields of a message within a message; bytes as base64."""
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    if isinstance(value, Message):
        return value.__dict__
    raise TypeError(f"a {type(value).__name__} cannot be recorded")


def _files_of(file: Any) -> bytes:
    """Return a protobuf file and all that it imports, as a set of descriptors."""
    from google.protobuf.descriptor_pb2 import FileDescriptorSet

    found: dict[str, Any] = {}

    def add(each: Any) -> None:
        if each.name not in found:
            for dependency in each.dependencies:
                add(dependency)
            found[each.name] = each

    add(file)
    every = FileDescriptorSet()
    for each in found.values():
        each.CopyToProto(every.file.add())
    packed: bytes = every.SerializeToString()
    return packed
