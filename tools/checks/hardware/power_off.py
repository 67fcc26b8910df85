"""Rules of the drive profile, CiA 402-2, that are tried with the power stage off."""

import struct
from typing import Final

from ....protocols.canopen import can301, cia402
from ....protocols.canopen.can301 import OUT_OF_RANGE, NmtCommand
from ....protocols.canopen.cia402 import Controlword, DriveState, Object, OperationMode, Status
from .rule import Rule
from .sdo_client import named
from .tried_drive import I8, I16, I32, U16, U32, AbsentError, BrokenError, TriedDrive

NO_MODE: Final = 99
NO_OPTION: Final = 99
_MODE: Final = can301.mapping_entry(Object.MODE_OF_OPERATION, 0, 8)
_SHOWN_S: Final = 0.2
"""A drive shows a new mode within so long [s]."""
_AT_REST: Final = 1e-4
"""A joint that stands moves by less than this part of the greatest count [1]."""


def modes(drive: TriedDrive) -> list[OperationMode]:
    """Return the cyclic modes that the drive has."""
    supported = drive.get(Object.SUPPORTED_MODES, 0, U32)
    return [mode for mode in OperationMode if cia402.supports_mode(supported, mode)]


def show(drive: TriedDrive, mode: int) -> None:
    """Wait until 6061h shows a mode. Raises `BrokenError`."""
    deadline = drive.bus.clock() + _SHOWN_S
    while (shown := drive.get(Object.MODE_DISPLAY, 0, I8)) != mode:
        if drive.bus.clock() > deadline:
            raise BrokenError(f"6060h is {mode}, 6061h stays {shown}")


def _refused(drive: TriedDrive, index: int, subindex: int, layout: str, value: int) -> None:
    before = drive.optional(index, subindex, layout)
    code = drive.refusal(index, subindex, layout, value)
    if code not in OUT_OF_RANGE:
        raise BrokenError(f"{value} aborts with {named(code)}, not 0609 003xh")
    if (after := drive.get(index, subindex, layout)) != before:
        raise BrokenError(f"{index:04X}h is {after} after a refused write, {before} before")


def _state(drive: TriedDrive) -> None:
    word = drive.get(Object.STATUSWORD, 0, U16)
    cia402.decode_state(word)


def _ready_and_back(drive: TriedDrive) -> None:
    drive.command(Controlword.DISABLE_VOLTAGE)
    drive.expect(DriveState.SWITCH_ON_DISABLED)
    drive.command(Controlword.SHUTDOWN)
    drive.expect(DriveState.READY_TO_SWITCH_ON)
    drive.command(Controlword.DISABLE_VOLTAGE)
    drive.expect(DriveState.SWITCH_ON_DISABLED)


def _quick_stop_when_ready(drive: TriedDrive) -> None:
    drive.command(Controlword.SHUTDOWN)
    drive.expect(DriveState.READY_TO_SWITCH_ON)
    drive.command(Controlword.QUICK_STOP)
    drive.expect(DriveState.SWITCH_ON_DISABLED)


def _reset_without_fault(drive: TriedDrive) -> None:
    drive.command(Controlword.SHUTDOWN)
    drive.expect(DriveState.READY_TO_SWITCH_ON)
    drive.command(Controlword.SHUTDOWN | Controlword.FAULT_RESET)
    if drive.state is not DriveState.READY_TO_SWITCH_ON:
        raise BrokenError(f"bit 7 without a fault leads to {drive.state.name}")


def _remote(drive: TriedDrive) -> None:
    _ready_and_back(drive)
    if not drive.get(Object.STATUSWORD, 0, U16) & Status.REMOTE:
        raise BrokenError("6040h is obeyed, and bit 9 says that it is not")


def _no_following_error(drive: TriedDrive) -> None:
    if drive.get(Object.STATUSWORD, 0, U16) & Status.FOLLOWING_ERROR:
        raise BrokenError("bit 13 is set without power")


def _shown_modes(drive: TriedDrive) -> None:
    for mode in modes(drive):
        drive.put(Object.MODE_OF_OPERATION, 0, I8, mode)
        show(drive, mode)


