"""The simulated CiA 401 module that an enabling switch is wired to."""

from collections.abc import Callable
from pathlib import Path
from typing import Self, cast

from .....config.schema.bus.enabling import EnablingSwitchSection
from .....config.schema.bus.on_bus import Entry
from .....protocols.canopen.cia401 import IoObject
from .....protocols.messages.rig import RigFault
from ..bench import Bench
from ..canopen.can_node import CanNode
from ..link import NodeLink

EDS = Path(__file__).resolve().parents[4] / "config" / "devices" / "simulated_input.eds"


class SimulatedSwitch(CanNode):
    """Held from the start; the fault `push` releases it (`on = false`) and holds it again.

    With a `value` only the contacts in that bit mask are on: a broken wire, a welded contact.
    """

    def __init__(
        self, switch: EnablingSwitchSection, link: NodeLink, clock: Callable[[], float]
    ) -> None:
        super().__init__(switch.node, link, clock, EDS)
        self._all = sum(1 << bit for bit in set(switch.inputs))
        self.contacts = self._all
        self.objects.live[IoObject.READ_INPUT, 1] = lambda: self.contacts

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
