"""Drive profile (CiA 402-2, IEC 61800-7-201): state machine, objects, PDOs and counters. Pure."""

import struct
from enum import IntEnum, auto
from typing import Final, NamedTuple

from .can301 import FrameError, mapping_entry

# --- Drive profile (CiA 402-2, IEC 61800-7-201): state machine and objects. Pure ------------------
#
# Both sides of the bus use it: the driver decodes statuswords and steps the controlword, the
# simulated drive applies controlwords and builds statuswords. `cia402.py` has the cyclic
# PDOs.


class Object(IntEnum):
    """Indices of the drive profile's objects, and of the one manufacturer's object in use."""

    ABORT_CONNECTION_OPTION = 0x6007
    ERROR_CODE = 0x603F
    CONTROLWORD = 0x6040
    STATUSWORD = 0x6041
    QUICK_STOP_OPTION = 0x605A
    MODE_OF_OPERATION = 0x6060
    MODE_DISPLAY = 0x6061
    POSITION_DEMAND = 0x6062
    POSITION_ACTUAL = 0x6064
    FOLLOWING_WINDOW = 0x6065
    FOLLOWING_TIMEOUT = 0x6066
    VELOCITY_ACTUAL = 0x606C
    TARGET_TORQUE = 0x6071
    MAX_TORQUE = 0x6072
    RATED_TORQUE = 0x6076
    TORQUE_ACTUAL = 0x6077
    TARGET_POSITION = 0x607A
    POSITION_LIMIT = 0x607D
    QUICK_STOP_DECELERATION = 0x6085
    POSITION_OFFSET = 0x60B0
    VELOCITY_OFFSET = 0x60B1
    TORQUE_OFFSET = 0x60B2
    INTERPOLATION_PERIOD = 0x60C2
    FOLLOWING_ERROR = 0x60F4
    TARGET_VELOCITY = 0x60FF
    SUPPORTED_MODES = 0x6502
    SETPOINT_TIMEOUT = 0x2F00
    """Manufacturer's, u16 [ms]: without a new cyclic setpoint the drive stops by itself."""


class OperationMode(IntEnum):
    """Cyclic synchronous modes of 6060h."""

    CSP = 8
    CSV = 9
    CST = 10


class DriveState(IntEnum):
    """States of the drive's power stage (CiA 402-2, figure 3)."""

    NOT_READY = auto()
    SWITCH_ON_DISABLED = auto()
    READY_TO_SWITCH_ON = auto()
    SWITCHED_ON = auto()
    OPERATION_ENABLED = auto()
    QUICK_STOP_ACTIVE = auto()
    FAULT_REACTION_ACTIVE = auto()
    FAULT = auto()

    @property
    def in_fault(self) -> bool:
        """Whether only a fault reset leads on from here."""
        return self in (DriveState.FAULT, DriveState.FAULT_REACTION_ACTIVE)


class Status(IntEnum):
    """Statusword bits (6041h) that are not part of the state."""

    VOLTAGE_ENABLED = 1 << 4
    WARNING = 1 << 7
    REMOTE = 1 << 9
    TARGET_REACHED = 1 << 10
    INTERNAL_LIMIT = 1 << 11
    FOLLOWS_COMMAND = 1 << 12
    FOLLOWING_ERROR = 1 << 13


class Controlword(IntEnum):
    """Controlwords (6040h) of the profile's commands."""

    DISABLE_VOLTAGE = 0x00
    QUICK_STOP = 0x02
    SHUTDOWN = 0x06
    SWITCH_ON = 0x07
    ENABLE_OPERATION = 0x0F
    FAULT_RESET = 0x80


class QuickStopOption(IntEnum):
    """605Ah: what a quick stop does."""

    RAMP_THEN_DISABLE = 2
    """Slow down on 6085h, then *Switch on disabled*."""
    RAMP_AND_STAY = 6


class AbortConnectionOption(IntEnum):
    """6007h: what a drive does when its master has gone."""

    NOTHING = 0
    FAULT = 1
    DISABLE_VOLTAGE = 2
    QUICK_STOP = 3


