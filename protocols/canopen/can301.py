"""CANopen's communication profile (CiA 301): identifiers, states, emergencies, aborts."""

import struct
from enum import IntEnum
from typing import Final, NamedTuple

# --- CANopen's communication profile (CiA 301): identifiers, network management, emergencies ------
#
# Pure tables and encodings; the drive profile on top of it is `cia402.py`.

NMT_ID: Final = 0x000
SYNC_ID: Final = 0x080
MASTER_NODE: Final = 127
"""The node id that the control server's own heartbeat carries."""

PDO_INVALID: Final = 1 << 31
"""Bit 31 of a PDO's COB-ID: the PDO does not exist (CiA 301, 7.5.2.35)."""
DEFAULT_PDOS: Final = 4
"""Number of PDOs per direction that the pre-defined connection set gives a node."""
EVERY_SYNC: Final = 1
"""Transmission type: sampled, or applied, at every SYNC."""
AT_ONCE: Final = 255
"""Transmission type: applied when it comes, by no SYNC."""
EMCY_MANUFACTURER_BYTES: Final = 5
"""Length of the manufacturer's part of an emergency message [byte]."""

_EMCY: Final = struct.Struct("<HB5s")


class FrameError(ValueError):
    """Bytes that are not what their identifier says: names the frame and what was wrong."""


class CommunicationObject(IntEnum):
    """Indices of the communication profile's objects (CiA 301, 7.5.2)."""

    DEVICE_TYPE = 0x1000
    ERROR_REGISTER = 0x1001
    SYNC_COB_ID = 0x1005
    COMMUNICATION_CYCLE = 0x1006
    EMCY_COB_ID = 0x1014
    CONSUMER_HEARTBEAT = 0x1016
    PRODUCER_HEARTBEAT = 0x1017
    IDENTITY = 0x1018
    RPDO_COMMUNICATION = 0x1400
    RPDO_MAPPING = 0x1600
    TPDO_COMMUNICATION = 0x1800
    TPDO_MAPPING = 0x1A00


class NmtCommand(IntEnum):
    """Commands of the network master, first byte of frame 0 (CiA 301, 7.3.2)."""

    START = 1
    STOP = 2
    PRE_OPERATIONAL = 128
    RESET_NODE = 129
    RESET_COMMUNICATION = 130


class NmtState(IntEnum):
    """A node's state as its heartbeat tells it."""

    BOOT_UP = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


class EmcyCode(IntEnum):
    """Emergency error codes in use (CiA 301, table 26; CiA 402-2 for 8611h)."""

    NO_ERROR = 0x0000
    OVERCURRENT = 0x2310
    OVERTEMPERATURE = 0x4310
    HEARTBEAT = 0x8130
    FOLLOWING_ERROR = 0x8611
    SYNC = 0x8700
    SETPOINT_TIMEOUT = 0xFF01
    """Manufacturer's: cyclic setpoints stopped arriving."""


_EMCY_CLASSES: Final = (
    (0x0000, 0xFF00, "no error"),
    (0x1000, 0xFF00, "generic error"),
    (0x2000, 0xF000, "current"),
    (0x3000, 0xF000, "voltage"),
    (0x4000, 0xF000, "temperature"),
    (0x5000, 0xF000, "device hardware"),
    (0x6000, 0xF000, "device software"),
    (0x7000, 0xF000, "additional modules"),
    (0x8000, 0xF000, "monitoring"),
    (0x9000, 0xF000, "external error"),
    (0xFF00, 0xFF00, "device specific"),
    (0xF000, 0xF000, "additional functions"),
)


class Emcy(NamedTuple):
    """An emergency message: error code, error register (1001h), five manufacturer's bytes."""

    code: int
    register: int
    manufacturer: bytes


def tpdo1_id(node: int) -> int:
    """Return the identifier of a node's first transmit PDO."""
    return 0x180 + node


def rpdo1_id(node: int) -> int:
    """Return the identifier of a node's first receive PDO."""
    return 0x200 + node


