"""Parts that simulated nodes are made of: physics, connection, random generators."""

from collections.abc import Callable

import numpy as np

from ....config.load import Cell
from ....config.schema.rig.rig import Rig
from ..physics.world import World
from .drive_loops import DriveLoops
from .link import NodeLink, Sender


class Bench:
    """Gives every node of a cell its parts; random generators are dealt in the order of asking."""

    def __init__(
        self, cell: Cell, rig: Rig, world: World, loop: DriveLoops, clock: Callable[[], float]
    ) -> None:
        self.rig, self.world, self.loop, self.clock = rig, world, loop, clock
        self.wire: Sender
        """Bus of the node that is being made."""
        self._joints = {drive.joint: i for i, drive in enumerate(cell.config.mechanism.drives)}
        self._seeds = np.random.SeedSequence(rig.seed)

    def joint(self, name: str) -> int:
        """Return a joint's place in `loop` and `world`."""
        return self._joints[name]

    def rng(self) -> np.random.Generator:
        """Return a random generator of its own."""
        return np.random.default_rng(self._seeds.spawn(1)[0])

    def link(self) -> NodeLink:
        """Return the node's connection to its bus."""
        return NodeLink(self.wire, self.clock, self.rng())
