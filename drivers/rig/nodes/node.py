"""The contract of simulated devices, by which the rig boots, steps and disturbs them."""

from typing import Protocol, Self

from ....config.schema.bus.on_bus import Entry
from ....protocols.messages.rig import RigFault
from .bench import Bench
from .link import NodeLink


class Node(Protocol):
    """One simulated device on a bus."""

    link: NodeLink
    due_s: float
    """Physics time at which `tick` has something to do next [s]."""
    samples_after_step: bool
    """`tick` comes after the physics of a step, not before it."""

    @classmethod
    def from_bench(cls, entry: Entry, bench: Bench) -> Self:
        """Make the node of a device with the parts that the bench gives."""
        ...

    def identifiers(self) -> tuple[int, ...]:
        """Return the CAN identifiers that it hears."""
        ...

    def boot(self) -> None:
        """Go through power-on."""
        ...

    def tick(self) -> None:
        """Do what is due at this physics time."""
        ...

    def inject(self, fault: RigFault) -> None:
        """Apply a fault of the device itself, or take it back.

        Raises `ValueError`, in one line, for a fault that such a device does not have.
        """
        ...