STATE_BITS: Final[dict[DriveState, int]] = {
    DriveState.NOT_READY: 0x00,
    DriveState.SWITCH_ON_DISABLED: 0x40,
    DriveState.READY_TO_SWITCH_ON: 0x21,
    DriveState.SWITCHED_ON: 0x23,
    DriveState.OPERATION_ENABLED: 0x27,
    DriveState.QUICK_STOP_ACTIVE: 0x07,
    DriveState.FAULT_REACTION_ACTIVE: 0x0F,
    DriveState.FAULT: 0x08,
}
"""The statusword's state bits of each state."""

_STATE_OF: Final[dict[int, DriveState]] = {
    bits: state
    for state, value in STATE_BITS.items()
    for bits in ((value, value | 0x20) if value & 0x0F in (0x00, 0x08, 0x0F) else (value,))
}  # bit 5 says nothing in those four states: their mask is 4Fh, not 6Fh


def decode_state(statusword: int) -> DriveState:
    """Return the state in a statusword (CiA 402-2, table 30).

    Raises `FrameError` for a combination of bits that means no state.
    """
    state = _STATE_OF.get(statusword & 0x6F)
    if state is None:
        raise FrameError(f"statusword {statusword:#06x} means no state of CiA 402")
    return state


_TOWARDS_ENABLED: Final = {
    DriveState.SWITCH_ON_DISABLED: Controlword.SHUTDOWN,
    DriveState.READY_TO_SWITCH_ON: Controlword.SWITCH_ON,
    DriveState.SWITCHED_ON: Controlword.ENABLE_OPERATION,
    DriveState.OPERATION_ENABLED: Controlword.ENABLE_OPERATION,
    DriveState.QUICK_STOP_ACTIVE: Controlword.QUICK_STOP,
}
_TOWARDS_DISABLED: Final = {
    DriveState.OPERATION_ENABLED: Controlword.SWITCH_ON,
    DriveState.SWITCHED_ON: Controlword.SHUTDOWN,
    DriveState.QUICK_STOP_ACTIVE: Controlword.QUICK_STOP,
}


def next_controlword(state: DriveState, target: DriveState) -> Controlword:
    """Return the controlword of the next step from `state` towards `target`.

    `target` is *Operation enabled* or *Switch on disabled*; any other raises `ValueError`. A quick
    stop under way is let finish on its ramp. A faulty drive gets bit 7 low: only a fault reset,
    whose rising edge the caller owns, leads on.
    """
    if target is DriveState.OPERATION_ENABLED:
        return _TOWARDS_ENABLED.get(state, Controlword.DISABLE_VOLTAGE)
    if target is DriveState.SWITCH_ON_DISABLED:
        return _TOWARDS_DISABLED.get(state, Controlword.DISABLE_VOLTAGE)
    raise ValueError(f"{target.name} is not a state that a drive can be asked for")


_TRANSITIONS: Final[dict[tuple[DriveState, Controlword], DriveState]] = {
    (DriveState.SWITCH_ON_DISABLED, Controlword.SHUTDOWN): DriveState.READY_TO_SWITCH_ON,  # 2
    (DriveState.READY_TO_SWITCH_ON, Controlword.SWITCH_ON): DriveState.SWITCHED_ON,  # 3
    (DriveState.READY_TO_SWITCH_ON, Controlword.ENABLE_OPERATION): DriveState.SWITCHED_ON,  # 3
    (DriveState.SWITCHED_ON, Controlword.ENABLE_OPERATION): DriveState.OPERATION_ENABLED,  # 4
    (DriveState.OPERATION_ENABLED, Controlword.SWITCH_ON): DriveState.SWITCHED_ON,  # 5
    (DriveState.SWITCHED_ON, Controlword.SHUTDOWN): DriveState.READY_TO_SWITCH_ON,  # 6
    (
        DriveState.READY_TO_SWITCH_ON,
        Controlword.DISABLE_VOLTAGE,
    ): DriveState.SWITCH_ON_DISABLED,  # 7
    (DriveState.READY_TO_SWITCH_ON, Controlword.QUICK_STOP): DriveState.SWITCH_ON_DISABLED,  # 7
    (DriveState.OPERATION_ENABLED, Controlword.SHUTDOWN): DriveState.READY_TO_SWITCH_ON,  # 8
    (DriveState.OPERATION_ENABLED, Controlword.DISABLE_VOLTAGE): DriveState.SWITCH_ON_DISABLED,  # 9
    (DriveState.SWITCHED_ON, Controlword.DISABLE_VOLTAGE): DriveState.SWITCH_ON_DISABLED,  # 10
    (DriveState.SWITCHED_ON, Controlword.QUICK_STOP): DriveState.SWITCH_ON_DISABLED,  # 10
    (DriveState.OPERATION_ENABLED, Controlword.QUICK_STOP): DriveState.QUICK_STOP_ACTIVE,  # 11
    (
        DriveState.QUICK_STOP_ACTIVE,
        Controlword.DISABLE_VOLTAGE,
    ): DriveState.SWITCH_ON_DISABLED,  # 12
}


