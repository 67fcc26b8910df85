"""CiA 401 modules that are watched by their heartbeat: an enabling switch, a gripper."""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import can
from canopen.sdo.exceptions import SdoError

from ...config.schema.bus import EnablingSwitchSection
from ...config.schema.cell import TimingSection
from ...config.schema.mechanism import GripperSection
from ...protocols.canopen import can301, cia401
from ...protocols.canopen.can301 import PDO_INVALID, NmtState
from ...protocols.canopen.can301 import CommunicationObject as Com
from ..device import Cause, DeviceError, Peripheral, SwitchedOutput, Trouble, Value
from ..fieldbus import Fieldbus

# --- A CANopen node that is configured once and watched by its heartbeat, as I/O modules are ------

Write = tuple[int, int, str, int]
"""Index, sub-index, layout (struct) and value of an object that is written."""


class WatchedNode:
    """Configures a node without resetting it, and notices when it restarts or falls silent."""

    def __init__(
        self, name: str, node_id: int, fieldbus: Fieldbus, timing: TimingSection, eds: Path
    ) -> None:
        self.name, self.node_id = name, node_id
        self.state: NmtState | None = None
        self._bus, self._timing = fieldbus, timing
        self._node = fieldbus.add_node(node_id, eds, self._on_heartbeat)
        self._heard_s: float | None = None
        self._opened = self._restarted = False

    def open(self, *writes: Write) -> None:
        """Write heartbeat times and other objects, and start the node. Raises `DeviceError`."""
        self._opened = self._restarted = False
        timeout_ms = round(1000 * self._timing.heartbeat_timeout_s)
        watch = can301.consumer_heartbeat(can301.MASTER_NODE, timeout_ms)
        beat_ms = round(1000 * self._timing.heartbeat_period_s)
        self._write(Com.CONSUMER_HEARTBEAT, 1, "<I", watch)
        self._write(Com.PRODUCER_HEARTBEAT, 0, "<H", beat_ms)
        for write in writes:
            self._write(*write)
        try:
            self.start()
        except can.CanError as error:
            raise DeviceError(f"{self._who}: {error}") from error
        self._heard_s, self._opened = self._bus.now, True

    def start(self) -> None:
        """Tell the node to be *Operational*, as one that was alone for a while is not any more."""
        self._node.nmt.send_command(can301.NmtCommand.START)

    def close(self) -> None:
        """Watch the node no more."""
        self._opened = False

    @property
    def operational(self) -> bool:
        """True while it is open and says that it is *Operational*."""
        return self._opened and self.state is NmtState.OPERATIONAL

    def trouble(self) -> Trouble | None:
        """Return that it restarted or is silent, None while all is well or it is not open."""
        if not self._opened:
            return None
        values: dict[str, Value] = {"node": self.node_id}
        if self._restarted:
            return Trouble(Cause.NODE_RESTARTED, self.name, "the module restarted", values)
        silent_s = self._bus.now - (self._heard_s or 0.0)
        if silent_s > self._timing.heartbeat_timeout_s:
            detail = f"no heartbeat for {silent_s:.3f} s"
            return Trouble(Cause.HEARTBEAT_LOST, self.name, detail, values)
        return None

    @property
    def _who(self) -> str:
        return f"{self.name} (node {self.node_id})"

    def _on_heartbeat(self, state: int) -> None:
        self._heard_s = self._bus.now
        self.state = NmtState(state) if state in NmtState.__members__.values() else None
        self._restarted = self._restarted or (self._opened and state == NmtState.BOOT_UP)

    def _write(self, index: int, subindex: int, layout: str, value: int) -> None:
        try:
            self._node.sdo.download(index, subindex, struct.pack(layout, value))
        except (SdoError, can.CanError) as error:
            raise DeviceError(f"{self._who}: writing {index:04X}h:{subindex}: {error}") from error


# --- An enabling switch on digital inputs of a CiA 401 module -------------------------------------

MOST_MISSED_SYNCS: Final = 3
"""A switch that left more SYNCs than this unanswered counts as released."""
EVERY_SYNC: Final = 1


@dataclass(frozen=True, slots=True)
class SwitchReading:
    """Newest answer of the module. Until its first one it is not `ready`, and not held."""

    ready: bool
    held: bool
    trouble: Trouble | None


