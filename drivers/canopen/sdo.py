"""SDO to nodes that nobody has described yet: canopen's client, and every abort as it came.

Drivers ask nodes that are known; this is for looking at others, and at how they refuse.
"""

import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final

from canopen import ObjectDictionary
from canopen.sdo import client
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from ...protocols.canopen import can301
from ...protocols.canopen.can301 import Abort
from ..device import DeviceError
from ..fieldbus import Fieldbus

REPLY_S: Final = 0.5  # time after which a request counts as unanswered [s]


class SdoAbortError(DeviceError):
    """The node gave a transfer up; `code` tells why (table 22)."""

    def __init__(self, where: str, code: int) -> None:
        super().__init__(f"{where}: aborted with {named(code)}")
        self.code = code


class SdoSilenceError(DeviceError):
    """The node did not answer, or nothing that belongs to the transfer."""


def named(code: int) -> str:
    name = Abort(code).name.lower().replace("_", " ") if code in list(Abort) else "unknown"
    return f"{code >> 16:04X} {code & 0xFFFF:04X}h ({name})"


def wait_for(fieldbus: Fieldbus, condition: Callable[[], bool], seconds: float) -> bool:
    """Dispatch frames until something holds; return False if it does not in time [s].

    Goes on where a bus looks up early, as one in virtual time does.
    """
    deadline = fieldbus.clock() + seconds
    while not condition() and fieldbus.clock() < deadline:
        fieldbus.wait_until(condition, deadline - fieldbus.clock())
    return condition()


class _Transfers(client.SdoClient):
    """canopen's client of a node on a bus that is read while it waits."""

    def __init__(self, fieldbus: Fieldbus, node: int, reply_s: float) -> None:
        reply_id = can301.sdo_reply_id(node)
        known = ObjectDictionary()  # type: ignore[no-untyped-call]
        super().__init__(can301.sdo_request_id(node), reply_id, known)  # type: ignore[no-untyped-call]
        self.RESPONSE_TIMEOUT = 0.0  # a reply is there before canopen looks for it
        self._bus, self._reply_s = fieldbus, reply_s
        self.newest = bytes(8)
        fieldbus.listen(reply_id, lambda data, _stamp: self.responses.put(data.ljust(8, b"\0")))

    def send_request(self, request: bytes) -> None:
        if not self._bus.send(self.rx_cobid, bytes(request)):
            raise DeviceError(f"{self._bus.name}: {self._bus.trouble}")

    def read_response(self) -> bytes:
        if not wait_for(self._bus, lambda: not self.responses.empty(), self._reply_s):
            raise SdoCommunicationError(f"no answer within {self._reply_s} s")
        self.newest = self.responses.queue[0]
        reply: bytes = super().read_response()  # type: ignore[no-untyped-call]
        return reply


class SdoClient:
    """Reads and writes the objects of one node; values are little-endian integers or bytes."""

    def __init__(self, fieldbus: Fieldbus, node: int, reply_s: float = REPLY_S) -> None:
        self.node = node
        self._client = _Transfers(fieldbus, node, reply_s)

    @property
    def newest(self) -> tuple[int, int]:
        """Index and sub-index in the newest reply, where it begins or aborts a transfer."""
        index, subindex = struct.unpack_from("<HB", self._client.newest, 1)
        return index, subindex

    def read(self, index: int, subindex: int = 0) -> bytes:
        """Return an object's bytes. Raises `SdoAbortError`, `SdoSilenceError`."""
        with self._told(index, subindex):
            data: bytes = self._client.upload(index, subindex)
        return data

    def number(self, index: int, subindex: int = 0, *, signed: bool = False) -> int:
        """Return an integer object. Raises `SdoAbortError`, `SdoSilenceError`."""
        return int.from_bytes(self.read(index, subindex), "little", signed=signed)

    def write(self, index: int, subindex: int, data: bytes) -> None:
        """Write an object. Raises `SdoAbortError`, `SdoSilenceError`."""
        with self._told(index, subindex):
            self._client.download(index, subindex, data)

    def read_block(self, index: int, subindex: int = 0) -> bytes:
        """Return an object's bytes by block upload; raises as `read` does, and for a wrong CRC."""
        client: Any = self._client
        with (
            self._told(index, subindex),
            client.open(index, subindex, block_transfer=True) as stream,
        ):
            data: bytes = stream.read()
        return data

    @contextmanager
    def _told(self, index: int, subindex: int) -> Iterator[None]:
        where = f"node {self.node}, {index:04X}h:{subindex}"
        try:
            yield
        except SdoAbortedError as error:
            raise SdoAbortError(where, error.code) from None
        except SdoCommunicationError as error:
            raise SdoSilenceError(f"{where}: {error}") from None
