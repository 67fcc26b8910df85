"""A simulated node's object dictionary: the EDS, the values, and the SDO server on them."""

import logging
import struct
from collections.abc import Callable
from functools import cache
from pathlib import Path

import canopen
from canopen.objectdictionary import ODVariable
from canopen.sdo.exceptions import SdoAbortedError
from canopen.sdo.server import SdoServer

EDS = Path(__file__).resolve().parents[3] / "config" / "devices" / "simulated_drive.eds"

LONGEST_TRANSFER = 1024
"""No object of a node is longer; a download that goes on beyond is given up [byte]."""
logging.getLogger("canopen").addHandler(logging.NullHandler())  # its errors are answered, too

_NO_OBJECT = 0x06020000
_NO_SUBINDEX = 0x06090011
_WRITE_ONLY = 0x06010001
_READ_ONLY = 0x06010002
_WRONG_LENGTH = 0x06070010
_NOT_NOW = 0x08000022


class WrongStateError(Exception):
    """Raised by a write's handler: the object cannot be written in the node's present state."""


@cache
def _dictionary(eds: Path, node: int) -> canopen.ObjectDictionary:
    return canopen.import_od(str(eds), node)


class ObjectStore:
    """Values by index and sub-index; integers are kept as integers.

    `on_write(index, subindex, value)` is called before a value that came over the bus is stored,
    and may refuse it with `WrongStateError`.
    """

    def __init__(
        self, node: int, on_write: Callable[[int, int, int], None], eds: Path = EDS
    ) -> None:
        self.object_dictionary = _dictionary(eds, node)
        self._on_write = on_write
        self._values: dict[tuple[int, int], int] = {}
        self.live: dict[tuple[int, int], Callable[[], int]] = {}
        """Objects that are measured when they are read."""

    def reset(self, *, communication_only: bool = False) -> None:
        """Go back to the defaults of the EDS, everywhere or in 1000h to 1FFFh only."""
        for key in list(self._values):
            if not communication_only or key[0] < 0x2000:
                del self._values[key]

    def __getitem__(self, key: tuple[int, int]) -> int:
        """Return an integer object's value. Raises `KeyError` for an object that is none."""
        measure = self.live.get(key)
        if measure is not None:
            return measure()
        value = self._values.get(key)
        if value is None:
            value = self._values[key] = int(self.variable(*key).default or 0)
        return value

    def __setitem__(self, key: tuple[int, int], value: int) -> None:
        self._values[key] = value

    def variable(self, index: int, subindex: int) -> ODVariable:
        """Return an object's entry in the EDS. Raises `KeyError`."""
        entry = self.object_dictionary[index]
        if isinstance(entry, ODVariable):
            if subindex:
                raise KeyError(subindex)
            return entry
        found: ODVariable = entry.subindices[subindex]
        return found

    # --- what the SDO server calls --------------------------------------------------------------

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        """Return an object's bytes. Raises `SdoAbortedError`."""
        variable = self._find(index, subindex)
        if check_readable and not variable.readable:
            raise SdoAbortedError(_WRITE_ONLY)
        if variable.data_type in canopen.objectdictionary.INTEGER_TYPES:
            return bytes(variable.encode_raw(self[index, subindex]))
        return bytes(variable.encode_raw(variable.default or ""))

    def set_data(
        self, index: int, subindex: int, data: bytes, check_writable: bool = False
    ) -> None:
        """Write an object's bytes. Raises `SdoAbortedError`."""
        variable = self._find(index, subindex)
        if check_writable and not variable.writable:
            raise SdoAbortedError(_READ_ONLY)
        if 8 * len(data) != len(variable):
            raise SdoAbortedError(_WRONG_LENGTH)
        value = int(variable.decode_raw(bytes(data)))
        try:
            self._on_write(index, subindex, value)
        except WrongStateError:
            raise SdoAbortedError(_NOT_NOW) from None
        self[index, subindex] = value

    def _find(self, index: int, subindex: int) -> ODVariable:
        if index not in self.object_dictionary:
            raise SdoAbortedError(_NO_OBJECT)
        try:
            return self.variable(index, subindex)
        except KeyError:
            raise SdoAbortedError(_NO_SUBINDEX) from None


class NodeSdoServer(SdoServer):
    """canopen's SDO server without a network: answers through `send`, in the caller's thread.

    Serves expedited and segmented transfers. canopen aborts with the index of the transfer
    before; a refused request names its own here.
    """

    def __init__(self, node: int, store: ObjectStore, send: Callable[[int, bytes], None]) -> None:
        super().__init__(0x600 + node, 0x580 + node, store)  # type: ignore[no-untyped-call]  # its stubs
        self._send = send
        self._index, self._subindex = 0, 0

    def on_request(self, can_id: int, data: bytes, timestamp: float) -> None:
        """Answer one request; what is no SDO request of 8 bytes is ignored."""
        if len(data) != 8:
            return
        if data[0] & 0xE0 in (0x20, 0x40, 0xA0, 0xC0):
            self._index, self._subindex = struct.unpack_from("<HB", data, 1)
        super().on_request(can_id, bytearray(data), timestamp)  # type: ignore[no-untyped-call]  # its stubs
        if self._buffer is not None and len(self._buffer) > LONGEST_TRANSFER:
            self._buffer = None

    def send_response(self, response: bytes) -> None:
        """Send an answer."""
        self._send(self.tx_cobid, bytes(response))
