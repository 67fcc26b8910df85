"""A simulated node's SDO server: canopen's, with block upload (CiA 301, 7.2.4)."""

import struct
from binascii import crc_hqx
from collections.abc import Callable
from typing import Final

from canopen.sdo.exceptions import SdoAbortedError
from canopen.sdo.server import SdoServer

from .....protocols.canopen.sdo import Abort
from .objects import ObjectStore

LONGEST_TRANSFER = 1024
"""No object of a node is longer; a download that goes on beyond is given up [byte]."""

_HEAD: Final = struct.Struct("<BHB")
_OF_AN_OBJECT: Final = (0x20, 0x40, 0xA0, 0xC0)
"""Requests that name an object: downloads and uploads, plain and in blocks."""
_BLOCK_REQUEST: Final = 0xA0
_BLOCK_REPLY: Final = 0xC0
_INITIATE, _END, _ACKNOWLEDGE, _START = range(4)
_CRC: Final = 0x04
_SIZE: Final = 0x02
_LAST: Final = 0x80
_SEGMENT: Final = 7
_MOST_SEGMENTS: Final = 127


class NodeSdoServer(SdoServer):
    """canopen's SDO server without a network: answers through `send`, in the caller's thread.

    Serves expedited, segmented and block uploads, expedited and segmented downloads. canopen aborts
    with the index of the transfer before; a refused request names its own here.
    """

    def __init__(self, node: int, store: ObjectStore, send: Callable[[int, bytes], None]) -> None:
        super().__init__(0x600 + node, 0x580 + node, store)  # type: ignore[no-untyped-call]  # its stubs
        self._store = store
        self._send = send
        self._index, self._subindex = 0, 0
        self._block: _BlockUpload | None = None

    def on_request(self, can_id: int, data: bytes, timestamp: float) -> None:
        """Answer one request; what is no SDO request of 8 bytes is ignored."""
        if len(data) != 8:
            return
        command = data[0] & 0xE0
        in_block = command == _BLOCK_REQUEST and data[0] & 0x03 != _INITIATE
        if command in _OF_AN_OBJECT and not in_block:
            self._index, self._subindex = struct.unpack_from("<HB", data, 1)
        if not in_block:
            self._block = None
        if command in (0x00, 0x60) and self._buffer is None:  # a segment of no transfer
            self.abort(Abort.INVALID_COMMAND)  # type: ignore[no-untyped-call]  # its stubs
            return
        super().on_request(can_id, bytearray(data), timestamp)  # type: ignore[no-untyped-call]  # its stubs
        if self._buffer is not None and len(self._buffer) > LONGEST_TRANSFER:
            self._buffer = None

    def block_upload(self, data: bytes) -> None:
        """Answer a request of a block upload. Raises `SdoAbortedError`."""
        step = data[0] & 0x03
        if step == _INITIATE:
            self._begin_block(data)
        elif self._block is None:
            raise SdoAbortedError(Abort.INVALID_COMMAND)
        elif step == _START:
            self._send_all(self._block.segments())
        elif step == _ACKNOWLEDGE:
            self._send_all(self._block.acknowledged(data[1], data[2]))
        else:
            self._block = None

    def _begin_block(self, data: bytes) -> None:
        most, threshold = data[4], data[5]
        if not 1 <= most <= _MOST_SEGMENTS:
            raise SdoAbortedError(Abort.BLOCK_SIZE)
        _, index, subindex = _HEAD.unpack_from(data)
        content = self._store.get_data(index, subindex, check_readable=True)
        if 0 < len(content) <= threshold:
            self.init_upload(data)  # type: ignore[no-untyped-call]  # its stubs
            return
        self._block = _BlockUpload(content, most)
        head = _HEAD.pack(_BLOCK_REPLY | _CRC | _SIZE, index, subindex)
        self.send_response(head + struct.pack("<I", len(content)))

    def _send_all(self, responses: list[bytes]) -> None:
        for response in responses:
            self.send_response(response)

    def send_response(self, response: bytes) -> None:
        """Send an answer."""
        self._send(self.tx_cobid, bytes(response))


class _BlockUpload:
    """Segments of one object, in blocks of `most`, until all are acknowledged."""

    def __init__(self, content: bytes, most: int) -> None:
        self._content, self._most = content, most
        self._first = 0
        """Byte that the present block begins with."""

    def segments(self) -> list[bytes]:
        """Return the present block."""
        found = []
        for number in range(1, self._most + 1):
            at = self._first + _SEGMENT * (number - 1)
            last = at + _SEGMENT >= len(self._content)
            part = self._content[at : at + _SEGMENT].ljust(_SEGMENT, b"\0")
            found.append(bytes((number | (_LAST if last else 0),)) + part)
            if last:
                break
        return found

    def acknowledged(self, number: int, most: int) -> list[bytes]:
        """Return the segments after those that came, or the end. Raises `SdoAbortedError`."""
        if number > len(self.segments()):
            raise SdoAbortedError(Abort.SEQUENCE_NUMBER)
        if not 1 <= most <= _MOST_SEGMENTS:
            raise SdoAbortedError(Abort.BLOCK_SIZE)
        self._first += _SEGMENT * number
        self._most = most
        if number and self._first >= len(self._content):
            unused = -len(self._content) % _SEGMENT
            crc = crc_hqx(self._content, 0)
            return [struct.pack("<BH5x", _BLOCK_REPLY | unused << 2 | _END, crc)]
        return self.segments()
