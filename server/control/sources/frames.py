"""The motion of what motion is measured against, fed forward; and no jump when that changes.

Every source asks for a motion of the MRF relative to a *ground*: World, Base or Carrier. An arm on
Base makes it so by adding the ground's own twist, seen from Base, at the MRF: so a target on a
conveyor is followed without a steady error, and a tool keeps still in World above a base that
sways. It is one more term of the sum (Williams 1997, section 2: rates add), and leaves the others
as they are.

Whatever is redefined while the arm moves — the MRF, the CRF, the ground — makes the sum jump. What
it jumps by is owed: added, and paid back inside the acceleration and jerk bounds.
"""

from dataclasses import dataclass

import numpy as np

from ..frames import Array, Pose, cross
from ..trajectory import Motion, VelocityPlanner

Definition = tuple[Pose, int, str]
"""What the sum is about: the MRF in the Wrist, how often frames were redefined, the ground."""


@dataclass(frozen=True)
class FramesState:
    """What the last tick summed, and what is still owed."""

    definition: Definition | None = None
    """None while sources do not lead the arm."""
    total: Array | None = None
    """The last sum (6,), at the MRF of its time, World axes."""
    owed: Motion | None = None


class Frames:
    """Feeds the ground's motion forward; `acceleration`, `jerk` (6,) bound how debts are paid."""

    def __init__(self, acceleration: Array, jerk: Array, period_s: float) -> None:
        self._planner = VelocityPlanner(acceleration, jerk)
        self._period_s = period_s

    def rate(
        self,
        state: FramesState,
        others: Array,
        carried: Array | None,
        definition: Definition,
        R_world_wrist: Array,
    ) -> tuple[Array, FramesState]:
        """Return the twist (6,) of the MRF in World axes that is added to the sum of all `others`.

        `carried` (6,) is the ground's twist seen from Base, at the MRF; None where nothing moves.
        """
        owed = self._owed(state, others, carried, definition, R_world_wrist)
        twist = np.zeros(6) if carried is None else carried
        if owed is not None:
            twist = twist + owed.dq
        return twist, FramesState(definition, others + twist, owed)

    def _owed(
        self,
        state: FramesState,
        others: Array,
        carried: Array | None,
        definition: Definition,
        R_world_wrist: Array,
    ) -> Motion | None:
        before = state.definition
        if before is None or state.total is None:
            return None if carried is None else _debt(-carried)
        if before[1:] != definition[1:] or _differ(before[0], definition[0]):
            # The same motion of the rigid body, at the new MRF (eq. 1).
            lever = R_world_wrist @ (definition[0].p - before[0].p)
            total = state.total.copy()
            total[:3] += cross(total[3:], lever)
            return _debt(total - others - (0.0 if carried is None else carried))
        if state.owed is None:
            return None
        paid = self._planner.step(state.owed, np.zeros(6), self._period_s, synchronised=True)
        return None if paid.stands() else Motion(np.zeros(6), paid.dq, paid.ddq)


def _differ(a: Pose, b: Pose) -> bool:
    return a is not b and not (np.array_equal(a.p, b.p) and np.array_equal(a.R, b.R))


def _debt(twist: Array) -> Motion:
    return Motion(np.zeros(6), twist, np.zeros(6))
