"""Abort codes of an SDO transfer (CiA 301, 7.2.4.3.17, table 22)."""

from enum import IntEnum


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
