"""Rules of the drive profile, CiA 402-2, that need power; the joint holds, and is asked no motion.

Setpoints are the drive's own position, at every SYNC.
"""

import struct
from typing import Final

from ....protocols.canopen.can301 import NmtCommand
from ....protocols.canopen.cia402 import (
    Controlword,
    DriveState,
    Object,
    OperationMode,
    QuickStopOption,
)
from .power_off import modes, show
from .rule import Rule
from .sdo_client import SdoAbortError
from .tried_drive import I8, I16, I32, AbsentError, BrokenError, TriedDrive

PERIOD_S: Final = 0.01
ENABLE_S: Final = 3.0
"""A brake opens within so long [s]."""
_HELD_S: Final = 0.3
_OFF, _READY = DriveState.SWITCH_ON_DISABLED, DriveState.READY_TO_SWITCH_ON
_ON, _ENABLED = DriveState.SWITCHED_ON, DriveState.OPERATION_ENABLED


def _reach(drive: TriedDrive, state: DriveState, word: int) -> None:
    """Write a controlword, and send SYNCs until the drive is in a state. Raises `BrokenError`."""
    drive.command(word)
    deadline = drive.bus.clock() + ENABLE_S
    while (found := drive.state) is not state:
        if drive.bus.clock() > deadline:
            raise BrokenError(f"controlword {word:#04x}: stays in {found.name}, not {state.name}")
        drive.sync()
        drive.listen(PERIOD_S)


def _switch_on(drive: TriedDrive) -> None:
    """Go to *Switched on* in CSP, with the drive's own position as the setpoint."""
    if OperationMode.CSP not in modes(drive):
        raise AbsentError("6502h has no CSP")
    drive.put(Object.MODE_OF_OPERATION, 0, I8, OperationMode.CSP)
    show(drive, OperationMode.CSP)
    here = drive.sdo.read(Object.POSITION_ACTUAL)
    drive.sdo.write(Object.TARGET_POSITION, 0, here)
    drive.nmt(NmtCommand.START)
    _reach(drive, _OFF, Controlword.DISABLE_VOLTAGE)
    _reach(drive, _READY, Controlword.SHUTDOWN)
    _reach(drive, _ON, Controlword.SWITCH_ON)


def _enable(drive: TriedDrive) -> None:
    _switch_on(drive)
    _reach(drive, _ENABLED, Controlword.ENABLE_OPERATION)


def _in_one_step(drive: TriedDrive) -> None:
    _reach(drive, _OFF, Controlword.DISABLE_VOLTAGE)
    drive.command(Controlword.ENABLE_OPERATION)
    drive.listen(0.1)
    if drive.state is not _OFF:
        raise BrokenError(f"Enable operation leads from Switch on disabled to {drive.state.name}")


def _transitions(drive: TriedDrive) -> None:
    _enable(drive)
    _reach(drive, _ON, Controlword.SWITCH_ON)
    _reach(drive, _READY, Controlword.SHUTDOWN)
    _reach(drive, _ON, Controlword.SWITCH_ON)
    _reach(drive, _OFF, Controlword.DISABLE_VOLTAGE)


def _shutdown(drive: TriedDrive) -> None:
    _enable(drive)
    _reach(drive, _READY, Controlword.SHUTDOWN)


def _disable_voltage(drive: TriedDrive) -> None:
    _enable(drive)
    _reach(drive, _OFF, Controlword.DISABLE_VOLTAGE)


def _quick_stop(drive: TriedDrive) -> None:
    _enable(drive)
    drive.put(Object.QUICK_STOP_OPTION, 0, I16, QuickStopOption.RAMP_THEN_DISABLE)
    _reach(drive, _OFF, Controlword.QUICK_STOP)


def _stays(drive: TriedDrive) -> None:
    _enable(drive)
    try:
        drive.put(Object.QUICK_STOP_OPTION, 0, I16, QuickStopOption.RAMP_AND_STAY)
    except SdoAbortError as error:
        raise AbsentError("605Ah = 6") from error
    _reach(drive, DriveState.QUICK_STOP_ACTIVE, Controlword.QUICK_STOP)
    drive.listen(_HELD_S)
    if drive.state is not DriveState.QUICK_STOP_ACTIVE:
        raise BrokenError(f"605Ah is 6, and the drive goes to {drive.state.name}")
    _reach(drive, _OFF, Controlword.DISABLE_VOLTAGE)


def _true_mode(drive: TriedDrive) -> None:
    _enable(drive)
    others = [mode for mode in modes(drive) if mode is not OperationMode.CSP]
    if not others:
        raise AbsentError("one mode only")
    shown: OperationMode = others[0]
    try:
        drive.put(Object.MODE_OF_OPERATION, 0, I8, OperationMode.CSP)
        drive.sdo.write(Object.MODE_OF_OPERATION, 0, struct.pack(I8, shown))
    except SdoAbortError:
        shown = OperationMode.CSP
    show(drive, shown)
    _reach(drive, _OFF, Controlword.DISABLE_VOLTAGE)


def _holds(drive: TriedDrive) -> None:
    before = drive.get(Object.POSITION_ACTUAL, 0, I32)
    _enable(drive)
    demand = drive.optional(Object.POSITION_DEMAND, 0, I32)
    for _ in range(round(_HELD_S / PERIOD_S)):
        drive.sync()
        drive.listen(PERIOD_S)
    after = drive.get(Object.POSITION_ACTUAL, 0, I32)
    window = drive.optional(Object.FOLLOWING_WINDOW, 0, "<I")
    if abs(after - before) > window or abs(demand - before) > window:
        raise BrokenError(f"moves by {after - before} counts when it is enabled")


POWER_ON: Final = (
    Rule("CiA 402-2, figure 3", "Enable operation does nothing when switched off", _in_one_step),
    Rule("CiA 402-2, figure 3", "transitions 2 to 6 and 10", _transitions),
    Rule("CiA 402-2, figure 3", "transition 8", _shutdown),
    Rule("CiA 402-2, figure 3", "transition 9", _disable_voltage),
    Rule("CiA 402-2, 605Ah", "2: transitions 11 and 12 after the ramp", _quick_stop),
    Rule("CiA 402-2, 605Ah", "6: stays in Quick stop active", _stays),
    Rule("CiA 402-2, 6061h", "shows the true mode in Operation enabled", _true_mode),
    Rule("CiA 402-2, 6062h 6064h", "enabling moves nothing", _holds),
)