def command_of(controlword: int) -> Controlword:
    """Return the command in a controlword's bits 0 to 3 (CiA 402-2, table 27)."""
    if not controlword & 0x02:
        return Controlword.DISABLE_VOLTAGE
    if not controlword & 0x04:
        return Controlword.QUICK_STOP
    if not controlword & 0x01:
        return Controlword.SHUTDOWN
    return Controlword.ENABLE_OPERATION if controlword & 0x08 else Controlword.SWITCH_ON


def apply_controlword(state: DriveState, previous_controlword: int, controlword: int) -> DriveState:
    """Return the state that a drive in `state` goes to on receiving `controlword`.

    One transition of the profile's numbers 2 to 12 or 15 at most; what a drive does by itself
    (0, 1, 12 after the quick stop's ramp, 13, 14) is the drive's. A fault is reset by the *rising
    edge* of bit 7, hence `previous_controlword`.
    """
    if state is DriveState.FAULT:
        rising = controlword & ~previous_controlword & Controlword.FAULT_RESET
        return DriveState.SWITCH_ON_DISABLED if rising else state
    return _TRANSITIONS.get((state, command_of(controlword)), state)


def supports_mode(supported_modes: int, mode: OperationMode) -> bool:
    """Return whether the bits of 6502h contain a mode: mode n is bit n − 1."""
    return bool(supported_modes >> (mode - 1) & 1)


# --- PDOs of a CiA 402 drive: mappings, and bytes to and from setpoints and feedback --------------
#
# The cyclic PDOs of this system are
#
#     RPDO1   6040h controlword u16, 607Ah target position i32         6 bytes   (CSP)
#     RPDO1   6040h controlword u16, 60FFh target velocity i32         6 bytes   (CSV)
#     RPDO1   6040h controlword u16, 6071h target torque i16           4 bytes   (CST)
#     TPDO1   6041h statusword u16, 6064h position i32, 6077h torque i16   8 bytes
#
# little-endian, at every SYNC.

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

COMMAND: Final = {
    OperationMode.CSP: struct.Struct("<Hi"),
    OperationMode.CSV: struct.Struct("<Hi"),
    OperationMode.CST: struct.Struct("<Hh"),
}
"""Layout of RPDO1 in each mode: controlword, target [counts, counts/s, 1/1000 of rated torque]."""
FEEDBACK_FIELDS: Final = "Hih"
FEEDBACK: Final = struct.Struct("<" + FEEDBACK_FIELDS)
"""Layout of TPDO1, `Feedback`."""


class Feedback(NamedTuple):
    """TPDO1: statusword, position [counts], torque [1/1000 of the rated torque]."""

    statusword: int
    position: int
    torque: int


def unpack_feedback(data: bytes | bytearray) -> Feedback:
    """Return what TPDO1 says. Raises `FrameError` unless it is 8 bytes."""
    if len(data) != FEEDBACK.size:
        raise FrameError(f"TPDO1: {len(data)} bytes instead of {FEEDBACK.size}")
    return Feedback(*FEEDBACK.unpack(data))


# --- A drive's position counter of 32 bits: what turns for ever makes it wrap ---------------------

SPAN: Final = 1 << 32
HALF: Final = 1 << 31


def wrapped(counts: int) -> int:
    """Return counts as a counter of 32 bits, with a sign, has them."""
    return (counts + HALF) % SPAN - HALF


class Unwrapped:
    """Counts of a joint that turns for ever: between two readings it goes the shorter way."""

    def __init__(self) -> None:
        self._last: int | None = None

    def take(self, counts: int) -> int:
        """Return a reading without the wraps since the first one."""
        last = counts if self._last is None else self._last
        self._last = last + wrapped(counts - last)
        return self._last
