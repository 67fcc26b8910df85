"""Trial of one real drive against rules of CiA 301 and CiA 402, off and on."""

import struct
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from ....config.errors import ConfigError
from ....config.load import Cell
from ....config.schema.mechanism import DriveSection
from ....drivers.canopen.sdo import SdoAbortError, SdoClient, SdoSilenceError, named, wait_for
from ....drivers.device import DeviceError
from ....drivers.fieldbus import Fieldbus, open_buses
from ....protocols.canopen import can301, cia402
from ....protocols.canopen.can301 import (
    LENGTHS,
    OUT_OF_RANGE,
    Abort,
    FrameError,
    NmtCommand,
    NmtState,
)
from ....protocols.canopen.can301 import CommunicationObject as Com
from ....protocols.canopen.cia402 import (
    Controlword,
    DriveState,
    Object,
    OperationMode,
    QuickStopOption,
    Status,
)
from ..findings import Finding, Severity
from .on_bus import POWER_IS_OFF, listen_for_masters

# --- A drive that a rule is tried on: SDO, PDOs, NMT, and everything put back after each rule -----
BOOT_S: Final = 5.0  # a drive has restarted its communication within so long [s]
ENABLE_S: Final = 3.0  # a drive is in another state within so long: a brake opens [s]
PERIOD_S: Final = 0.01  # between two SYNCs [s]
U8, I8, U16, I16, U32, I32 = "<B", "<b", "<H", "<h", "<I", "<i"


class BrokenError(Exception):
    """Raised by a rule that the drive does not keep: what it did instead."""


class AbsentError(Exception):
    """Raised by a rule about something optional that the drive does not have."""


