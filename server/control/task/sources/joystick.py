"""The operator's stick: rates, scaled by K_HC (Williams 1997, section 2.2).

Shaped in Cartesian acceleration and jerk before it enters the sum, so that the motion keeps its
direction when joints saturate; a stick that falls silent fades by the same bounds.
"""

from dataclasses import dataclass

import numpy as np

from ...spatial import Array, rotate_twist
from ...stop.trajectory import Motion, VelocityPlanner


@dataclass(frozen=True)
class JoystickState:
    """The shaped twist in World axes, before the gain, as a motion of six freedoms."""

    motion: Motion

    @staticmethod
    def idle() -> "JoystickState":
        """Return the state of a released stick."""
        return JoystickState(Motion(np.zeros(6), np.zeros(6), np.zeros(6)))


class Joystick:
    """Shapes the stick's twist; `acceleration` and `jerk` (6,) bound it."""

    def __init__(self, acceleration: Array, jerk: Array, period_s: float) -> None:
        self._planner = VelocityPlanner(acceleration, jerk)
        self._period_s = period_s

    def rate(
        self, state: JoystickState, twist: Array | None, R_world_axes: Array, gain: Array
    ) -> tuple[Array, JoystickState]:
        """Return the twist (6,) in World axes that the stick asks for.

        `twist` (6,) [m/s, rad/s] is in the axes that `R_world_axes` maps to World, None when the
        stream has expired; `gain` (6,) applies in the stick's own axes.
        """
        target = np.zeros(6) if twist is None else rotate_twist(R_world_axes, gain * twist)
        motion = state.motion
        if motion.stands() and not np.count_nonzero(target):
            return target, state
        shaped = self._planner.step(motion, target, self._period_s, synchronised=True)
        shaped = Motion(np.zeros(6), shaped.dq, shaped.ddq)
        return shaped.dq, JoystickState(shaped)
