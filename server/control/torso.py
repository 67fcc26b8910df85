"""Arms that stand on one torso: its joints are shared by their tools, and resolved first.

Of all rates that do what every tool is asked for, those of least weighted size are found in two
steps (Williams 1997, eq. 2, weighted; one system of torso and arms). With J_i the columns of arm
i's own joints, S_i those of the shared ones, t_i the twist that its tool is asked for and D the
shared joints' weights,

    least  |D⁻¹ q̇_s|² + Σ_i ( |q̇_i|² + |S_i q̇_s + J_i q̇_i − t_i|² / λ² )

is, for a given q̇_s, least in each arm for itself: what is left over for the arms costs
r_iᵀ M_i r_i with r_i = t_i − S_i q̇_s and M_i = (J_i J_iᵀ + λ² 1)⁻¹. So

    (D⁻² + Σ S_iᵀ M_i S_i) q̇_s = Σ S_iᵀ M_i t_i,

a system as small as the torso has joints, and then every arm answers r_i as one that stands alone,
with its own damping, limits and spare joints. Beside a singularity M_i is large along what the arm
cannot do any more: the torso does it. Rotations weigh a length, as they do in the arms.

An arm whose joints are commanded themselves, or that is led relative to its Base, asks nothing of
the torso and answers nothing. A torso that is commanded itself goes as told, the arms answer, and
of what they cannot do for their tools it takes back its part by the same system.
"""

from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from ...config.load import Cell
from .arm import Arm
from .axes import HeldAxes
from .barriers.rows import JointLimits
from .bodies.rates import ArmTick, Carrier
from .compiled import evolve
from .inputs import Inputs
from .mechanism.redundancy import shifted
from .scene import Index
from .spatial import NO_TWIST, Array, Pose, jacobian_at, nonzero, twist_at
from .state import ArmMemory
from .stop.limiter import Commanded

DAMPING: Final = 0.01
"""λ: what an arm is asked for and cannot do costs as much as its joints at this rate [m]."""

RESIDUE: Final = 1e-9
"""A twist below this is rounding [m/s, rad/s]."""

LED_BY_ARMS: Final = HeldAxes.of(np.zeros(6), Pose.identity().R, (0, 0))
"""Axes that the torso's own task holds while its arms lead it: none."""


class Share(NamedTuple):
    """What one arm asks of the joints that it shares."""

    S: Array
    """Columns (6, k) of the shared joints in its tool's Jacobian."""
    J: Array
    """Those of its own (6, n)."""
    twist: Array
    """Twist (6,) that its tool is asked for."""


def shared_rates(
    shares: Sequence[Share], weight: Array, low: Array, high: Array, length: float
) -> Array:
    """Return the rates (k,) of shared joints that serve all arms, see this module.

    Inside low ≤ 0 ≤ high (k,): of a joint that would go beyond, the others make up for the rest.
    `weight` (k,) are D, `length` weighs rotations [m/rad].
    """
    A, b = np.diag(1.0 / weight**2), np.zeros(len(weight))
    rows = np.array([1.0, 1.0, 1.0, length, length, length])
    for share in shares:
        S, J = rows[:, None] * share.S, rows[:, None] * share.J
        M_S = np.linalg.solve(J @ J.T + DAMPING**2 * np.eye(6), S)
        A += M_S.T @ S
        b += M_S.T @ (rows * share.twist)
    dq, free = np.zeros(len(weight)), np.ones(len(weight), dtype=bool)
    while free.any():
        dq[free] = np.linalg.solve(
            A[np.ix_(free, free)], b[free] - A[np.ix_(free, ~free)] @ dq[~free]
        )
        beyond = free & ((dq < low) | (dq > high))
        if not beyond.any():
            break
        dq[beyond] = np.clip(dq, low, high)[beyond]
        free &= ~beyond
    return dq