class TriedDrive:
    """One node on a bus, whose power stage is off."""

    def __init__(self, fieldbus: Fieldbus, node: int) -> None:
        self.bus, self.node = fieldbus, node
        self.sdo = SdoClient(fieldbus, node)
        self.beats: list[int] = []  # NMT states of its heartbeats since they were last cleared
        self.pdos: list[bytes] = []  # TPDO1 since they were last cleared
        self._written: dict[tuple[int, int], bytes] = {}
        self._disturbed = False
        fieldbus.listen(can301.heartbeat_id(node), self._on_beat)
        fieldbus.listen(can301.tpdo1_id(node), lambda data, _stamp: self.pdos.append(data))

    # --- time -----------------------------------------------------------------------------------

    def until(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Listen until something holds; return False if it does not in time [s]."""
        return wait_for(self.bus, condition, seconds)

    def listen(self, seconds: float) -> None:
        """Listen for so long [s]."""
        self.until(lambda: False, seconds)

    # --- objects --------------------------------------------------------------------------------

    def get(self, index: int, subindex: int, layout: str) -> int:
        """Return an integer object."""
        data = self.sdo.read(index, subindex)
        if len(data) != struct.calcsize(layout):
            raise BrokenError(f"{index:04X}h:{subindex} has {len(data)} bytes")
        return int(struct.unpack(layout, data)[0])

    def optional(self, index: int, subindex: int, layout: str) -> int:
        """Return an integer object that a drive may do without. Raises `AbsentError`."""
        try:
            return self.get(index, subindex, layout)
        except SdoAbortError as error:
            raise AbsentError(f"{index:04X}h:{subindex}: {named(error.code)}") from error

    def put(self, index: int, subindex: int, layout: str, value: int) -> None:
        """Write an object; it gets its present value back after the rule."""
        key = (index, subindex)
        if key not in self._written and index >= 0x2000:
            self._written[key] = self.sdo.read(index, subindex)
        self._disturbed = self._disturbed or index < 0x2000
        self.sdo.write(index, subindex, struct.pack(layout, value))

    def refusal(self, index: int, subindex: int, layout: str, value: int) -> int:
        """Return the abort code of a write that must be refused. Raises `BrokenError`."""
        try:
            self.put(index, subindex, layout, value)
        except SdoAbortError as error:
            if self.sdo.newest != (index, subindex):
                raise BrokenError(f"the abort names {self.sdo.newest[0]:04X}h") from None
            return error.code
        raise BrokenError(f"{index:04X}h:{subindex} takes {value}")

    @property
    def state(self) -> DriveState:
        """The state of its power stage."""
        return cia402.decode_state(self.get(Object.STATUSWORD, 0, U16))

    def command(self, word: int) -> None:
        """Write the controlword."""
        self.sdo.write(Object.CONTROLWORD, 0, struct.pack(U16, word))

    def expect(self, state: DriveState, after: str = "") -> None:
        """Wait for a state, with SYNCs, which came `after` something. Raises `BrokenError`."""
        deadline = self.bus.clock() + ENABLE_S
        while (found := self.state) is not state:
            if self.bus.clock() > deadline:
                raise BrokenError(f"{after}stays in {found.name}, not {state.name}")
            self.sync()
            self.listen(PERIOD_S)

    def go(self, word: int, state: DriveState) -> None:
        """Write the controlword, and wait for a state. Raises `BrokenError`."""
        self.command(word)
        self.expect(state, f"controlword {word:#04x}: ")

    # --- network --------------------------------------------------------------------------------

    def nmt(self, command: NmtCommand) -> None:
        """Send a command of the network master to this node."""
        self._disturbed = True
        self.bus.send(can301.NMT_ID, bytes((command, self.node)))

    def map_pdo(self, *entries: int, receive: bool, transmission: int) -> None:
        """Map PDO 1 of a direction in *Pre-operational*, and switch it on."""
        first = Com.RPDO_COMMUNICATION if receive else Com.TPDO_COMMUNICATION
        mapping = Com.RPDO_MAPPING if receive else Com.TPDO_MAPPING
        can_id = (can301.rpdo1_id if receive else can301.tpdo1_id)(self.node)
        self.put(first, 1, U32, can301.PDO_INVALID | can_id)
        self.put(first, 2, U8, transmission)
        self.put(mapping, 0, U8, 0)
        for place, entry in enumerate(entries, 1):
            self.put(mapping, place, U32, entry)
        self.put(mapping, 0, U8, len(entries))
        self.put(first, 1, U32, can_id)

    def send_pdo(self, data: bytes) -> None:
        self.bus.send(can301.rpdo1_id(self.node), data)

    def sync(self) -> None:
        self.bus.send(can301.SYNC_ID, b"")

    def restart(self) -> None:
        """Reset the communication, and wait for the boot-up message. Raises `DeviceError`."""
        self.beats.clear()
        self.bus.send(can301.NMT_ID, bytes((NmtCommand.RESET_COMMUNICATION, self.node)))
        if not self.until(lambda: NmtState.BOOT_UP in self.beats, BOOT_S):
            raise DeviceError(f"node {self.node}: no boot-up message within {BOOT_S} s of a reset")

    def put_back(self) -> None:
        """Take the voltage off and restore all that a rule has changed. Raises `DeviceError`."""
        if self._disturbed:
            self.restart()
        self.command(Controlword.DISABLE_VOLTAGE)
        for (index, subindex), data in reversed(self._written.items()):
            self.sdo.write(index, subindex, data)
        self._written.clear()
        self._disturbed = False

    def _on_beat(self, data: bytes, _stamp: float) -> None:
        self.beats.append(can301.decode_heartbeat(data))


Try = Callable[[TriedDrive], None]  # raises `BrokenError` or `AbsentError`


class Rule(NamedTuple):
    """Sentence of a profile: where it stands, in short words, and how it is tried."""

    clause: str
    promise: str
    judge: Try


# --- Rules of the communication profile, CiA 301; none needs power, none moves anything -----------
_STATUSWORD: Final = can301.mapping_entry(Object.STATUSWORD, 0, 16)
_CONTROLWORD: Final = can301.mapping_entry(Object.CONTROLWORD, 0, 16)
_POSITION: Final = can301.mapping_entry(Object.POSITION_ACTUAL, 0, 32)
_DEVICE_TYPE: Final = can301.mapping_entry(Com.DEVICE_TYPE, 0, 32)
_NAME: Final = 0x1008
_NOWHERE: Final = 0xE123  # an index of the range that the standard reserves
_DRIVE_PROFILE: Final = 402
_BEAT_MS: Final = 50
_RESERVED_TYPE: Final = 245
_READY, _OFF = DriveState.READY_TO_SWITCH_ON, DriveState.SWITCH_ON_DISABLED


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


def _unreadable(index: int, subindex: int, why: Abort) -> Try:
    """Return a rule's trial: reading an object aborts, and says why."""

    def tried(drive: TriedDrive) -> None:
        try:
            drive.sdo.read(index, subindex)
        except SdoAbortError as error:
            _is(error.code, why)
            return
        raise BrokenError(f"{index:04X}h:{subindex} can be read")

    return tried


def _unwritable(index: int, layout: str, value: int, *allowed: int) -> Try:
    """Return a rule's trial: writing an object aborts with one of these codes."""
    return lambda drive: _is(drive.refusal(index, 0, layout, value), *allowed)


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


def _unmappable(entry: int, count: int, *allowed: int) -> Try:
    """Return a rule's trial: mapping an entry so many times aborts with one of these codes."""

    def tried(drive: TriedDrive) -> None:
        off = can301.PDO_INVALID | can301.tpdo1_id(drive.node)
        drive.put(Com.TPDO_COMMUNICATION, 1, U32, off)
        drive.put(Com.TPDO_MAPPING, 0, U8, 0)
        try:
            for place in range(1, count + 1):
                drive.put(Com.TPDO_MAPPING, place, U32, entry)
            code = drive.refusal(Com.TPDO_MAPPING, 0, U8, count)
        except SdoAbortError as error:
            code = error.code
        _is(code, *allowed)

    return tried


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
    drive.go(Controlword.SHUTDOWN, _READY)

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
    Rule("CiA 301, 7.2.4.3.17", "an object that is none aborts with 0602 0000h",
         _unreadable(_NOWHERE, 0, Abort.NO_OBJECT)),
    Rule("CiA 301, 7.2.4.3.17", "a sub-index that is none aborts with 0609 0011h",
         _unreadable(Com.IDENTITY, 0xFE, Abort.NO_SUBINDEX)),
    Rule("CiA 301, 7.2.4.3.17", "what is read only aborts with 0601 0002h",
         _unwritable(Com.DEVICE_TYPE, U32, 0, Abort.READ_ONLY)),
    Rule("CiA 301, 7.2.4.3.17", "a wrong length aborts with 0607 001xh",
         _unwritable(Object.CONTROLWORD, U32, Controlword.DISABLE_VOLTAGE, *sorted(LENGTHS))),
    Rule("CiA 301, 7.2.4.3", "a block upload brings what a plain one does", _block),
    Rule("CiA 301, 1017h", "heartbeats come as often as asked for", _heartbeat),
    Rule("CiA 301, 7.3.2", "NMT commands are obeyed; Stopped answers no SDO", _network_states),
    Rule("CiA 301, 7.5.2.38", "a PDO that is on cannot be mapped", _mapped_while_on),
    Rule("CiA 301, 7.5.2.38", "what cannot be mapped aborts with 0604 0041h",
         _unmappable(_DEVICE_TYPE, 1, Abort.NOT_MAPPABLE, Abort.NO_OBJECT)),
    Rule("CiA 301, 7.5.2.38", "more than 8 bytes abort with 0604 0042h",
         _unmappable(_POSITION, 3, Abort.PDO_TOO_LONG, Abort.NOT_MAPPABLE)),
    Rule("CiA 301, 7.5.2.37", "a reserved transmission type is refused", _reserved_type),
    Rule("CiA 301, 7.5.2.37", "type 1: one TPDO for each SYNC", _every_sync),
    Rule("CiA 301, 7.5.2.37", "type 255: a TPDO when its content has changed", _on_change),
    Rule("CiA 301, 7.5.2.35", "type 255: an RPDO is obeyed at once", _by_pdo),
    Rule("CiA 301, 7.5.2.36", "an RPDO that is too short is not obeyed", _short_pdo),
)  # fmt: skip


