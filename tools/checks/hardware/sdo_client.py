"""An SDO client that shows every abort code as it came (CiA 301, 7.2.4).

The daemon's drivers use canopen's client, which also knows names; this one is for looking at nodes
that nobody has described yet, and at how they refuse.
"""

import struct
from binascii import crc_hqx
from collections import deque
from typing import Final

from ....drivers.device import DeviceError
from ....drivers.fieldbus import Fieldbus
from ....protocols.canopen import can301
from ....protocols.canopen.can301 import Abort

REPLY_S: Final = 0.5
"""Time after which a request counts as unanswered [s]."""
_HEAD: Final = struct.Struct("<BHB")
_UPLOAD, _SEGMENT_UPLOAD, _ABORTED = 0x40, 0x60, 0x80
_BLOCK_REQUEST, _BLOCK_REPLY = 0xA0, 0xC0
_EXPEDITED, _SIZE, _TOGGLE, _LAST_SEGMENT = 0x02, 0x01, 0x10, 0x01
_BLOCK_SEGMENTS: Final = 100


class SdoAbortError(DeviceError):
    """The node gave a transfer up; `code` tells why (table 22)."""

    def __init__(self, where: str, code: int) -> None:
        super().__init__(f"{where}: aborted with {named(code)}")
        self.code = code


class SdoSilenceError(DeviceError):
    """The node did not answer."""


def named(code: int) -> str:
    """Return an abort code with its name."""
    name = Abort(code).name.lower().replace("_", " ") if code in list(Abort) else "unknown"
    return f"{code >> 16:04X} {code & 0xFFFF:04X}h ({name})"


class SdoClient:
    """Reads and writes the objects of one node; values are little-endian integers or bytes."""

    def __init__(self, fieldbus: Fieldbus, node: int, reply_s: float = REPLY_S) -> None:
        self.node = node
        self._bus, self._reply_s = fieldbus, reply_s
        self._replies: deque[bytes] = deque()
        self.last_abort: tuple[int, int, int] | None = None
        """Index, sub-index and code of the newest abort."""
        fieldbus.listen(can301.sdo_reply_id(node), lambda data, _stamp: self._replies.append(data))

    def read(self, index: int, subindex: int = 0) -> bytes:
        """Return an object's bytes. Raises `SdoAbortError`, `SdoSilenceError`."""
        where = self._where(index, subindex)
        reply = self._ask(_HEAD.pack(_UPLOAD, index, subindex), where)
        if reply[0] & _EXPEDITED:
            return reply[4 : 8 - (reply[0] >> 2 & 3) if reply[0] & _SIZE else 8]
        content, toggle = b"", 0
        while True:
            part = self._ask(bytes((_SEGMENT_UPLOAD | toggle,)), where)
            content += part[1 : 8 - (part[0] >> 1 & 7)]
            if part[0] & _LAST_SEGMENT:
                return content
            toggle ^= _TOGGLE

    def number(self, index: int, subindex: int = 0, *, signed: bool = False) -> int:
        """Return an integer object. Raises `SdoAbortError`, `SdoSilenceError`."""
        return int.from_bytes(self.read(index, subindex), "little", signed=signed)

    def write(self, index: int, subindex: int, data: bytes) -> None:
        """Write an object of at most 4 bytes. Raises `SdoAbortError`, `SdoSilenceError`."""
        head = _HEAD.pack(0x23 | (4 - len(data)) << 2, index, subindex)
        self._ask(head + data, self._where(index, subindex))

    def read_block(self, index: int, subindex: int = 0) -> bytes:
        """Return an object's bytes by block upload; raises as `read` does, and for a wrong CRC."""
        where = self._where(index, subindex)
        head = _HEAD.pack(_BLOCK_REQUEST | 0x04, index, subindex)
        start = self._ask(head + bytes((_BLOCK_SEGMENTS, 0)), where)
        if start[0] & 0xE0 != _BLOCK_REPLY:
            raise DeviceError(f"{where}: no block upload: answered {start.hex(' ')}")
        content, number = b"", 0
        part = self._ask(bytes((_BLOCK_REQUEST | 3,)), where)
        while True:
            number += 1
            if part[0] & 0x7F != number:
                raise DeviceError(f"{where}: segment {part[0] & 0x7F} of a block, not {number}")
            content += part[1:]
            last = bool(part[0] & 0x80)
            if last or number == _BLOCK_SEGMENTS:
                acknowledge = bytes((_BLOCK_REQUEST | 2, number, _BLOCK_SEGMENTS))
                part, number = self._ask(acknowledge, where), 0
                if last:
                    break
            else:
                part = self._next(where)
        content = content[: len(content) - (part[0] >> 2 & 7)]
        self._send(bytes((_BLOCK_REQUEST | 1,)))
        (crc,) = struct.unpack_from("<H", part, 1)
        if start[0] & 0x04 and crc != crc_hqx(content, 0):
            raise DeviceError(f"{where}: the block's CRC is wrong")
        return content

    def _where(self, index: int, subindex: int) -> str:
        return f"node {self.node}, {index:04X}h:{subindex}"

    def _ask(self, request: bytes, where: str) -> bytes:
        self._replies.clear()
        self._send(request)
        return self._next(where)

    def _send(self, request: bytes) -> None:
        can_id = can301.sdo_request_id(self.node)
        if not self._bus.send(can_id, request.ljust(8, b"\0")):
            raise DeviceError(f"{self._bus.name}: {self._bus.trouble}")

    def _next(self, where: str) -> bytes:
        bus = self._bus
        deadline = bus.clock() + self._reply_s
        while not self._replies and bus.clock() < deadline:
            bus.wait_until(lambda: bool(self._replies), deadline - bus.clock())
        if not self._replies:
            raise SdoSilenceError(f"{where}: no answer within {self._reply_s} s")
        reply = self._replies.popleft().ljust(8, b"\0")
        if reply[0] == _ABORTED:
            _, index, subindex, code = struct.unpack("<BHBI", reply)
            self.last_abort = index, subindex, code
            raise SdoAbortError(where, code)
        return reply
