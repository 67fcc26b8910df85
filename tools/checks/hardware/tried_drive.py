"""One real drive as rules try it: objects read, written and put back; what a rule is."""

import struct
from collections.abc import Callable
from typing import Final, NamedTuple

from ....drivers.canopen.sdo import SdoAbortError, SdoClient, named, wait_for
from ....drivers.device import DeviceError
from ....drivers.fieldbus import Fieldbus
from ....protocols.canopen import can301, cia402
from ....protocols.canopen.can301 import CommunicationObject as Com
from ....protocols.canopen.can301 import NmtCommand, NmtState
from ....protocols.canopen.cia402 import DriveState, Object

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
        self.command(cia402.Controlword.DISABLE_VOLTAGE)
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
