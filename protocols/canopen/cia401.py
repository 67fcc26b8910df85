"""CANopen's profile of input and output modules (CiA 401), as far as digital outputs need it."""

from enum import IntEnum
from typing import Final

OUTPUTS: Final = 8
"""Outputs in the one byte of 6200h:01 [1]."""
KEEP: Final = 0x00
"""6206h:01: when the master is lost, every output stays as it is (CiA 401, 7.2.6)."""


class Object(IntEnum):
    """Indices of the profile's objects."""

    WRITE_OUTPUT = 0x6200
    ERROR_MODE_OUTPUT = 0x6206
    ERROR_VALUE_OUTPUT = 0x6207


def pack_outputs(bits: int) -> bytes:
    """Return the default RPDO1: 6200h:01. Raises `ValueError` for more than eight outputs."""
    if not 0 <= bits < 1 << OUTPUTS:
        raise ValueError(f"outputs {bits:#x} are more than {OUTPUTS} bits")
    return bytes((bits,))
