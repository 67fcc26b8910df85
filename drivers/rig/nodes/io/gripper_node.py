"""The simulated CiA 401 module with the gripper on one of its outputs, and what that holds."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Self, cast

from .....config.schema.bus.on_bus import Entry
from .....config.schema.mechanism.mechanism import GripperSection
from .....protocols.canopen.cia401 import KEEP, IoObject
from ..bench import Bench
from ..canopen.can_node import CanNode
from ..canopen.pdo import Pdo
from ..link import NodeLink

EDS = Path(__file__).resolve().parents[4] / "config" / "devices" / "simulated_output.eds"


class SimulatedGripper(CanNode):
    """Calls `grasp(closed)` whenever its output changes. `clock` gives physics time [s]."""

    def __init__(
        self,
        gripper: GripperSection,
        link: NodeLink,
        grasp: Callable[[bool], None],
        clock: Callable[[], float],
    ) -> None:
        super().__init__(gripper.node, link, clock, EDS)
        self._gripper = gripper
        self._grasp = grasp

    @classmethod
    def from_bench(cls, entry: Entry, bench: Bench) -> Self:
        """Make the module, whose output makes its arm take hold."""
        gripper = cast(GripperSection, entry.section)
        grasp = partial(bench.world.grasp, arm=entry.part or 0)
        return cls(gripper, bench.link(), grasp, bench.clock)

    @property
    def closed(self) -> bool:
        """Whether the output says that it is closed."""
        bit = self.objects[IoObject.WRITE_OUTPUT, 1] >> self._gripper.output & 1
        return bit == self._gripper.closed

    def on_reset(self, *, communication_only: bool) -> None:
        """All outputs are off after power-on."""
        if not communication_only:
            self._grasp(self.closed)

    def on_written(self, index: int, subindex: int, value: int) -> None:
        """Act at once on an output that is written over SDO."""
        self.objects[index, subindex] = value
        if index == IoObject.WRITE_OUTPUT:
            self._grasp(self.closed)

    def on_rpdo(self, _pdo: Pdo) -> None:
        """Act on the output's new value."""
        self._grasp(self.closed)

    def on_master_lost(self) -> None:
        """Keep the outputs, or take their error values (6206h, 6207h)."""
        mode = self.objects[IoObject.ERROR_MODE_OUTPUT, 1]
        if mode != KEEP:
            kept = self.objects[IoObject.WRITE_OUTPUT, 1] & ~mode
            value = self.objects[IoObject.ERROR_VALUE_OUTPUT, 1] & mode
            self.objects[IoObject.WRITE_OUTPUT, 1] = kept | value
            self._grasp(self.closed)
