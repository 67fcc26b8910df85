"""A recorded run, read again: messages in the order of writing, the cell, and what was run.

A file that was cut off, by a kill or a full disk, is read up to there. Nothing that a file says of
itself is believed before it is bounded: lengths by what is left of the file, chunks by what they
unpack to, while they do.
"""

import atexit
import json
import shutil
import struct
import tempfile
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, Final, NamedTuple

import lz4.frame
import zstandard
from mcap.exceptions import EndOfFile, McapError, RecordLengthLimitExceeded
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk

from ...config.bundle import from_text
from ...config.load import Cell, ConfigError
from ...server.recorder import ABOUT, CELL
from ..operator.web.scene import PREFIX, Scene

SCENE: Final = "scene.json"
"""Name of the attachment that holds what a page draws of the cell; meshes are beside it."""

LARGEST_CHUNK: Final = 1 << 24
"""A chunk unpacks to at most so much, 16 of those that are written here [B]."""
LARGEST_RATIO: Final = 200
"""All chunks together unpack to at most so many times the file, and one chunk more [1]."""

_RECORD: Final = struct.Struct("<BQ")
_IN_CHUNKS: Final = frozenset({Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE})


class RecordError(ConfigError):
    """A file that is no recording, or lacks what is asked of it: says which, and what is wrong."""


class Recorded(NamedTuple):
    """One message of a recording."""

    topic: str
    stamp_ns: int
    data: bytes

    def json(self) -> dict[str, Any]:
        """Return the fields of a message that was written as JSON. Raises `RecordError`."""
        try:
            fields = json.loads(self.data)
        except (ValueError, RecursionError) as error:
            raise RecordError(f"a message of {self.topic} is no JSON: {error}") from None
        if not isinstance(fields, dict):
            raise RecordError(f"a message of {self.topic} holds no fields")
        return fields


def read_run(path: Path, topics: Collection[str] | None = None) -> Iterator[Recorded]:
    """Yield the messages of a recording, of some topics or all, in the order of writing.

    Raises `RecordError` for a file that is none, `OSError` for one that cannot be read.
    """
    channels: dict[int, str] = {}
    for record in _records(path):
        if isinstance(record, Channel):
            channels[record.id] = record.topic
        elif isinstance(record, Message):
            if record.channel_id not in channels:
                raise RecordError(f"{path}: damaged: a message of channel {record.channel_id}")
            topic = channels[record.channel_id]
            if topics is None or topic in topics:
                yield Recorded(topic, record.log_time, record.data)


def read_about(path: Path) -> dict[str, str]:
    """Return what was run, nothing where a recording does not say. Raises as `read_run`."""
    for record in _records(path):
        if isinstance(record, Metadata) and record.name == ABOUT:
            return dict(record.metadata)
    return {}


def read_cell(path: Path) -> Cell:
    """Return the cell that a recording holds. Raises as `read_run`, `ConfigError`."""
    for record in _records(path):
        if isinstance(record, Attachment) and record.name == CELL:
            # The URDF is read again while the cell is used.
            kept = Path(tempfile.mkdtemp(prefix="telerobot-run-"))
            atexit.register(shutil.rmtree, kept, ignore_errors=True)
            try:
                return from_text(record.data.decode(), kept)
            except (ConfigError, UnicodeDecodeError) as error:
                raise RecordError(f"{path}: {error}") from None
    raise RecordError(f"{path}: holds no cell")


def read_scene(path: Path) -> Scene | None:
    """Return what a page draws of the cell; None of a recording that does not hold it.

    Raises as `read_run`.
    """
    description: dict[str, Any] | None = None
    meshes: dict[str, bytes] = {}
    for record in _records(path):
        if not isinstance(record, Attachment):
            continue
        if record.name.startswith(PREFIX):
            meshes[record.name] = record.data
        elif record.name == SCENE:
            description = Recorded(SCENE, 0, record.data).json()
    return None if description is None else Scene(description, meshes)


def _records(path: Path) -> Iterator[McapRecord]:
    with path.open("rb") as file:
        count = 0
        size = path.stat().st_size
        left = LARGEST_RATIO * size + LARGEST_CHUNK
        reader = StreamReader(
            _Inside(file, size),  # type: ignore[arg-type]  # it only reads
            emit_chunks=True,
            validate_crcs=True,
            record_size_limit=size,
        )
        try:
            for record in reader.records:
                if isinstance(record, Chunk):
                    whole = _unpacked(record, min(left, LARGEST_CHUNK))
                    left -= len(whole.data)
                    for inner in breakup_chunk(whole, validate_crc=True):
                        count += 1
                        yield inner
                else:
                    count += 1
                    yield record
        except (EndOfFile, RecordLengthLimitExceeded):
            if count == 0:
                raise RecordError(f"{path}: not an MCAP recording: it ends at once") from None
        except RecordError as error:
            raise RecordError(f"{path}: damaged after {count} records: {error}") from None
        except (McapError, struct.error, ValueError, OverflowError, MemoryError) as error:
            words = str(error) or type(error).__name__
            if count == 0:
                raise RecordError(f"{path}: not an MCAP recording: {words}") from None
            raise RecordError(f"{path}: damaged after {count} records: {words}") from None


class _Inside:
    """A file of which nobody asks for more than it holds: memory is taken before it is read."""

    def __init__(self, file: IO[bytes], size: int) -> None:
        self._file, self._left = file, size

    def read(self, length: int) -> bytes:
        """Return so many bytes. Raises `EndOfFile` where there are fewer."""
        if length > self._left:
            raise EndOfFile
        self._left -= length
        return self._file.read(length)


def _unpacked(chunk: Chunk, most: int) -> Chunk:
    """Return a chunk with its records as they are. Raises `RecordError` for one of too many."""
    said = chunk.uncompressed_size
    if said > most:
        raise RecordError(f"a chunk of {said} bytes unpacked: at most {most}")
    try:
        if chunk.compression == "zstd":
            packed = zstandard.ZstdDecompressor(max_window_size=LARGEST_CHUNK)
            data = packed.stream_reader(chunk.data).read(said + 1)
        elif chunk.compression == "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=said + 1)
        else:
            data = chunk.data
    except (zstandard.ZstdError, RuntimeError) as error:
        raise RecordError(f"a chunk cannot be unpacked: {error}") from None
    if len(data) != said:
        more = "more" if len(data) > said else f"{len(data)}"
        raise RecordError(f"a chunk of {said} bytes unpacks to {more}")
    at = 0
    while at < said:
        opcode, length = _RECORD.unpack_from(data, at)
        if opcode not in _IN_CHUNKS:
            raise RecordError(f"a chunk holds a record of kind {opcode}")
        at += _RECORD.size + length
    return replace(chunk, compression="", data=data)
