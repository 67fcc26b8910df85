"""CANopen's profile of input and output modules (CiA 401): eight digital inputs and outputs."""

from enum import IntEnum
from typing import Final

from .can301 import FrameError

OUTPUTS: Final = 8
"""Outputs in the one byte of 6200h:01 [1]."""
KEEP: Final = 0x00
"""6206h:01: when the master is lost, every output stays as it is (CiA 401, 7.2.6)."""


class IoObject(IntEnum):
    """Indices of the profile's objects."""

    READ_INPUT = 0x6000
    WRITE_OUTPUT = 0x6200
    ERROR_MODE_OUTPUT = 0x6206
    ERROR_VALUE_OUTPUT = 0x6207


def pack_outputs(bits: int) -> bytes:
    """Return the default RPDO1: 6200h:01. Raises `ValueError` for more than eight outputs."""
    if not 0 <= bits < 1 << OUTPUTS:
        raise ValueError(f"outputs {bits:#x} are more than {OUTPUTS} bits")
    return bytes((bits,))


def unpack_inputs(data: bytes) -> int:
    """Return the inputs of the default TPDO1: 6000h:01. Raises `FrameError`."""
    if len(data) != 1:
        raise FrameError(f"inputs: {len(data)} bytes instead of 1")
    return data[0]