class EnablingInput(Peripheral):
    """Lets the arm move only while the switch is held; keeps the contract of `device.py`.

    The module answers every SYNC with its inputs, so that a broken wire is noticed within a few
    periods and not by a heartbeat.
    """

    def __init__(
        self,
        fieldbus: Fieldbus,
        switch: EnablingSwitchSection,
        timing: TimingSection,
        eds: Path,
        name: str,
    ) -> None:
        self.name, self.bus = name, fieldbus.name
        self._bus, self._id = fieldbus, switch.node
        self._node = WatchedNode(name, switch.node, fieldbus, timing, eds)
        self._mask = sum(1 << bit for bit in set(switch.inputs))
        self._inputs: int | None = None
        self._answered_sync = 0
        fieldbus.listen(can301.tpdo1_id(switch.node), self._on_inputs)

    def open(self) -> None:
        """Let the module answer every SYNC, and start it. Blocks; raises `DeviceError`."""
        pdo, cob_id = Com.TPDO_COMMUNICATION, can301.tpdo1_id(self._id)
        self._bus.expect_no_answers(cob_id)
        self._node.open(
            (pdo, 1, "<I", cob_id | PDO_INVALID),
            (pdo, 2, "<B", EVERY_SYNC),
            (pdo, 1, "<I", cob_id),
        )
        self._bus.expect_answers(cob_id)
        self._inputs, self._answered_sync = None, self._bus.sync_count

    def read(self) -> SwitchReading:
        """Return the newest answer, and what is wrong with the module."""
        ready = self._node.operational and self._inputs is not None and not self._silent
        return SwitchReading(ready, self._held, self._node.trouble())

    def stop(self) -> None:
        """Do nothing: a switch moves nothing."""

    def close(self) -> None:
        """Watch the module no more. Never raises."""
        self._node.close()
        self._bus.expect_no_answers(can301.tpdo1_id(self._id))
        self._inputs = None

    def interlock(self) -> str | None:
        """Return why the arm may not move: released or silent; None while the switch is held."""
        if self._silent:
            return f"{self.name} silent"
        return None if self._held else f"{self.name} released"

    def values(self) -> dict[str, Value]:
        """Return whether it is held."""
        return {"held": self._held}

    @property
    def _silent(self) -> bool:
        return self._bus.sync_count - self._answered_sync > MOST_MISSED_SYNCS

    @property
    def _held(self) -> bool:
        inputs = self._inputs
        return inputs is not None and not self._silent and inputs & self._mask == self._mask

    def _on_inputs(self, data: bytes, _stamp: float) -> None:
        self._inputs = cia401.unpack_inputs(data)
        self._answered_sync = self._bus.sync_count


# --- A gripper on a digital output of a CiA 401 module --------------------------------------------

REPEAT: Final = 10
"""The output is sent when it changes, and again every so many writes: frames can be lost [1]."""


@dataclass(frozen=True, slots=True)
class GripperReading:
    """Last status of the module. It does not tell its outputs: nothing here says *closed*."""

    ready: bool
    state: NmtState | None
    trouble: Trouble | None


class GripperOutput(SwitchedOutput):
    """Switches the gripper's output; keeps the contract of `device.py`.

    Nothing is sent before the first `write`, and the module is not reset: a gripper that holds
    something when the daemon starts goes on holding it. If the daemon is lost, it does so too
    (6206h).
    """

    def __init__(
        self,
        fieldbus: Fieldbus,
        gripper: GripperSection,
        timing: TimingSection,
        eds: Path,
        name: str = "gripper",
    ) -> None:
        self.name, self.bus, self.gripper = name, fieldbus.name, gripper
        self._bus = fieldbus
        self._node = WatchedNode(self.name, gripper.node, fieldbus, timing, eds)
        self._mask = 1 << gripper.output
        self._bits: int | None = None
        self._repeat = 0

    def open(self) -> None:
        """Configure the module and start it. Blocks; raises `DeviceError`."""
        self._node.open((cia401.IoObject.ERROR_MODE_OUTPUT, 1, "<B", cia401.KEEP))
        self._repeat = 0

    def read(self) -> GripperReading:
        """Return what the module last said, and what is wrong with it."""
        node = self._node
        return GripperReading(node.operational, node.state, node.trouble())

    def write(self, command: bool) -> bool:
        """Close (true) or open the gripper, now and again; return what was commanded."""
        bits = self._mask if command == bool(self.gripper.closed) else 0
        if bits != self._bits or self._repeat == 0:
            self._bits, self._repeat = bits, REPEAT
            self._bus.send(can301.rpdo1_id(self.gripper.node), cia401.pack_outputs(bits))
        self._repeat -= 1
        return command

    def stop(self) -> None:
        """Do nothing: what is held is held on while the arm stops."""

    def close(self) -> None:
        """Let go of the module, not of what is held. Never raises."""
        self._node.close()
