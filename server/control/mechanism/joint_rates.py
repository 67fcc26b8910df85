"""The joint rates of one mechanism: a twist of its tool, and what its spare joints do beside.

It knows no sources: one twist goes in, whoever asked for it.
"""

from typing import NamedTuple

import numpy as np

from ....config.schema.cell import ResolveSection
from ..joints import Joints
from ..proximity.capsules import Placed
from ..rigid_body import jacobian_at, twist_at
from ..scene import Scene
from ..spatial import Array, Pose
from .kinematics import Kinematics
from .null_space.potential_field import Field, FieldReading, shifted
from .null_space.priority import Near, Priority
from .null_space.redundancy import ObjectiveGains, Redundancy, SelfMotion
from .resolution import resolve
from .singularity import Travel


class Wish(NamedTuple):
    """The motion that a mechanism is asked for."""

    twist: Array
    """Of its MRF, World axes (6,) [m/s, rad/s]."""
    lever: Array
    """From the MRF to the point of the tool at which singularities are judged (3,) [m]."""
    objectives: ObjectiveGains
    """Gains of the redundancy objectives."""
    speed_factor: float
    spare: bool
    """Spare joints may move."""
    off_path: Array | None
    """Where the virtual link has the tool off its path, in World (3,) [m]."""
    on_way: bool
    """The tool is led along a path, which the virtual link may let it leave."""


class Around(NamedTuple):
    """Surroundings of a mechanism."""

    scene: Scene | None
    near: Near | None
    """Obstacles near its control points; None in a cell without any."""
    T_world_base: Pose | None
    """Where a Base that moves is; None: Base stands."""
    placed: Placed | None
    """Its capsules at the commanded posture, where they are known already."""
    wrench: Array | None = None
    """Wrench that it exerts, at and in the MRF (6,) [N, N·m]; None where that is not known."""


class JointRates(NamedTuple):
    """Joint rates that do what a mechanism is asked for."""

    dq: Array
    """(n,) [rad/s]."""
    self_motion: SelfMotion
    sigma_min: float
    singular: bool
    """Damping or the bound of a singularity takes something off the twist."""
    field: FieldReading | None
    """The potential field; None where nothing follows it."""
    give_way: Array | None
    """Velocity along the virtual link (3,) [m/s]; None where it does not act."""


class Resolver:
    """Turns twists of one mechanism's tool into joint rates."""

    def __init__(
        self,
        joints: Joints,
        section: ResolveSection,
        rank: int,
        redundancy: Redundancy,
        field: Field,
        priority: Priority | None,
    ) -> None:
        """Build it; `rank` is how many axes the mechanism reaches anywhere."""
        self._joints, self._section, self._rank = joints, section, rank
        self._redundancy, self._field, self._priority = redundancy, field, priority

    def rates(self, q: Array, k: Kinematics, wish: Wish, around: Around) -> JointRates:
        """Return joint rates at the commanded posture q (n,) [rad], whose kinematics are `k`."""
        # A new MRF brings no singularity nearer: they are judged at the same point of the tool.
        lever = wish.lever
        elsewhere = np.count_nonzero(lever) > 0
        if elsewhere:
            there = Pose(k.T_world_mrf.R, k.T_world_mrf.p + lever)
            k = Kinematics(k.T_world_wrist, there, jacobian_at(k.J, lever))
        seen = None
        if wish.spare:
            seen = self._field.look(
                q, k, around.scene, wish.objectives, around.T_world_base, around.placed
            )
        give_way = self._field.give_way(seen, wish.off_path, wish.on_way, wish.speed_factor)
        asked = shifted(wish.twist, give_way)
        task = resolve(
            k.J,
            twist_at(asked, lever) if elsewhere else asked,
            self._section,
            Travel(q - self._joints.lower, self._joints.upper - q),
            self._rank,
        )
        dq, self_motion, felt = task.dq, self._redundancy.none(), None
        if wish.spare:
            downhill, felt = self._field.self_motion(seen, task.null)
            outside = {} if downhill is None else {"field": downhill}
            if self._priority is not None and around.near is not None:
                outside["spheres"] = self._priority.rates(around.near, task.null)
            self_motion = self._redundancy.rate(
                q, k.J, dq, task.null, wish.objectives, wish.speed_factor, outside
            )
            dq = dq + self_motion.dq
        return JointRates(dq, self_motion, task.sigma_min, task.singular, felt, give_way)
