"""Rules of the communication profile, CiA 301; none needs power, none moves anything."""

import struct
from typing import Final

from ....protocols.canopen import can301, cia402
from ....protocols.canopen.can301 import LENGTHS, OUT_OF_RANGE, Abort, NmtCommand, NmtState
from ....protocols.canopen.can301 import CommunicationObject as Com
from ....protocols.canopen.cia402 import Controlword, DriveState, Object
from .rule import Rule
from .sdo_client import SdoAbortError, SdoSilenceError, named
from .tried_drive import U8, U16, U32, AbsentError, BrokenError, TriedDrive

_STATUSWORD: Final = can301.mapping_entry(Object.STATUSWORD, 0, 16)
_CONTROLWORD: Final = can301.mapping_entry(Object.CONTROLWORD, 0, 16)
_POSITION: Final = can301.mapping_entry(Object.POSITION_ACTUAL, 0, 32)
_DEVICE_TYPE: Final = can301.mapping_entry(Com.DEVICE_TYPE, 0, 32)
_NAME: Final = 0x1008
_NOWHERE: Final = 0xE123
"""An index of the range that the standard reserves."""
_DRIVE_PROFILE: Final = 402
_BEAT_MS: Final = 50
_RESERVED_TYPE: Final = 245
_READY: Final = DriveState.READY_TO_SWITCH_ON


def _is(code: int, *allowed: int) -> None:
    if code not in allowed:
        raise BrokenError(f"aborts with {named(code)}, not {named(allowed[0])}")


def _device_type(drive: TriedDrive) -> None:
    profile = drive.get(Com.DEVICE_TYPE, 0, U32) & 0xFFFF
    if profile != _DRIVE_PROFILE:
        raise BrokenError(f"the low word of 1000h says profile {profile}")


def _identity(drive: TriedDrive) -> None:
    if not 1 <= drive.get(Com.IDENTITY, 0, U8) <= 4:
        raise BrokenError("1018h:0 is none of 1 to 4")
    drive.get(Com.IDENTITY, 1, U32)


def _no_object(drive: TriedDrive) -> None:
    try:
        drive.sdo.read(_NOWHERE)
    except SdoAbortError as error:
        _is(error.code, Abort.NO_OBJECT)
        return
    raise BrokenError(f"{_NOWHERE:04X}h can be read")


def _no_subindex(drive: TriedDrive) -> None:
    try:
        drive.sdo.read(Com.IDENTITY, 0xFE)
    except SdoAbortError as error:
        _is(error.code, Abort.NO_SUBINDEX)
        return
    raise BrokenError("1018h:254 can be read")


def _read_only(drive: TriedDrive) -> None:
    _is(drive.refusal(Com.DEVICE_TYPE, 0, U32, 0), Abort.READ_ONLY)


def _length(drive: TriedDrive) -> None:
    _is(drive.refusal(Object.CONTROLWORD, 0, U32, Controlword.DISABLE_VOLTAGE), *sorted(LENGTHS))


def _block(drive: TriedDrive) -> None:
    try:
        plain = drive.sdo.read(_NAME)
    except SdoAbortError as error:
        raise AbsentError(f"1008h: {named(error.code)}") from error
    try:
        by_block = drive.sdo.read_block(_NAME)
    except SdoAbortError as error:
        _is(error.code, Abort.INVALID_COMMAND)
        raise AbsentError("no block transfer") from error
    if by_block != plain:
        raise BrokenError(f"1008h is {plain!r}, by block {by_block!r}")


def _heartbeat(drive: TriedDrive) -> None:
    drive.put(Com.PRODUCER_HEARTBEAT, 0, U16, _BEAT_MS)
    drive.beats.clear()
    if not drive.until(lambda: len(drive.beats) >= 3, 0.02 * _BEAT_MS):
        raise BrokenError(f"{len(drive.beats)} heartbeats in {20 * _BEAT_MS} ms")
    if set(drive.beats) != {NmtState.PRE_OPERATIONAL}:
        raise BrokenError(f"its heartbeat says state {drive.beats[-1]} in Pre-operational")


def _network_states(drive: TriedDrive) -> None:
    drive.put(Com.PRODUCER_HEARTBEAT, 0, U16, _BEAT_MS)
    for command, state in (
        (NmtCommand.START, NmtState.OPERATIONAL),
        (NmtCommand.STOP, NmtState.STOPPED),
    ):
        drive.nmt(command)
        if not drive.until(lambda state=state: drive.beats[-1:] == [state], 0.02 * _BEAT_MS):  # type: ignore[misc]  # a default that is bound
            raise BrokenError(f"does not tell {state.name} by its heartbeat")
    try:
        drive.sdo.read(Com.DEVICE_TYPE)
    except SdoSilenceError:
        return
    raise BrokenError("answers SDO while it is Stopped")


def _mapped_while_on(drive: TriedDrive) -> None:
    drive.map_pdo(_STATUSWORD, receive=False, transmission=can301.EVERY_SYNC)
    drive.refusal(Com.TPDO_MAPPING, 1, U32, _POSITION)


