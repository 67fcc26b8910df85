"""Forces at the grasps of one payload: what each arm is to exert, exerts, and gives way by.

Force control acts at each arm's *own grasp* and not at the shared MRF: with a lever p between them,
rotational accommodation at the MRF would add p² K_R to the translational gain at the grasp.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ....config.schema.joint_task import JointTaskSection
from ..arm.arm import Arm
from ..grasps.held import Held
from ..grasps.load_shares import greatest, internal, load_shares, total
from ..mechanism.wrist import WristMemory
from ..rigid_body import rotate_twist, twist_at
from ..scene import Flags
from ..spatial import Array, Pose
from ..state import Inputs, Intent
from ..task.bleed import bleed
from ..task.sources.force import ForceState, desired_wrench
from .weighing import weight_of

LEAST_SHARE = 4.0
"""Of lighter payloads nobody can tell whether they slipped [N]."""

EMPTY = 0.25
"""An arm that carries less than this part of its share carries nothing [1]."""

SLIPPED_S = 0.1
"""A payload has slipped when one arm carries nothing of it and the others all for so long [s]."""

STRAINS = ("internal_force", "internal_moment")
"""What is bounded of the wrenches at the grasps that move nothing."""

OTHERS = 0.75
"""The others carry its part when they carry more than this of the whole [1]."""


class Grasping(NamedTuple):
    """k grasps of one payload in one tick; wrenches (k, 6) in the axes of the MRF."""

    p: Array
    """Where they are, seen from the MRF (k, 3) [m]."""
    desired: Array
    """Each arm's share of the weight, and of the wrench that an operator asks for."""
    exerted: tuple[Array | None, ...]
    """Wrench that each exerts (6,), None when stale."""
    contact: Array | None
    """Wrench (6,) of the payload on what it touches, or that speeds it up; None without all."""
    internal_force: float | None
    """Greatest force that moves nothing, beyond what the shares mean [N]; None without all."""
    internal_moment: float | None
    """Greatest such moment [N·m]."""

    def off(self, i: int) -> Array | None:
        """Return by how much one arm exerts too little (6,); None when stale."""
        exerted = self.exerted[i]
        return None if exerted is None else self.desired[i] - exerted

    def twist_of(self, i: int, gain: Array, R_world_mrf: Array) -> Array:
        """Return the twist (6,) of one grasp that force control asks for, World axes.

        `gain` (6,) is K_F along the axes of the MRF (Williams 1997, section 2.5).
        """
        off = self.off(i)
        return np.zeros(6) if off is None else rotate_twist(R_world_mrf, gain * off)

    def to_mrf(self, i: int, twist: Array, R_world_mrf: Array) -> Array:
        """Return a twist (6,) of one grasp at the MRF, World axes."""
        return twist_at(twist, -(R_world_mrf @ self.p[i]))


def grasping(
    views: Sequence[Pose],
    tools: Sequence[Pose],
    felt: Sequence[Array | None],
    weights: Array,
    weight: Array,
    asked: Array,
) -> Grasping:
    """Return the forces at k grasps that hold a payload up and exert a wrench, at and in the MRF.

    `weight` (6,) holds it up, `asked` (6,) is what it is to exert; `views` are T_wrist_mrf, `tools`
    where each arm's grasp is in its Wrist, `felt` what each exerts (6,) at and in its grasp, None
    when stale; `weights` (k, 6) are the diagonals of W.
    """
    placed = [view.inverse() @ tool for view, tool in zip(views, tools, strict=True)]
    p = np.array([T.p for T in placed])
    exerted = tuple(
        None if h is None else rotate_twist(T.R, h) for T, h in zip(placed, felt, strict=True)
    )
    known = [h for h in exerted if h is not None]
    desired = load_shares(p, weights, weight + asked)
    if len(known) < len(exerted):
        return Grasping(p, desired, exerted, None, None, None)
    each = np.array(known)
    # Shares that are not equal are no strain: they are meant.
    strain = internal(p, each - desired)
    force, moment = greatest(strain[:, :3]), greatest(strain[:, 3:])
    return Grasping(p, desired, exerted, total(p, each) - weight, force, moment)


