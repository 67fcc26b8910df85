"""A CANopen node that is configured once and watched by its heartbeat, as I/O modules are."""

import struct
from pathlib import Path

import can
from canopen.sdo.exceptions import SdoError

from ...config.schema.cell import TimingSection
from ...protocols.canopen import can301
from ...protocols.canopen.can301 import CommunicationObject as Com
from ...protocols.canopen.can301 import NmtState
from ..device import Cause, DeviceError, Trouble, Value
from ..fieldbus import Fieldbus

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
        self._node = fieldbus.add_node(node_id, eds)
        self._node.nmt.add_heartbeat_callback(self._on_heartbeat)
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
            self._node.nmt.send_command(can301.NmtCommand.START)
        except can.CanError as error:
            raise DeviceError(f"{self._who}: {error}") from error
        self._heard_s, self._opened = self._bus.now, True

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
