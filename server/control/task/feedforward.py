"""The motion of what motion is measured against, fed forward; and no jump when that changes.

Every source asks for a motion of the MRF relative to a *ground*: World, Base or Carrier. An arm on
Base makes it so by adding the ground's own twist, seen from Base, at the MRF: so a target on a
conveyor is followed without a steady error, and a tool keeps still in World above a base that
sways. It is one more term of the sum (Williams 1997, section 2: rates add), and leaves the others
as they are.

What sources remember is carried to a new MRF (`Source.carry`). The rest of a redefinition, such as
a gain that acts along other axes, or another ground, makes the sum jump while the arm moves. What
it jumps by (`Source.jump`) is owed: added, and paid back inside the acceleration and jerk bounds.
No more is ever owed than the tool's greatest speed, so that it is soon paid, however often frames
change.
"""

from typing import Final, NamedTuple

import numpy as np

from ..rigid_body import twist_at, within
from ..spatial import Array
from ..stop.motion import Motion
from ..stop.trajectory import VelocityPlanner
from .source import NO_TWIST


class FeedforwardState(NamedTuple):
    """The motion that is still owed."""

    leading: bool = False
    """Sources led the arm in the last tick."""
    owed: Motion | None = None
    """At a point of the tool that stays the same, World axes (6,)."""


NOT_LED: Final = FeedforwardState()
"""No source leads the arm."""
_LED: Final = FeedforwardState(True)
"""Sources lead the arm, and nothing is owed."""


class Feedforward:
    """Feeds the ground's motion forward; `acceleration`, `jerk` (6,) bound how debts are paid.

    No more is owed than a twist of `most` [m/s], [rad/s].
    """

    def __init__(
        self, acceleration: Array, jerk: Array, most: tuple[float, float], period_s: float
    ) -> None:
        self._planner = VelocityPlanner(acceleration, jerk)
        self._most = most
        self._period_s = period_s

    def rate(
        self, state: FeedforwardState, carried: Array | None, jump: Array | None, lever: Array
    ) -> tuple[Array, FeedforwardState]:
        """Return the twist (6,) of the MRF in World axes that is added to the sources' sum.

        `carried` (6,) is the ground's twist seen from Base, at the MRF; None where nothing moves.
        `jump` (6,) is what all was more before a redefinition, of sources and ground together.
        `lever` (3,) leads from the MRF to the point of the tool at which debts are kept [m].
        """
        owed = state.owed
        if not state.leading:
            owed = None
            jump = None if carried is None else -carried
        elif owed is not None:
            owed = self._planner.step(owed, np.zeros(6), self._period_s, synchronised=True)
            owed = None if owed.stands() else Motion(np.zeros(6), owed.dq, owed.ddq)
        if jump is not None:
            already, ddq = (np.zeros(6), np.zeros(6)) if owed is None else owed[1:]
            more = within(already + twist_at(jump, lever), self._most)
            owed = Motion(np.zeros(6), more, ddq)
        twist = NO_TWIST if carried is None else carried
        if owed is None:
            return twist, _LED
        return twist + twist_at(owed.dq, -lever), FeedforwardState(True, owed)
