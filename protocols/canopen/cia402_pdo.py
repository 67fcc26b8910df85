"""PDOs of a CiA 402 drive: mappings, and bytes to and from setpoints and feedback.

The cyclic PDOs of this system are

    RPDO1   6040h controlword u16, 607Ah target position i32         6 bytes   (CSP)
    RPDO1   6040h controlword u16, 60FFh target velocity i32         6 bytes   (CSV)
    RPDO1   6040h controlword u16, 6071h target torque i16           4 bytes   (CST)
    TPDO1   6041h statusword u16, 6064h position i32, 6077h torque i16   8 bytes

little-endian, at every SYNC.
"""

import struct
from typing import Final, NamedTuple

from .can301 import FrameError, mapping_entry
from .cia402 import Object, OperationMode

CSP_MAPPING: Final = (
    mapping_entry(Object.CONTROLWORD, 0, 16),
    mapping_entry(Object.TARGET_POSITION, 0, 32),
)
CSV_MAPPING: Final = (
    mapping_entry(Object.CONTROLWORD, 0, 16),
    mapping_entry(Object.TARGET_VELOCITY, 0, 32),
)
CST_MAPPING: Final = (
    mapping_entry(Object.CONTROLWORD, 0, 16),
    mapping_entry(Object.TARGET_TORQUE, 0, 16),
)
COMMAND_MAPPING: Final = {
    OperationMode.CSP: CSP_MAPPING,
    OperationMode.CSV: CSV_MAPPING,
    OperationMode.CST: CST_MAPPING,
}
"""Contents of RPDO1 in each operation mode."""
FEEDBACK_MAPPING: Final = (
    mapping_entry(Object.STATUSWORD, 0, 16),
    mapping_entry(Object.POSITION_ACTUAL, 0, 32),
    mapping_entry(Object.TORQUE_ACTUAL, 0, 16),
)

_CSP: Final = struct.Struct("<Hi")
_CST: Final = struct.Struct("<Hh")
_FEEDBACK: Final = struct.Struct("<Hih")


class CspCommand(NamedTuple):
    """RPDO1 in CSP: controlword, target position [counts]."""

    controlword: int
    target_position: int


class CsvCommand(NamedTuple):
    """RPDO1 in CSV: controlword, target velocity [counts/s]."""

    controlword: int
    target_velocity: int


class CstCommand(NamedTuple):
    """RPDO1 in CST: controlword, target torque [1/1000 of the rated torque]."""

    controlword: int
    target_torque: int


class Feedback(NamedTuple):
    """TPDO1: statusword, position [counts], torque [1/1000 of the rated torque]."""

    statusword: int
    position: int
    torque: int


def pack_csp(controlword: int, target_position: int) -> bytes:
    """Return the 6 bytes of RPDO1 in CSP. Raises `struct.error` outside 32 bits."""
    return _CSP.pack(controlword, target_position)


def unpack_csp(data: bytes) -> CspCommand:
    """Return what RPDO1 in CSP says. Raises `FrameError` unless it is 6 bytes."""
    return CspCommand(*_unpack(_CSP, data, "RPDO1 (CSP)"))


def pack_csv(controlword: int, target_velocity: int) -> bytes:
    """Return the 6 bytes of RPDO1 in CSV. Raises `struct.error` outside 32 bits."""
    return _CSP.pack(controlword, target_velocity)


def unpack_csv(data: bytes) -> CsvCommand:
    """Return what RPDO1 in CSV says. Raises `FrameError` unless it is 6 bytes."""
    return CsvCommand(*_unpack(_CSP, data, "RPDO1 (CSV)"))


def pack_cst(controlword: int, target_torque: int) -> bytes:
    """Return the 4 bytes of RPDO1 in CST. Raises `struct.error` outside 16 bits."""
    return _CST.pack(controlword, target_torque)


def unpack_cst(data: bytes) -> CstCommand:
    """Return what RPDO1 in CST says. Raises `FrameError` unless it is 4 bytes."""
    return CstCommand(*_unpack(_CST, data, "RPDO1 (CST)"))


def pack_feedback(statusword: int, position: int, torque: int) -> bytes:
    """Return the 8 bytes of TPDO1. Raises `struct.error` outside the fields' widths."""
    return _FEEDBACK.pack(statusword, position, torque)


def unpack_feedback(data: bytes) -> Feedback:
    """Return what TPDO1 says. Raises `FrameError` unless it is 8 bytes."""
    return Feedback(*_unpack(_FEEDBACK, data, "TPDO1"))


def _unpack(layout: struct.Struct, data: bytes, frame: str) -> tuple[int, ...]:
    if len(data) != layout.size:
        raise FrameError(f"{frame}: {len(data)} bytes instead of {layout.size}")
    return layout.unpack(data)
