"""The simulated CiA 401 modules: of an enabling switch, of a gripper."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Self, cast

from ....config.schema.bus import EnablingSwitchSection, Entry
from ....config.schema.mechanism import GripperSection
from ....protocols.canopen.cia401 import KEEP, IoObject
from ....protocols.messages.rig import RigFault
from .canopen import CanNode, Pdo
from .node import Bench, NodeLink

# --- The simulated CiA 401 module that an enabling switch is wired to -----------------------------

INPUT_EDS = Path(__file__).resolve().parents[3] / "config" / "devices" / "simulated_input.eds"


class SimulatedSwitch(CanNode):
    """Held from the start; the fault `push` releases it (`on = false`) and holds it again.

    With a `value` only the contacts in that bit mask are on: a broken wire, a welded contact.
    """

    def __init__(
        self, switch: EnablingSwitchSection, link: NodeLink, clock: Callable[[], float]
    ) -> None:
        super().__init__(switch.node, link, clock, INPUT_EDS)
        self._all = sum(1 << bit for bit in set(switch.inputs))
        self.contacts = self._all
        self.objects.measured[IoObject.READ_INPUT, 1] = lambda: self.contacts

    @classmethod
    def from_bench(cls, entry: Entry, bench: Bench) -> Self:
        """Make the switch in the operator's hand."""
        return cls(cast(EnablingSwitchSection, entry.section), bench.link(), bench.clock)

    def inject(self, fault: RigFault) -> None:
        """Hold or release the switch. Raises `ValueError` for other faults."""
        if fault.kind != "push":
            raise ValueError(f"fault {fault.kind}: a switch can only be pushed")
        mask = self._all if fault.value is None else round(fault.value) & self._all
        self.contacts = mask if fault.on else 0


# --- The simulated CiA 401 module with the gripper on one of its outputs, and what that holds -----

OUTPUT_EDS = Path(__file__).resolve().parents[3] / "config" / "devices" / "simulated_output.eds"


class SimulatedGripper(CanNode):
    """Calls `grasp(closed)` whenever its output changes. `clock` gives physics time [s]."""

    def __init__(
        self,
        gripper: GripperSection,
        link: NodeLink,
        grasp: Callable[[bool], None],
        clock: Callable[[], float],
    ) -> None:
        super().__init__(gripper.node, link, clock, OUTPUT_EDS)
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
