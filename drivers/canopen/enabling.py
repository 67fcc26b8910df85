"""An enabling switch on digital inputs of a CiA 401 module."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ...config.schema.bus.enabling import EnablingSwitchSection
from ...config.schema.cell import TimingSection
from ...protocols.canopen import can301, cia401
from ...protocols.canopen.can301 import PDO_INVALID
from ...protocols.canopen.can301 import CommunicationObject as Com
from ..device import Device, Trouble, Value
from ..fieldbus import Fieldbus
from .watched_node import WatchedNode

MOST_MISSED_SYNCS: Final = 3
"""A switch that left more SYNCs than this unanswered counts as released."""
EVERY_SYNC: Final = 1


@dataclass(frozen=True, slots=True)
class SwitchReading:
    """Newest answer of the module. Until its first one it is not `ready`, and not held."""

    ready: bool
    held: bool
    trouble: Trouble | None


class EnablingInput(Device):
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