def _mode_by_pdo(drive: TriedDrive) -> None:
    found = modes(drive)
    if not found:
        raise AbsentError("6502h has no cyclic mode")
    first, last = found[0], found[-1]
    drive.put(Object.MODE_OF_OPERATION, 0, I8, first)
    show(drive, first)
    drive.map_pdo(_MODE, receive=True, transmission=can301.AT_ONCE)
    drive.nmt(NmtCommand.START)
    drive.send_pdo(struct.pack(I8, last))
    show(drive, last)


def _no_mode(drive: TriedDrive) -> None:
    shown = drive.get(Object.MODE_DISPLAY, 0, I8)
    _refused(drive, Object.MODE_OF_OPERATION, 0, I8, NO_MODE)
    show(drive, shown)


def _quick_stop_option(drive: TriedDrive) -> None:
    _refused(drive, Object.QUICK_STOP_OPTION, 0, I16, NO_OPTION)


def _abort_option(drive: TriedDrive) -> None:
    _refused(drive, Object.ABORT_CONNECTION_OPTION, 0, I16, NO_OPTION)


def _deceleration(drive: TriedDrive) -> None:
    _refused(drive, Object.QUICK_STOP_DECELERATION, 0, U32, 0)


def _kept_values(drive: TriedDrive) -> None:
    for index, subindex, layout, value in (
        (Object.FOLLOWING_WINDOW, 0, U32, 12345),
        (Object.FOLLOWING_TIMEOUT, 0, U16, 20),
        (Object.POSITION_LIMIT, 1, I32, -12345),
        (Object.POSITION_LIMIT, 2, I32, 12345),
    ):
        drive.optional(index, subindex, layout)
        drive.put(index, subindex, layout, value)
        if (found := drive.get(index, subindex, layout)) != value:
            raise BrokenError(f"{index:04X}h:{subindex} takes {value}, and reads {found}")


def _standing(drive: TriedDrive) -> None:
    before = drive.get(Object.POSITION_ACTUAL, 0, I32)
    drive.listen(0.1)
    moved = abs(drive.get(Object.POSITION_ACTUAL, 0, I32) - before)
    if moved > _AT_REST * 2**31:
        raise BrokenError(f"6064h changes by {moved} counts in 0.1 s without power")


def _torque(drive: TriedDrive) -> None:
    if drive.optional(Object.RATED_TORQUE, 0, U32) == 0:
        raise BrokenError("6076h is 0, and 6077h a part of it")
    drive.optional(Object.TORQUE_ACTUAL, 0, I16)


POWER_OFF: Final = (
    Rule("CiA 402-2, 6041h", "the statusword's bits mean a state", _state),
    Rule("CiA 402-2, figure 3", "transitions 2 and 7", _ready_and_back),
    Rule("CiA 402-2, figure 3", "transition 7 by a quick stop", _quick_stop_when_ready),
    Rule("CiA 402-2, 6040h", "bit 7 does nothing without a fault", _reset_without_fault),
    Rule("CiA 402-2, 6041h", "bit 9 tells that 6040h is obeyed", _remote),
    Rule("CiA 402-2, 6041h", "no following error without power", _no_following_error),
    Rule("CiA 402-2, 6061h", "shows every mode of 6502h that 6060h is set to", _shown_modes),
    Rule("CiA 402-2, 6061h", "follows 6060h that came by PDO", _mode_by_pdo),
    Rule("CiA 402-2, 6060h", "a mode that is none is refused: 0609 003xh", _no_mode),
    Rule("CiA 402-2, 605Ah", "an option that is none is refused: 0609 003xh", _quick_stop_option),
    Rule("CiA 402-2, 6007h", "an option that is none is refused: 0609 003xh", _abort_option),
    Rule("CiA 402-2, 6085h", "no deceleration is refused: 0609 003xh", _deceleration),
    Rule("CiA 402-2, 6065h 6066h 607Dh", "windows and limits read as written", _kept_values),
    Rule("CiA 402-2, 6064h", "a joint that stands reads so", _standing),
    Rule("CiA 402-2, 6076h", "torques have a unit", _torque),
)