def without_load(forces: Grasping, up: Array) -> tuple[Flags, Flags]:
    """Return which of k arms carry next to nothing of the payload, and of which others carry that.

    Both are (k,); `up` (3,) is the vertical in the axes of the MRF. What a payload rests on takes
    load off the others, too: then nothing slipped. An arm whose sensor tells nothing may carry all:
    that saturates it.
    """
    meant = forces.desired[:, :3] @ up
    known = np.array([h is not None for h in forces.exerted])
    if not known.any() or meant.min() < LEAST_SHARE:
        nobody = np.zeros(len(meant), dtype=bool)
        return nobody, nobody
    carried = np.array([0.0 if h is None else float(h[:3] @ up) for h in forces.exerted])
    empty: Flags = known & (carried < EMPTY * meant)
    if not known.all():
        return empty, empty
    return empty, empty & ((carried.sum() - carried) > OTHERS * meant.sum())


def light_s(before_s: Sequence[float], forces: Grasping, up: Array, period_s: float) -> list[float]:
    """Return how long each arm has been without load [s], one period after `before_s`.

    A payload that slipped has not come back when the others lose it, too: they would go after their
    shares of nothing. It has when the arm carries its part.
    """
    empty, slips = (flags.tolist() for flags in without_load(forces, up))
    return [
        s + period_s if slips[i] or (empty[i] and s >= SLIPPED_S) else 0.0
        for i, s in enumerate(before_s)
    ]


class GivingWay:
    """Forces at the grasps of one joint task, and how each arm gives way to them."""

    def __init__(self, section: JointTaskSection, arms: Sequence[Arm]) -> None:
        """Build it for the arms that hold the payload."""
        self._wrists = tuple(arm.stages.wrist for arm in arms)
        self._tools = tuple(arm.p.T_wrist_tool for arm in arms)
        self._weights = np.array(section.shares or [(1.0,) * 6] * len(arms))
        self._mass = section.payload.mass
        self._moment = self._mass * np.array(section.payload.com)
        force = section.sources.force
        self._most = (section.most_internal, section.most_internal_moment)
        self._threshold, self._leash = force.hold_threshold, force.hold_leash
        # Of its bound, as much as of that of forces.
        self._threshold_moment = force.hold_threshold * self._most[1] / self._most[0]

    def forces(
        self,
        told: Inputs,
        views: Sequence[Pose],
        wrists: Sequence[WristMemory],
        T_payload_mrf: Pose,
        R_world_mrf: Array,
        extra: Array,
    ) -> Grasping:
        """Return the forces at the grasps of arms that see the MRF at `views` in their Wrists.

        `extra` (4,) is what the payload was found to weigh more than it was told.
        """
        felt = [
            own_wrist.wrench_mrf(memory, tool)
            for own_wrist, memory, tool in zip(self._wrists, wrists, self._tools, strict=True)
        ]
        mass, moment = self._mass + float(extra[0]), self._moment + extra[1:]
        weight = weight_of(mass, moment, T_payload_mrf, R_world_mrf)
        asked = desired_wrench(told.wrench_desired, told.R_world_wrench, R_world_mrf)
        return grasping(views, self._tools, felt, self._weights, weight, asked)

    def strained(self, forces: Grasping) -> str | None:
        """Return which bound the arms press each other beyond, None for none."""
        for name, size, most in zip(
            STRAINS, (forces.internal_force, forces.internal_moment), self._most, strict=True
        ):
            if size is not None and size > most:
                return name
        return None

    def twist(
        self,
        i: int,
        forces: Grasping,
        gain: Array,
        R_world_mrf: Array,
        intent: Intent,
        held: Held,
        at: Array,
    ) -> tuple[Array, ForceState]:
        """Return the twist (6,) at the MRF by which one arm gives way at its grasp.

        In HOLD only internal force and moment beyond a threshold are bled off, inside a leash from
        where the Wrist, now `at` (3,), was when HOLD began.
        """
        if intent is Intent.MOVE:
            twist = forces.twist_of(i, gain, R_world_mrf)
            return forces.to_mrf(i, twist, R_world_mrf), ForceState()
        if intent is not Intent.HOLD:
            return np.zeros(6), ForceState()
        began = at if held.force.hold is None else held.force.hold
        off = forces.off(i)
        bled = bleed(
            held.force.bleeding,
            None if off is None else -off,
            forces.twist_of(i, gain, R_world_mrf),
            at - began,
            self._threshold,
            self._leash,
            self._threshold_moment,
        )
        return forces.to_mrf(i, bled.twist, R_world_mrf), ForceState(began, bled.bleeding)