# --- Rules of the drive profile, CiA 402-2, that are tried with the power stage off ---------------
NO_MODE: Final = 99
NO_OPTION: Final = 99
_MODE: Final = can301.mapping_entry(Object.MODE_OF_OPERATION, 0, 8)
_SHOWN_S: Final = 0.2  # a drive shows a new mode within so long [s]
_AT_REST: Final = 1e-4  # a joint that stands moves by less than this part of the greatest count [1]


def modes(drive: TriedDrive) -> list[OperationMode]:
    supported = drive.get(Object.SUPPORTED_MODES, 0, U32)
    return [mode for mode in OperationMode if cia402.supports_mode(supported, mode)]


def show(drive: TriedDrive, mode: int) -> None:
    """Wait until 6061h shows a mode. Raises `BrokenError`."""
    deadline = drive.bus.clock() + _SHOWN_S
    while (shown := drive.get(Object.MODE_DISPLAY, 0, I8)) != mode:
        if drive.bus.clock() > deadline:
            raise BrokenError(f"6060h is {mode}, 6061h stays {shown}")


def _refused(index: int, layout: str, value: int) -> Try:
    """Return a rule's trial: a value is out of an object's range, and leaves it as it was."""

    def tried(drive: TriedDrive) -> None:
        before = drive.optional(index, 0, layout)
        code = drive.refusal(index, 0, layout, value)
        if code not in OUT_OF_RANGE:
            raise BrokenError(f"{value} aborts with {named(code)}, not 0609 003xh")
        if (after := drive.get(index, 0, layout)) != before:
            raise BrokenError(f"{index:04X}h is {after} after a refused write, {before} before")

    return tried


