"""Recordings that somebody made to hurt: each is refused in one line, in little memory."""

import json
import resource
import struct

import lz4.frame
import pytest
import zstandard
from telerobot.tools.cli import main
from telerobot.tools.recording.run_file import LARGEST_CHUNK, read_run

MAGIC = b"\x89MCAP0\r\n"
MOST_MB = 300
"""Memory that a file may take to be refused [MB]."""


def record(opcode, content, length=None):
    return struct.pack("<BQ", opcode, len(content) if length is None else length) + content


def text(value):
    return struct.pack("<I", len(value)) + value.encode()


HEADER = record(0x01, text("") + text(""))
CHANNEL = record(0x04, struct.pack("<HH", 1, 0) + text("can") + text("json") + text(""))


def chunk(data, said, compression="zstd", length=None):
    head = struct.pack("<QQQI", 0, 0, said, 0) + text(compression)
    return record(0x06, head + struct.pack("<Q", len(data) if length is None else length) + data)


def message(data):
    return record(0x05, struct.pack("<HIQQ", 1, 0, 0, 0) + data)


def attachment(name, data):
    content = struct.pack("<QQ", 0, 0) + text(name) + text("application/json")
    return record(0x09, content + struct.pack("<Q", len(data)) + data + bytes(4))


def zeros(size):
    """Return so many zeros, packed without their being there."""
    packer = zstandard.ZstdCompressor(level=3).compressobj(size=size)
    parts = [packer.compress(bytes(1 << 20)) for _ in range(size >> 20)]
    return b"".join((*parts, packer.flush()))


HOSTILE = {
    "a chunk says that it is huge": lambda: chunk(b"x" * 100, 2**40),
    "a chunk of 2^63": lambda: chunk(b"x" * 100, 2**63),
    "data of 2^63 in a chunk": lambda: chunk(b"x" * 100, 100, length=2**63),
    "a record of 2^63": lambda: record(0x06, b"", length=2**63),
    "zstd that unpacks to more than it says": lambda: chunk(zeros(1 << 31), 1000),
    "zstd that says the truth": lambda: chunk(zeros(1 << 31), 1 << 31),
    "lz4 that unpacks to more than it says": lambda: chunk(
        lz4.frame.compress(bytes(1 << 28)), 1000, "lz4"
    ),
    "many chunks of the largest kind": lambda: chunk(zeros(LARGEST_CHUNK), LARGEST_CHUNK) * 100,
    "a compression that nobody knows": lambda: chunk(b"x", 1, "xyz"),
    "an attachment of brackets": lambda: attachment("cell.json", b"[" * 200_000),
    "a cell of brackets": lambda: attachment("cell.json", b'{"format":' + b"[" * 200_000),
}


@pytest.fixture
def made(tmp_path):
    def write(content):
        path = tmp_path / "hostile.mcap"
        path.write_bytes(MAGIC + HEADER + content + MAGIC)
        return path

    return write


@pytest.mark.parametrize("name", HOSTILE)
@pytest.mark.parametrize("command", [["replay"], ["export", "--to=numpy"]])
def test_a_hostile_recording_is_refused_in_one_line_and_little_memory(name, command, made, capsys):
    path = made(HOSTILE[name]())
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert main([*command, str(path)]) == 2
    told = capsys.readouterr().err
    assert told.startswith(f"telerobot: {path}: ")
    assert told.count("\n") == 1
    grown_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
    assert grown_kb < MOST_MB * 1e3


def test_a_chunk_is_read_however_it_was_packed(made):
    inner = message(json.dumps({"data": "", "id": 1, "sent": True}).encode()) * 50
    packed = {"zstd": zstandard.compress(inner), "lz4": lz4.frame.compress(inner), "": inner}
    for compression, data in packed.items():
        path = made(CHANNEL + chunk(data, len(inner), compression))
        assert len(list(read_run(path))) == 50
