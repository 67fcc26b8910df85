"""Parts that simulated nodes are made of: physics, connection, random generators."""

from collections.abc import Callable, Sequence

import numpy as np

from ....config.schema.bus.on_bus import Entry
from ....config.schema.rig.rig import RigSection
from ..physics.world import World
from .drive_loops import DriveLoops
from .link import NodeLink, Sender


class Bench:
    """Gives every node of a cell its parts; random generators are dealt in the order of asking."""

    def __init__(
        self,
        rigs: Sequence[RigSection],
        joints: Sequence[str],
        world: World,
        loop: DriveLoops,
        clock: Callable[[], float],
    ) -> None:
        """Take what the cell says of each mechanism's hardware, and the names of all joints."""
        self.world, self.loop, self.clock = world, loop, clock
        self.wire: Sender
        """Bus of the node that is being made."""
        self._rigs = tuple(rigs)
        self._joints = {name: i for i, name in enumerate(joints)}
        self._seeds = np.random.SeedSequence(rigs[0].seed)

    def rig(self, entry: Entry) -> RigSection:
        """Return what the cell says of the hardware of a device's mechanism."""
        return self._rigs[entry.part or 0]

    def joint(self, entry: Entry) -> int:
        """Return the place of a drive's joint in `loop` and `world`."""
        return self._joints[entry.name]

    def rng(self) -> np.random.Generator:
        """Return a random generator of its own."""
        return np.random.default_rng(self._seeds.spawn(1)[0])

    def link(self) -> NodeLink:
        """Return the node's connection to its bus."""
        return NodeLink(self.wire, self.clock, self.rng())
