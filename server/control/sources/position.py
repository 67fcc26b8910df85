"""Target poses (Williams 1997, section 2.3): a jerk-limited path, followed with error feedback.

The path leads straight from where the MRF is to the target, the rotation along the geodesic; the
rate is the path's own plus K_P times the pose error, rotation by logarithm. The path waits while
the arm is held back, so that limits slow a motion without bending it; and it does not care how
far a stick pushes the tool aside: on release the error feedback brings it home.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..frames import (
    Array,
    Pose,
    pose_error,
    right_jacobian,
    rotate_twist,
    rotation_exp,
    rotation_log,
)
from ..trajectory import Motion, PositionPlanner, Profile

FULL_FEED_FORWARD = 0.5
"""Gain from which the path's own rate is passed on in full [1/s]; below, in proportion."""

REACHED = (5e-4, 1e-3)
"""A goal is reached within this distance [m] and angle [rad]."""


@dataclass(frozen=True)
class PathGoal:
    """A target pose of the MRF in World; `serial` tells one goal from the next."""

    T_world_target: Pose
    serial: int
    speed: float | None = None
    """Path speed [m/s]; the cell's when None."""


@dataclass(frozen=True)
class Path:
    """A path under way: World position, and rotation vector from the target's attitude."""

    goal: PathGoal
    profile: Profile

    def now(self) -> tuple[Pose, Array]:
        """Return the path's pose in World and its own twist (6,) in World axes."""
        motion = self.profile.at()
        r = motion.q[3:]
        R = self.goal.T_world_target.R @ rotation_exp(r)
        twist = np.concatenate([motion.dq[:3], R @ (right_jacobian(r) @ motion.dq[3:])])
        return Pose(R, motion.q[:3]), twist


@dataclass(frozen=True)
class PositionState:
    """The path under way, if any, and whether its target is reached."""

    path: Path | None = None
    at_goal: bool = False


class Position:
    """Follows goals; `speed`, `acceleration`, `jerk` (6,) bound its paths."""

    def __init__(self, speed: Array, acceleration: Array, jerk: Array, period_s: float) -> None:
        self._speed = speed
        self._acceleration = acceleration
        self._jerk = jerk
        self._period_s = period_s
        self._planner = PositionPlanner(6)

    def rate(
        self,
        state: PositionState,
        goal: PathGoal | None,
        T_world_mrf: Pose,
        twist_now: Array,
        gain: Array,
        R_world_axes: Array,
        factor: float,
    ) -> tuple[Array, PositionState]:
        """Return the twist (6,) in World axes that leads along the path to the goal.

        `twist_now` (6,) is the MRF's commanded twist in World axes: a new path starts from it.
        `gain` (6,) is K_P [1/s], per axis of the frame that `R_world_axes` (3, 3) maps to World;
        an axis of gain zero is left to the other sources. `factor` scales the path's speed.
        """
        if goal is None:
            return np.zeros(6), PositionState()
        path = state.path
        if path is None or path.goal.serial != goal.serial:
            path = Path(goal, self._plan(goal, T_world_mrf, twist_now, factor))
        T_world_path, twist_path = path.now()
        error = rotate_twist(R_world_axes.T, pose_error(T_world_path, T_world_mrf))
        feedback = gain * error
        # The correction is no faster than the path, however far a stick has pushed the tool.
        for part in (slice(0, 3), slice(3, 6)):
            size = math.sqrt(float(feedback[part] @ feedback[part]))
            feedback[part] *= min(1.0, factor * float(self._speed[part][0]) / max(1e-12, size))
        share = np.minimum(gain / FULL_FEED_FORWARD, 1.0)
        feed_forward = share * rotate_twist(R_world_axes.T, twist_path)
        away = pose_error(goal.T_world_target, T_world_mrf)
        reached = (
            path.profile.finished
            and math.sqrt(float(away[:3] @ away[:3])) < REACHED[0]
            and math.sqrt(float(away[3:] @ away[3:])) < REACHED[1]
        )
        return rotate_twist(R_world_axes, feedback + feed_forward), PositionState(path, reached)

    def advance(self, state: PositionState, granted: float) -> PositionState:
        """Return the state with the path moved on by `granted` (0 to 1) of a period."""
        path = state.path
        if path is None or path.profile.finished:
            return state
        profile = path.profile.advanced(granted * self._period_s)
        return replace(state, path=Path(path.goal, profile))

    def _plan(self, goal: PathGoal, T: Pose, twist: Array, factor: float) -> Profile:
        r = rotation_log(goal.T_world_target.R.T @ T.R)
        # Rate of the rotation vector: ω in body axes, through the inverse right Jacobian.
        dr = np.linalg.solve(right_jacobian(r), T.R.T @ twist[3:])
        start = Motion(np.concatenate([T.p, r]), np.concatenate([twist[:3], dr]), np.zeros(6))
        target = np.concatenate([goal.T_world_target.p, np.zeros(3)])
        speed = self._speed.copy()
        if goal.speed is not None:
            speed[:3] = goal.speed
        # Sharing the bounds out by direction makes them hold along the path, not per axis.
        shares = np.full(6, 1.0 / math.sqrt(3.0))
        if float(np.abs(twist).max()) < 1e-6:
            start = Motion.at_rest(start.q)
            for part in (slice(0, 3), slice(3, 6)):
                span = target[part] - start.q[part]
                length = math.sqrt(float(span @ span))
                if length > 1e-9:
                    shares[part] = np.maximum(np.abs(span) / length, 1e-3)
        bounds = (
            np.maximum(speed * shares * factor, np.abs(start.dq) * 1.001),
            self._acceleration * shares,
            self._jerk * shares,
        )
        return self._planner.plan(start, target, bounds)