def _walk(*way: tuple[Controlword, DriveState], enabled: bool = False) -> Try:
    """Return a rule's trial: controlwords lead from state to state, from one that is `enabled`."""

    def tried(drive: TriedDrive) -> None:
        if enabled:
            _enable(drive)
        for word, state in way:
            drive.go(word, state)

    return tried


_READY_AND_BACK: Final = _walk(
    (Controlword.DISABLE_VOLTAGE, _OFF), (Controlword.SHUTDOWN, _READY),
    (Controlword.DISABLE_VOLTAGE, _OFF),
)  # fmt: skip


def _state(drive: TriedDrive) -> None:
    word = drive.get(Object.STATUSWORD, 0, U16)
    cia402.decode_state(word)


def _reset_without_fault(drive: TriedDrive) -> None:
    drive.go(Controlword.SHUTDOWN, _READY)
    drive.command(Controlword.SHUTDOWN | Controlword.FAULT_RESET)
    if drive.state is not _READY:
        raise BrokenError(f"bit 7 without a fault leads to {drive.state.name}")


def _remote(drive: TriedDrive) -> None:
    _READY_AND_BACK(drive)
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
    _refused(Object.MODE_OF_OPERATION, I8, NO_MODE)(drive)
    show(drive, shown)


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
    Rule("CiA 402-2, figure 3", "transitions 2 and 7", _READY_AND_BACK),
    Rule("CiA 402-2, figure 3", "transition 7 by a quick stop",
         _walk((Controlword.SHUTDOWN, _READY), (Controlword.QUICK_STOP, _OFF))),
    Rule("CiA 402-2, 6040h", "bit 7 does nothing without a fault", _reset_without_fault),
    Rule("CiA 402-2, 6041h", "bit 9 tells that 6040h is obeyed", _remote),
    Rule("CiA 402-2, 6041h", "no following error without power", _no_following_error),
    Rule("CiA 402-2, 6061h", "shows every mode of 6502h that 6060h is set to", _shown_modes),
    Rule("CiA 402-2, 6061h", "follows 6060h that came by PDO", _mode_by_pdo),
    Rule("CiA 402-2, 6060h", "a mode that is none is refused: 0609 003xh", _no_mode),
    Rule("CiA 402-2, 605Ah", "an option that is none is refused: 0609 003xh",
         _refused(Object.QUICK_STOP_OPTION, I16, NO_OPTION)),
    Rule("CiA 402-2, 6007h", "an option that is none is refused: 0609 003xh",
         _refused(Object.ABORT_CONNECTION_OPTION, I16, NO_OPTION)),
    Rule("CiA 402-2, 6085h", "no deceleration is refused: 0609 003xh",
         _refused(Object.QUICK_STOP_DECELERATION, U32, 0)),
    Rule("CiA 402-2, 6065h 6066h 607Dh", "windows and limits read as written", _kept_values),
    Rule("CiA 402-2, 6064h", "a joint that stands reads so", _standing),
    Rule("CiA 402-2, 6076h", "torques have a unit", _torque),
)  # fmt: skip


# --- Rules of the drive profile, CiA 402-2, that need power; the joint holds, and is asked no
# motion
#
# Setpoints are the drive's own position, at every SYNC.
_HELD_S: Final = 0.3
_ON, _ENABLED = DriveState.SWITCHED_ON, DriveState.OPERATION_ENABLED
_READY_AND_ON: Final = _walk(
    (Controlword.DISABLE_VOLTAGE, _OFF), (Controlword.SHUTDOWN, _READY),
    (Controlword.SWITCH_ON, _ON), (Controlword.ENABLE_OPERATION, _ENABLED),
)  # fmt: skip


def _enable(drive: TriedDrive) -> None:
    """Go to *Operation enabled* in CSP, with the drive's own position as the setpoint."""
    if OperationMode.CSP not in modes(drive):
        raise AbsentError("6502h has no CSP")
    drive.put(Object.MODE_OF_OPERATION, 0, I8, OperationMode.CSP)
    show(drive, OperationMode.CSP)
    here = drive.sdo.read(Object.POSITION_ACTUAL)
    drive.sdo.write(Object.TARGET_POSITION, 0, here)
    drive.nmt(NmtCommand.START)
    _READY_AND_ON(drive)


def _in_one_step(drive: TriedDrive) -> None:
    drive.go(Controlword.DISABLE_VOLTAGE, _OFF)
    drive.command(Controlword.ENABLE_OPERATION)
    drive.listen(0.1)
    if drive.state is not _OFF:
        raise BrokenError(f"Enable operation leads from Switch on disabled to {drive.state.name}")