class Torso:
    """One mechanism that carries others, and these."""

    def __init__(self, tree: Index, arms: Sequence[Arm], joints: slice, weight: Array) -> None:
        """Build it; `tree` is its place among all `arms`, and those of what it carries.

        `joints` are its own among the cell's, `weight` (k,) their D.
        """
        self.tree, self._joints = tree, joints
        p = arms[int(tree[0])].p
        self._limits = JointLimits(p.joints, p.period_s)
        self._velocity, self._weight = p.joints.velocity, weight
        self._length = p.resolve.characteristic_length

    @classmethod
    def of_all(cls, cell: Cell, arms: Sequence[Arm], parts: Sequence[slice]) -> "tuple[Torso, ...]":
        """Build those of a cell; `parts` are where each arm's joints are."""
        carriers, found = cell.carriers, []
        for i in sorted(set(carriers) - {-1}):
            on = [i, *(arm for arm, under in enumerate(carriers) if under == i)]
            section, n = cell.parts[i].config.mechanism.torso, arms[i].p.joints.n
            weight = np.ones(n) if section is None else np.resize(section.weight, n)
            found.append(cls(np.array(on), arms, parts[i], weight))
        return tuple(found)

    def solve(
        self,
        arms: Sequence[Arm],
        memories: Sequence[ArmMemory],
        each: Sequence[Commanded],
        inputs: Sequence[Inputs],
    ) -> dict[int, ArmTick]:
        """Return what `Arm.solve` does of the torso and of all that it carries, by their places."""
        c, *on = self.tree.tolist()
        own = arms[c].solve(memories[c], each[c], inputs[c])
        k, dq = own.kinematics, each[c].motion.dq
        carrier = Carrier(self._joints, k.T_world_mrf.p, k.J, dq)
        asked = {i: arms[i].ask(memories[i], each[i], inputs[i], carrier) for i in on}
        if own.moving:
            twists = {i: tick.asked for i, tick in asked.items()}
            if own.by_joint or nonzero(own.twist):
                # What the arms cannot answer: the torso goes no further than their tools allow.
                answers = _answers(arms, asked, own.dq_asked)
                twists = {i: _left(twists[i], answers[i], own.dq_asked) for i in asked}
            else:
                own.held = LED_BY_ARMS
            own.dq_asked = own.dq_asked + self._shared(own, asked, twists)
        return {c: own, **_answers(arms, asked, own.dq_asked)}

    def _shared(
        self, own: ArmTick, asked: Mapping[int, ArmTick], twists: Mapping[int, Array]
    ) -> Array:
        """Return the rates (k,) of the torso's joints that serve tools' twists (6,) together."""
        each = [share_of(tick, twists[i]) for i, tick in asked.items()]
        shares = [share for share in each if share is not None]
        if not any(np.abs(share.twist).max() > RESIDUE for share in shares):
            return np.zeros(len(self._weight))
        most = own.inputs.settings.speed_factor * self._velocity
        room = self._limits.limits(own.commanded.motion.q)
        low, high = np.maximum(room.low, -most), np.minimum(room.high, most)
        return shared_rates(shares, self._weight, low, high, self._length)


def _left(twist: Array, answer: ArmTick, dq: Array) -> Array:
    """Return what an arm's answer leaves of its tool's twist (6,), with a torso's rates dq (k,)."""
    found = answer.found
    twist = shifted(twist, found.give_way)
    return np.asarray(twist - answer.below.J @ dq - answer.kinematics.J @ found.dq)


def _answers(arms: Sequence[Arm], asked: Mapping[int, ArmTick], dq: Array) -> dict[int, ArmTick]:
    """Return what arms ask of their joints while a torso's go at dq (k,)."""
    found = {i: evolve(tick) for i, tick in asked.items()}
    for i, tick in found.items():
        arms[i].answer(tick, tick.below.J @ dq if tick.led_in_world else NO_TWIST)
    return found


def share_of(tick: ArmTick, twist: Array) -> Share | None:
    """Return what an arm asks of joints below it, for a twist (6,) of its tool.

    None where that is not led in World. Taken at the point of the tool at which the arm is judged;
    axes that are free ask for nothing.
    """
    if not tick.led_in_world:
        return None
    J, S, held, lever = tick.kinematics.J, tick.below.J, tick.held, tick.lever
    if held is not None:
        return Share(held.keep @ S, held.keep @ J, held.part(twist))
    if not nonzero(lever):
        return Share(S, J, twist)
    return Share(jacobian_at(S, lever), jacobian_at(J, lever), twist_at(twist, lever))
