"""A gripper on a digital output of a CiA 401 module."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from ...config.schema.cell import TimingSection
from ...config.schema.mechanism.mechanism import GripperSection
from ...protocols.canopen import can301, cia401
from ...protocols.canopen.can301 import NmtState
from ..device import Trouble
from ..fieldbus import Fieldbus
from ..roles import SwitchedOutput
from .watched_node import WatchedNode

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