def _quick_stop(drive: TriedDrive) -> None:
    _enable(drive)
    drive.put(Object.QUICK_STOP_OPTION, 0, I16, QuickStopOption.RAMP_THEN_DISABLE)
    drive.go(Controlword.QUICK_STOP, _OFF)


def _stays(drive: TriedDrive) -> None:
    _enable(drive)
    try:
        drive.put(Object.QUICK_STOP_OPTION, 0, I16, QuickStopOption.RAMP_AND_STAY)
    except SdoAbortError as error:
        raise AbsentError("605Ah = 6") from error
    drive.go(Controlword.QUICK_STOP, DriveState.QUICK_STOP_ACTIVE)
    drive.listen(_HELD_S)
    if drive.state is not DriveState.QUICK_STOP_ACTIVE:
        raise BrokenError(f"605Ah is 6, and the drive goes to {drive.state.name}")
    drive.go(Controlword.DISABLE_VOLTAGE, _OFF)


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
    drive.go(Controlword.DISABLE_VOLTAGE, _OFF)


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
    Rule("CiA 402-2, figure 3", "transitions 2 to 6 and 10",
         _walk((Controlword.SWITCH_ON, _ON), (Controlword.SHUTDOWN, _READY),
               (Controlword.SWITCH_ON, _ON), (Controlword.DISABLE_VOLTAGE, _OFF), enabled=True)),
    Rule("CiA 402-2, figure 3", "transition 8",
         _walk((Controlword.SHUTDOWN, _READY), enabled=True)),
    Rule("CiA 402-2, figure 3", "transition 9",
         _walk((Controlword.DISABLE_VOLTAGE, _OFF), enabled=True)),
    Rule("CiA 402-2, 605Ah", "2: transitions 11 and 12 after the ramp", _quick_stop),
    Rule("CiA 402-2, 605Ah", "6: stays in Quick stop active", _stays),
    Rule("CiA 402-2, 6061h", "shows the true mode in Operation enabled", _true_mode),
    Rule("CiA 402-2, 6062h 6064h", "enabling moves nothing", _holds),
)  # fmt: skip


# --- All rules tried on one drive, one after the other --------------------------------------------
#
# The drive stands, with its power off; nothing is asked to move. Rules that need power are
# tried only when the caller says so. After each rule the drive gets everything back that was
# written.


def rules(*, power: bool) -> tuple[Rule, ...]:
    """Return the rules that are tried, with those that need power or without."""
    return (*COMMUNICATION, *POWER_OFF, *(POWER_ON if power else ()))


def try_drive(fieldbus: Fieldbus, node: int, *, power: bool) -> Iterator[Finding]:
    """Try every rule on one node: an error where it is broken, a warning where it is absent.

    Raises `DeviceError` where another master is heard, the node does not answer, or is on.
    """
    subject = TriedDrive(fieldbus, node)
    listen_for_masters(fieldbus)
    try:
        state = subject.state
    except (BrokenError, FrameError) as error:
        raise DeviceError(f"node {node}: {error}") from error
    if state not in POWER_IS_OFF:
        raise DeviceError(f"node {node}: is in {state.name}: rules are tried on one that is off")
    subject.restart()
    for rule in rules(power=power):
        status, outcome, detail = Severity.OK, "kept", ""
        try:
            rule.judge(subject)
        except AbsentError as error:
            status, outcome, detail = Severity.WARN, "absent", str(error)
        except (BrokenError, DeviceError, FrameError) as error:
            status, outcome, detail = Severity.ERROR, "broken", str(error)
        finally:
            subject.put_back()
        text = f"{rule.promise}: {detail}" if detail else rule.promise
        yield Finding(rule.clause, status, text, {"outcome": outcome})


def profile(
    cell: Cell, joint: str, clock: Callable[[], float], *, power: bool
) -> Iterator[Finding]:
    """Try every rule on the drive of a joint, which stands. Raises `ConfigError`, `DeviceError`."""
    drives = {
        e.name: (e.bus, e.section.node) for e in cell.devices if isinstance(e.section, DriveSection)
    }
    if joint not in drives:
        raise ConfigError(f"{cell.path}: no drive moves {joint!r}; one of {', '.join(drives)}")
    bus, node = drives[joint]
    buses = open_buses(cell, clock)
    try:
        names = [config.name for config in cell.config.fieldbuses]
        yield from try_drive(buses[names.index(bus)], node, power=power)
    finally:
        buses.close()
