"""A gripper on a digital output of a CiA 401 module."""

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import can
import canopen
from canopen.sdo.exceptions import SdoError

from ..config.schema.cell import Timing
from ..config.schema.mechanism import Gripper
from ..protocols.canopen import can301, cia401
from ..protocols.canopen.can301 import CommunicationObject as Com
from ..protocols.canopen.can301 import NmtState
from .device import Cause, DeviceError, Trouble, Value
from .fieldbus import Fieldbus
from .roles import Output

REPEAT: Final = 10
"""The output is sent when it changes, and again every so many writes: frames can be lost [1]."""


@dataclass(frozen=True, slots=True)
class GripperReading:
    """What the module last said. It does not tell its outputs: nothing here says *closed*."""

    ready: bool
    state: NmtState | None
    trouble: Trouble | None


class GripperOutput(Output):
    """Switches the gripper's output; keeps the contract of `device.py`.

    Nothing is sent before the first `write`, and the module is not reset: a gripper that holds
    something when the daemon starts goes on holding it. If the daemon is lost, it does so too
    (6206h).
    """

    def __init__(self, fieldbus: Fieldbus, gripper: Gripper, timing: Timing, eds: Path) -> None:
        self.name, self.gripper = "gripper", gripper
        self._bus, self.bus, self._timing = fieldbus, fieldbus.name, timing
        dictionary = canopen.import_od(str(eds), gripper.node)
        self._node = fieldbus.add_node(gripper.node, dictionary)
        self._node.nmt.add_heartbeat_callback(self._on_heartbeat)
        self._mask = 1 << gripper.output
        self._heard_s: float | None = None
        self._state: NmtState | None = None
        self._opened = self._restarted = False
        self._bits: int | None = None
        self._repeat = 0

    def open(self) -> None:
        """Configure the module and start it. Blocks; raises `DeviceError`."""
        self._opened = self._restarted = False
        timeout_ms = round(1000 * self._timing.heartbeat_timeout_s)
        watch = can301.consumer_heartbeat(can301.MASTER_NODE, timeout_ms)
        beat_ms = round(1000 * self._timing.heartbeat_period_s)
        self._write(Com.CONSUMER_HEARTBEAT, 1, "<I", watch)
        self._write(Com.PRODUCER_HEARTBEAT, 0, "<H", beat_ms)
        self._write(cia401.Object.ERROR_MODE_OUTPUT, 1, "<B", cia401.KEEP)
        try:
            self._node.nmt.send_command(can301.NmtCommand.START)
        except can.CanError as error:
            raise DeviceError(f"{self._who}: {error}") from error
        self._heard_s, self._opened, self._repeat = self._bus.now, True, 0

    def read(self) -> GripperReading:
        """Return what the module last said, and what is wrong with it."""
        return GripperReading(
            ready=self._opened and self._state is NmtState.OPERATIONAL,
            state=self._state,
            trouble=self._judge(),
        )

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
        self._opened = False

    @property
    def _who(self) -> str:
        return f"{self.name} (node {self.gripper.node})"

    def _judge(self) -> Trouble | None:
        if not self._opened:
            return None
        values: dict[str, Value] = {"node": self.gripper.node}
        if self._restarted:
            return Trouble(Cause.NODE_RESTARTED, self.name, "the module restarted", values)
        silent_s = self._bus.now - (self._heard_s or 0.0)
        if silent_s > self._timing.heartbeat_timeout_s:
            detail = f"no heartbeat for {silent_s:.3f} s"
            return Trouble(Cause.HEARTBEAT_LOST, self.name, detail, values)
        return None

    def _on_heartbeat(self, state: int) -> None:
        self._heard_s = self._bus.now
        self._state = NmtState(state) if state in NmtState.__members__.values() else None
        self._restarted = self._restarted or (self._opened and state == NmtState.BOOT_UP)

    def _write(self, index: int, subindex: int, layout: str, value: int) -> None:
        try:
            self._node.sdo.download(index, subindex, struct.pack(layout, value))
        except (SdoError, can.CanError) as error:
            raise DeviceError(f"{self._who}: writing {index:04X}h:{subindex}: {error}") from error