def sdo_request_id(node: int) -> int:
    """Return the identifier of SDO requests to a node."""
    return 0x600 + node


def sdo_reply_id(node: int) -> int:
    """Return the identifier of SDO replies from a node."""
    return 0x580 + node


def emcy_id(node: int) -> int:
    """Return the identifier of a node's emergency messages."""
    return 0x080 + node


def heartbeat_id(node: int) -> int:
    """Return the identifier of a node's heartbeat and boot-up message."""
    return 0x700 + node


def mapping_entry(index: int, subindex: int, bits: int) -> int:
    """Return one entry of a PDO mapping: `index << 16 | subindex << 8 | bits`."""
    if not (0 <= index <= 0xFFFF and 0 <= subindex <= 0xFF and 0 < bits <= 64):
        raise ValueError(f"no such mapping entry: {index:#x}:{subindex:#x}, {bits} bits")
    return index << 16 | subindex << 8 | bits


def consumer_heartbeat(node: int, timeout_ms: int) -> int:
    """Return a value of 1016h: expect `node`'s heartbeat at least every `timeout_ms`."""
    if not (1 <= node <= 127 and 0 <= timeout_ms <= 0xFFFF):
        raise ValueError(f"no such heartbeat watch: node {node}, {timeout_ms} ms")
    return node << 16 | timeout_ms


def encode_emcy(code: int, register: int, manufacturer: bytes = b"") -> bytes:
    """Return the 8 bytes of an emergency message; `manufacturer` is filled up with zeros."""
    if len(manufacturer) > EMCY_MANUFACTURER_BYTES:
        raise FrameError(f"EMCY: {len(manufacturer)} manufacturer's bytes, at most 5 fit")
    return _EMCY.pack(code, register, manufacturer)


def decode_emcy(data: bytes) -> Emcy:
    """Return what 8 bytes of an emergency message say. Raises `FrameError` on another length."""
    if len(data) != _EMCY.size:
        raise FrameError(f"EMCY: {len(data)} bytes instead of {_EMCY.size}")
    return Emcy(*_EMCY.unpack(data))


def emcy_name(code: int) -> str:
    """Return a code's name in words, or that of its class, for instance `following error`."""
    try:
        return EmcyCode(code).name.lower().replace("_", " ")
    except ValueError:
        for value, mask, name in _EMCY_CLASSES:
            if code & mask == value:
                return name
    return "unknown error"


def decode_heartbeat(data: bytes) -> int:
    """Return the NMT state in a heartbeat, without its toggle bit. Raises `FrameError`."""
    if len(data) != 1:
        raise FrameError(f"heartbeat: {len(data)} bytes instead of 1")
    return data[0] & 0x7F


# --- Abort codes of an SDO transfer (CiA 301, 7.2.4.3.17, table 22) -------------------------------


class Abort(IntEnum):
    """Reason for which a transfer was given up."""

    TOGGLE = 0x05030000
    INVALID_COMMAND = 0x05040001
    BLOCK_SIZE = 0x05040002
    SEQUENCE_NUMBER = 0x05040003
    WRITE_ONLY = 0x06010001
    READ_ONLY = 0x06010002
    NO_OBJECT = 0x06020000
    NOT_MAPPABLE = 0x06040041
    PDO_TOO_LONG = 0x06040042
    WRONG_LENGTH = 0x06070010
    TOO_LONG = 0x06070012
    TOO_SHORT = 0x06070013
    NO_SUBINDEX = 0x06090011
    INVALID_VALUE = 0x06090030
    TOO_HIGH = 0x06090031
    TOO_LOW = 0x06090032
    GENERAL = 0x08000000
    WRONG_STATE = 0x08000022


OUT_OF_RANGE = frozenset((Abort.INVALID_VALUE, Abort.TOO_HIGH, Abort.TOO_LOW))
"""Ways of saying that a value is none that the object may have."""
LENGTHS = frozenset((Abort.WRONG_LENGTH, Abort.TOO_LONG, Abort.TOO_SHORT))
"""Ways of saying that a value has another length than the object."""
