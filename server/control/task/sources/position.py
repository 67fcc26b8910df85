"""Target poses (Williams 1997, section 2.3): a jerk-limited path, followed with error feedback.

The path leads straight from where the MRF is to the target, the rotation along the geodesic; the
rate is the path's own plus K_P times the pose error, rotation by logarithm. The path slows as the
arm is held back, so that limits slow a motion without bending it; it leads on where the tool
slides along a barrier, so that it comes out behind it; and it does not care how far a stick pushes
the tool aside: on release the error feedback brings it home. Routes, timed twists and a master's
pose are followed by the same law: only the path differs.
"""

import math

import numpy as np

from .....config.schema.sources.position import PositionSection
from ...compiled import MATRIX, ROW, VECTOR, compiled
from ...rigid_body import differ, motion_at, rotate_twist, twist_at
from ...spatial import Array, Pose, pose_error
from ...stop.motion import Motion
from ..asked import Asked
from ..paths.free import Free
from ..paths.goals import Goal
from ..paths.leading import NO_GOAL, Leader, PositionState, within_bounds
from ..paths.straight import Path
from ..source import NO_TWIST, Context, Granted, Redefined, Shaping, Source

FULL_FEED_FORWARD = 0.5
"""Gain from which the path's own rate is passed on in full [1/s]; below, in proportion."""

CAUGHT_UP = (5e-3, 2e-2)
"""A tool that slid off its path is on it again within this distance [m] and angle [rad]."""


class Position(Source[PositionState]):
    """Follows goals; the section's speeds and the task's shaping bound its paths.

    It leads the point of the tool that the goal was ordered for, on the ground that the goal was
    placed on, so that no MRF of now is the path's.
    """

    def __init__(self, section: PositionSection, shaping: Shaping) -> None:
        self._speed = np.array([section.speed] * 3 + [section.angular_speed] * 3)
        self._most, self._acceleration = shaping.most, shaping.acceleration
        self._leader = Leader(self._speed, shaping.acceleration, shaping.jerk, shaping.period_s)

    def idle(self) -> PositionState:
        """Return the state without a goal."""
        return NO_GOAL

    def rate(
        self, context: Context, state: PositionState, gain: Array
    ) -> tuple[Array, PositionState]:
        """Return the twist that leads along the path to the goal.

        `gain` (6,) is K_P [1/s], per axis of the CRF; an axis of gain zero is left to the other
        sources.
        """
        return self._rate(context, state, gain, context.asked.T_world_crf.R)

    def advance(self, state: PositionState, granted: Granted) -> PositionState:
        """Return the state with the path moved on by what was granted of a period."""
        return self._leader.advance(state, granted.pace, granted.slid)

    def carry(self, state: PositionState, context: Context, redefined: Redefined) -> PositionState:
        """Return the state with a steered reference told at the point of the tool led now."""
        free, before, point = state.path, redefined.before.T_wrist_goal, context.asked.T_wrist_goal
        if not isinstance(free, Free) or not differ(point, before):
            return state
        pose = free.pose @ (before.inverse() @ point)
        now = Motion(np.zeros(6), free.twist, free.acceleration)
        now = motion_at(now, pose.p - free.pose.p, self._most, self._acceleration)
        return state._replace(path=free._replace(pose=pose, twist=now.dq, acceleration=now.ddq))

    def jump(
        self,
        context: Context,
        redefined: Redefined,
        state: PositionState,
        gain: Array,
        twist: Array,
    ) -> Array | None:
        """Return what a goal on another ground, or K_P along other axes, takes off the rate."""
        before, goal = redefined.before, context.asked.goal
        if redefined.grounded and context.carried is not None:
            if before.serial == (None if goal is None else goal.serial):
                return None
            return twist_at(before.twists["position"], redefined.way) - twist
        axes = before.R_world_crf
        if goal is None or np.array_equal(axes, context.asked.T_world_crf.R):
            return None
        return self._rate(context, state, gain, axes)[0] - twist

    def _rate(
        self, context: Context, state: PositionState, gain: Array, axes: Array
    ) -> tuple[Array, PositionState]:
        """Return the twist of the MRF and the next state; `axes` (3, 3) are the gains' in World."""
        asked, goal, ground = context.asked, context.asked.goal, context.ground
        if goal is None:
            return NO_TWIST, NO_GOAL
        T, twist, lever = context.T_world_mrf, context.twist, None
        if context.carried is not None:
            twist = twist - context.carried
        if differ(asked.T_wrist_goal, asked.T_wrist_mrf):
            T = context.T_world_wrist @ asked.T_wrist_goal
            lever = T.p - context.T_world_mrf.p
            twist = twist_at(twist, lever)
        if context.off_path is not None:
            T = Pose(T.R, T.p - context.off_path)  # without the virtual link: it is held there
        if ground is not None:
            there = ground.T.R.T
            T, axes = ground.T.inverse() @ T, there @ axes
            twist = rotate_twist(there, twist)
        rate, state = self._led(state, goal, T, twist, gain, axes, asked)
        rate = rate if ground is None else rotate_twist(ground.T.R, rate)
        return (rate if lever is None else twist_at(rate, -lever)), state

    def _led(
        self,
        state: PositionState,
        goal: Goal,
        T: Pose,
        twist_now: Array,
        gain: Array,
        R_axes: Array,
        asked: Asked,
    ) -> tuple[Array, PositionState]:
        """Return the twist (6,) of the point at T that is led, all seen from the goal's ground.

        `twist_now` (6,) is its commanded twist: a new path starts from it.
        """
        factor = asked.speed_factor
        state, path = self._leader.lead(state, goal, T, twist_now, factor, asked.paused)
        T_path, twist_path = path.now()
        if isinstance(path, Path):
            twist_path = state.pace * twist_path
        error = pose_error(T_path, T)
        rate = np.zeros(6)
        _follow(R_axes, error, twist_path, gain, factor * self._speed, rate)
        return rate, PositionState(
            path,
            self._leader.reached(state, path, goal, T),
            state.goal,
            T_path,
            state.leg,
            state.leg_s,
            state.pace,
            state.behind and not within_bounds(error, CAUGHT_UP),
        )


@compiled(MATRIX, VECTOR, VECTOR, VECTOR, VECTOR, ROW)
def _follow(
    R_world_axes: Array, error: Array, own: Array, gain: Array, speed: Array, out: Array
) -> None:
    """Write the rate (6,) for a pose error and a path's own twist (6,), all in World axes.

    `gain` (6,) acts per axis of `R_world_axes`. The correction is no faster than the path's bound
    `speed` (6,), however far a stick has pushed the tool. `out` (6,) is zeros before.
    """
    for part in range(0, 6, 3):
        back, ahead, size2 = np.zeros(3), np.zeros(3), 0.0
        for i in range(3):
            for k in range(3):
                back[i] += R_world_axes[k, i] * error[part + k]
                ahead[i] += R_world_axes[k, i] * own[part + k]
            back[i] *= gain[part + i]
            ahead[i] *= min(gain[part + i] / FULL_FEED_FORWARD, 1.0)
            size2 += back[i] ** 2
        share = min(1.0, speed[part] / max(1e-12, math.sqrt(size2)))
        for i in range(3):
            for k in range(3):
                out[part + i] += R_world_axes[i, k] * (share * back[k] + ahead[k])
