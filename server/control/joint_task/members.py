"""Results of a joint task in one tick: for each of its arms, and for all."""

from typing import NamedTuple

from ..arm.asking import ArmReading, Wanted
from ..grasps.held import Holding
from ..spatial import Array, Pose
from ..state import Inputs, Memory
from ..task.task import TaskMemory


class Member(NamedTuple):
    """One arm's part in a joint task in one tick."""

    memory: Memory
    inputs: Inputs
    """Its own, with the MRF where it sees it, and nothing that commands it alone."""
    seen: ArmReading
    wanted: Wanted
    give_way: Array
    """The twist (6,) of the MRF by which it gives way at its grasp, World axes."""
    holding: Holding

    def slowed(self, share: float, limit: str) -> "Member":
        """Return the same at a share of its speed, which a limit of that name left."""
        wanted = self.wanted._replace(
            dq=share * self.wanted.dq,
            scale=share * self.wanted.scale,
            limits=(*self.wanted.limits, limit),
        )
        return self._replace(wanted=wanted, give_way=share * self.give_way)


class Together(NamedTuple):
    """A joint task in one tick."""

    members: tuple[Member, ...]
    T_world_mrf: Pose
    """The mean of the arms' views."""
    shared: TaskMemory
    twists: dict[str, Array]
    twist: Array
    """The common twist (6,)."""
    share: float
    """Part of it that the tool's speed bounds allow, 0 to 1 [1]."""
    strained: str | None
    """`internal_force` or `internal_moment`: which is beyond its bound while the arms may move."""
    slipped: bool
    """The payload slipped out of a grasp."""
    grasps: Array
    """Where the grasps are, seen from the MRF (k, 3) [m]."""
    contact: Array | None
    """Wrench (6,) of the payload on what it touches, at and in the MRF; None when one is stale."""
    giving_way: float
    """Greatest relative speed of two grasps that force control asks for [m/s]."""
