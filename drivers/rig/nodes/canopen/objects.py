"""A simulated node's object dictionary: the EDS, and the values."""

import logging
from collections.abc import Callable
from functools import cache
from pathlib import Path

import canopen
from canopen.objectdictionary import ODVariable
from canopen.sdo.exceptions import SdoAbortedError

from .....protocols.canopen.sdo import Abort

EDS = Path(__file__).resolve().parents[4] / "config" / "devices" / "simulated_drive.eds"

logging.getLogger("canopen").addHandler(logging.NullHandler())  # its errors are answered, too


class RefusedError(Exception):
    """Raised by a write's handler: the value is not taken over, for the reason given."""

    def __init__(self, reason: Abort) -> None:
        super().__init__(f"refused: {reason:#010x}")
        self.reason = reason


@cache
def _dictionary(eds: Path, node: int) -> canopen.ObjectDictionary:
    return canopen.import_od(str(eds), node)


class ObjectStore:
    """Values by index and sub-index; integers are kept as integers.

    `on_write(index, subindex, value)` is called before a value that came over the bus is stored,
    and may refuse it with `RefusedError`.
    """

    def __init__(
        self, node: int, on_write: Callable[[int, int, int], None], eds: Path = EDS
    ) -> None:
        self.object_dictionary = _dictionary(eds, node)
        self._on_write = on_write
        self._values: dict[tuple[int, int], int] = {}
        self.live: dict[tuple[int, int], Callable[[], int]] = {}
        """Objects that are measured when they are read."""
        self.choices: dict[tuple[int, int], frozenset[int]] = {}
        """The only values of an object, where it is no range (LowLimit, HighLimit of the EDS)."""

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

    def write(self, index: int, subindex: int, value: int) -> None:
        """Take over a value that came over the bus. Raises `RefusedError` for one out of range."""
        variable = self.variable(index, subindex)
        low, high = variable.min, variable.max
        out = (low is not None and value < low) or (high is not None and value > high)
        if out or value not in self.choices.get((index, subindex), (value,)):
            raise RefusedError(Abort.INVALID_VALUE)
        self._on_write(index, subindex, value)
        self[index, subindex] = value

    # --- what the SDO server calls --------------------------------------------------------------

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        """Return an object's bytes. Raises `SdoAbortedError`."""
        variable = self._find(index, subindex)
        if check_readable and not variable.readable:
            raise SdoAbortedError(Abort.WRITE_ONLY)
        if variable.data_type in canopen.objectdictionary.INTEGER_TYPES:
            return bytes(variable.encode_raw(self[index, subindex]))
        return bytes(variable.encode_raw(variable.default or ""))

    def set_data(
        self, index: int, subindex: int, data: bytes, check_writable: bool = False
    ) -> None:
        """Write an object's bytes. Raises `SdoAbortedError`."""
        variable = self._find(index, subindex)
        if check_writable and not variable.writable:
            raise SdoAbortedError(Abort.READ_ONLY)
        if 8 * len(data) != len(variable):
            raise SdoAbortedError(Abort.WRONG_LENGTH)
        try:
            self.write(index, subindex, int(variable.decode_raw(bytes(data))))
        except RefusedError as refused:
            raise SdoAbortedError(refused.reason) from None

    def _find(self, index: int, subindex: int) -> ODVariable:
        if index not in self.object_dictionary:
            raise SdoAbortedError(Abort.NO_OBJECT)
        try:
            return self.variable(index, subindex)
        except KeyError:
            raise SdoAbortedError(Abort.NO_SUBINDEX) from None
