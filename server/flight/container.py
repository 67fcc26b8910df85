"""MCAP around rows that are bytes already: a file is joined, not encoded row by row."""

import io
import struct
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from mcap.writer import Writer

TICK: Final = "tick"
"""Channel of the ticks' inputs and outputs; MessagePack, see `log.TickRecord`."""
MEMORY: Final = "memory"
"""Channel of memories that a tick began with; MessagePack, see `values`."""
CELL: Final = "cell.json"
"""Name of the attachment that holds the cell (`config.bundle`)."""
ABOUT: Final = "run"
"""Name of the metadata that says what was run."""

_MESSAGE: Final = struct.Struct("<BQHIQQ")
_MESSAGE_OPCODE: Final = 0x05
# The data section ends without a checksum, and there is no summary.
_END: Final = struct.pack("<BQI", 0x0F, 4, 0) + struct.pack("<BQQQI", 0x02, 20, 0, 0, 0)
_MAGIC: Final = b"\x89MCAP0\r\n"


class Stamped(NamedTuple):
    """A message of a channel."""

    channel: str
    stamp_ns: int
    data: bytes


def joined(cell: str, about: Mapping[str, str], messages: Iterable[Stamped]) -> bytes:
    """Return an MCAP file: a cell as text, facts about the run, and messages of ticks."""
    head = io.BytesIO()
    writer = Writer(head, use_chunking=False)
    writer.start(profile="", library="telerobot")
    channels = {
        name: writer.register_channel(name, "msgpack", 0, {"telerobot": "1"})
        for name in (TICK, MEMORY)
    }
    writer.add_attachment(0, 0, CELL, "application/json", cell.encode())
    writer.add_metadata(ABOUT, dict(about))
    parts = [head.getvalue()]
    for sequence, (name, stamp, data) in enumerate(messages):
        head_of = _MESSAGE.pack(
            _MESSAGE_OPCODE, 22 + len(data), channels[name], sequence, stamp, stamp
        )
        parts += (head_of, data)
    return b"".join((*parts, _END, _MAGIC))