def _mapping(drive: TriedDrive) -> None:
    drive.map_pdo(receive=False, transmission=can301.EVERY_SYNC)
    off = can301.PDO_INVALID | can301.tpdo1_id(drive.node)
    drive.put(Com.TPDO_COMMUNICATION, 1, U32, off)
    try:
        drive.put(Com.TPDO_MAPPING, 1, U32, _DEVICE_TYPE)
        code = drive.refusal(Com.TPDO_MAPPING, 0, U8, 1)
    except SdoAbortError as error:
        code = error.code
    _is(code, Abort.NOT_MAPPABLE, Abort.NO_OBJECT)


def _too_long(drive: TriedDrive) -> None:
    off = can301.PDO_INVALID | can301.tpdo1_id(drive.node)
    drive.put(Com.TPDO_COMMUNICATION, 1, U32, off)
    drive.put(Com.TPDO_MAPPING, 0, U8, 0)
    try:
        for place in (1, 2, 3):
            drive.put(Com.TPDO_MAPPING, place, U32, _POSITION)
        code = drive.refusal(Com.TPDO_MAPPING, 0, U8, 3)
    except SdoAbortError as error:
        code = error.code
    _is(code, Abort.PDO_TOO_LONG, Abort.NOT_MAPPABLE)


def _reserved_type(drive: TriedDrive) -> None:
    off = can301.PDO_INVALID | can301.tpdo1_id(drive.node)
    drive.put(Com.TPDO_COMMUNICATION, 1, U32, off)
    code = drive.refusal(Com.TPDO_COMMUNICATION, 2, U8, _RESERVED_TYPE)
    _is(code, *sorted(OUT_OF_RANGE))


def _every_sync(drive: TriedDrive) -> None:
    drive.map_pdo(_STATUSWORD, _POSITION, receive=False, transmission=can301.EVERY_SYNC)
    drive.nmt(NmtCommand.START)
    drive.listen(0.05)
    drive.pdos.clear()
    for count in range(1, 6):
        drive.sync()
        drive.listen(0.02)
        if len(drive.pdos) != count:
            raise BrokenError(f"{len(drive.pdos)} TPDOs after {count} SYNCs")
    if len(drive.pdos[-1]) != 6:
        raise BrokenError(f"{len(drive.pdos[-1])} bytes of 6041h and 6064h")


def _on_change(drive: TriedDrive) -> None:
    drive.map_pdo(_STATUSWORD, receive=False, transmission=can301.AT_ONCE)
    drive.nmt(NmtCommand.START)
    drive.listen(0.1)
    drive.pdos.clear()
    drive.command(Controlword.SHUTDOWN)
    drive.expect(_READY)

    def told() -> bool:
        words = [int.from_bytes(data[:2], "little") for data in drive.pdos]
        return any(cia402.decode_state(word) is _READY for word in words)

    if not drive.until(told, 0.5):
        raise BrokenError("6041h has changed, and no TPDO of type 255 came")


def _by_pdo(drive: TriedDrive) -> None:
    drive.map_pdo(_CONTROLWORD, receive=True, transmission=can301.AT_ONCE)
    drive.nmt(NmtCommand.START)
    drive.send_pdo(struct.pack(U16, Controlword.DISABLE_VOLTAGE))
    drive.send_pdo(struct.pack(U16, Controlword.SHUTDOWN))
    drive.expect(_READY)


def _short_pdo(drive: TriedDrive) -> None:
    drive.map_pdo(_CONTROLWORD, receive=True, transmission=can301.AT_ONCE)
    drive.nmt(NmtCommand.START)
    drive.send_pdo(bytes((Controlword.SHUTDOWN,)))
    drive.listen(0.05)
    if drive.state is _READY:
        raise BrokenError("a PDO of 1 byte instead of 2 is obeyed")


COMMUNICATION: Final = (
    Rule("CiA 301, 1000h", "the device type names the drive profile", _device_type),
    Rule("CiA 301, 1018h", "the identity can be read", _identity),
    Rule("CiA 301, 7.2.4.3.17", "an object that is none aborts with 0602 0000h", _no_object),
    Rule("CiA 301, 7.2.4.3.17", "a sub-index that is none aborts with 0609 0011h", _no_subindex),
    Rule("CiA 301, 7.2.4.3.17", "what is read only aborts with 0601 0002h", _read_only),
    Rule("CiA 301, 7.2.4.3.17", "a wrong length aborts with 0607 001xh", _length),
    Rule("CiA 301, 7.2.4.3", "a block upload brings what a plain one does", _block),
    Rule("CiA 301, 1017h", "heartbeats come as often as asked for", _heartbeat),
    Rule("CiA 301, 7.3.2", "NMT commands are obeyed; Stopped answers no SDO", _network_states),
    Rule("CiA 301, 7.5.2.38", "a PDO that is on cannot be mapped", _mapped_while_on),
    Rule("CiA 301, 7.5.2.38", "what cannot be mapped aborts with 0604 0041h", _mapping),
    Rule("CiA 301, 7.5.2.38", "more than 8 bytes abort with 0604 0042h", _too_long),
    Rule("CiA 301, 7.5.2.37", "a reserved transmission type is refused", _reserved_type),
    Rule("CiA 301, 7.5.2.37", "type 1: one TPDO for each SYNC", _every_sync),
    Rule("CiA 301, 7.5.2.37", "type 255: a TPDO when its content has changed", _on_change),
    Rule("CiA 301, 7.5.2.35", "type 255: an RPDO is obeyed at once", _by_pdo),
    Rule("CiA 301, 7.5.2.36", "an RPDO that is too short is not obeyed", _short_pdo),
)
