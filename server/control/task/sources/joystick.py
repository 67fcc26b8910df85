"""The operator's stick: rates, scaled by K_HC (Williams 1997, section 2.2).

Shaped in Cartesian acceleration and jerk before it enters the sum, so that the motion keeps its
direction when joints saturate. A stick that is released or falls silent may come to rest more
quickly than it set out.
"""

from typing import Final, NamedTuple

import numpy as np

from .....config.schema.sources.joystick import JoystickSection
from ...rigid_body import motion_at, rotate_twist
from ...spatial import Array
from ...stop.motion import Motion
from ...stop.trajectory import VelocityPlanner
from ..source import NO_TWIST, Context, Redefined, Shaping, Source


class JoystickState(NamedTuple):
    """The shaped twist in World axes, before the gain, as a motion of six freedoms."""

    motion: Motion

    @staticmethod
    def idle() -> "JoystickState":
        """Return the state of a released stick."""
        return _RELEASED


_RELEASED: Final = JoystickState(Motion(NO_TWIST, NO_TWIST, NO_TWIST))


class Joystick(Source[JoystickState]):
    """Shapes the stick's twist inside acceleration and jerk bounds."""

    def __init__(self, section: JoystickSection, shaping: Shaping) -> None:
        self._shaping = shaping
        self._planner = self._braking = VelocityPlanner(shaping.acceleration, shaping.jerk)
        quicker = section.braking
        if quicker != 1.0:
            # Time scaled down: the same way to rest, so many times as quickly.
            self._braking = VelocityPlanner(
                quicker * shaping.acceleration, quicker**2 * shaping.jerk
            )

    def idle(self) -> JoystickState:
        """Return the state of a released stick."""
        return _RELEASED

    def rate(
        self, context: Context, state: JoystickState, gain: Array
    ) -> tuple[Array, JoystickState]:
        """Return the shaped twist; `gain` (6,) applies in the stick's own axes [1]."""
        stick, target = context.asked.stick, NO_TWIST
        if not context.moving:
            stick, state = None, _RELEASED
        if stick is not None:
            target = rotate_twist(stick.R_world_axes, gain * stick.twist)
        planner = self._planner if np.count_nonzero(target) else self._braking
        shaped = planner.shape(state.motion, target, self._shaping.period_s)
        if shaped is state.motion:
            return NO_TWIST, state
        return shaped.dq, JoystickState(shaped)

    def carry(self, state: JoystickState, context: Context, redefined: Redefined) -> JoystickState:
        """Return the state with the same motion of the rigid body, told at the MRF of now."""
        if redefined.lever is None:
            return state
        most, acceleration = self._shaping.most, self._shaping.acceleration
        return JoystickState(motion_at(state.motion, redefined.lever, most, acceleration))
