"""Leading along the path to a goal: begun, turned from leg to leg, paused, and reached."""

import math
from typing import Final, NamedTuple

import numpy as np

from ...rigid_body import rotate_twist
from ...spatial import Array, Pose, pose_error
from .free import Free, FreePlanner
from .goals import Goal, PathGoal, Pursuit, Route, TwistRoute
from .straight import Path, StraightPlanner

REACHED = (5e-4, 1e-3)
"""A goal is reached within this distance [m] and angle [rad]."""

PAUSE_TIME_S = 0.15
"""Time constant with which a path is paused and resumed [s]."""


class Progress(NamedTuple):
    """How far a goal is under way."""

    leg: int
    """Leg or segment under way, counted from 0; that of the last one at the end."""
    legs: int
    part: float
    """Part of its time that is over, 0 to 1 [1]."""
    pace: float
    """Part of the path's own speed that it goes at: 0 when paused [1]."""


class PositionState(NamedTuple):
    """The path under way, if any, and whether its goal is reached."""

    path: Path | Free | None = None
    at_goal: bool = False
    goal: Goal | None = None
    T_world_path: Pose | None = None
    """Where the path had the MRF in this tick."""
    leg: int = 0
    leg_s: float = 0.0
    """Time since the present segment of twists began [s]."""
    pace: float = 1.0
    """Part of its own speed at which the path goes: falls to 0 while it is paused [1]."""
    behind: bool = False
    """The tool slid off the path and has not caught up: no leg ends before it has."""

    @property
    def progress(self) -> Progress | None:
        """How far it is, None without a goal that has an end."""
        match self.goal:
            case PathGoal() | Route() if isinstance(self.path, Path):
                legs = len(self.goal.legs) if isinstance(self.goal, Route) else 1
                return Progress(self.leg, legs, self.path.part, self.pace)
            case TwistRoute(segments):
                over = self.leg >= len(segments)
                part = 1.0 if over else min(1.0, self.leg_s / segments[self.leg].duration_s)
                leg = min(self.leg, len(segments) - 1)
                return Progress(leg, len(segments), part, self.pace)
        return None


NO_GOAL: Final = PositionState()
"""Nothing is under way."""


class Leader:
    """Plans paths inside bounds `speed`, `acceleration` and `jerk` (6,)."""

    def __init__(self, speed: Array, acceleration: Array, jerk: Array, period_s: float) -> None:
        self._period_s = period_s
        self._straight = StraightPlanner(speed, acceleration, jerk)
        self._free = FreePlanner(speed, acceleration, jerk)

    def advance(self, state: PositionState, pace: float, slid: bool) -> PositionState:
        """Return the state with the path moved on by a part `pace` (0 to 1) of a period.

        `slid` tells that a barrier turned the tool off the path.
        """
        step_s = pace * self._period_s
        if slid and not state.behind:
            state = state._replace(behind=True)
        match state.path:
            case Path() as path:
                moved = path.advanced(state.pace * step_s)
                return state if moved is path else PositionState(moved, *state[1:])
            case Free() as free:
                # Reduced speed, like a pause, stretches time: the same way at a lower speed.
                leg_s = state.leg_s + state.pace * free.factor * step_s
                return state._replace(path=self._free.step(free, step_s), leg_s=leg_s)
        return state

    def lead(
        self, state: PositionState, goal: Goal, T: Pose, twist: Array, factor: float, paused: bool
    ) -> tuple[PositionState, Path | Free]:
        """Return the state, and the path to what the goal is now: begun, turned or gone on with."""
        before = state.goal
        if before is None or before.serial != goal.serial:
            state, begin = PositionState(goal=goal), True
        else:
            begin = before.attempt != goal.attempt
            state = state._replace(goal=goal) if goal is not before else state
        pace, way = state.pace, (0.0 if paused else 1.0) - state.pace
        if way:
            part = 1.0 - math.exp(-self._period_s / PAUSE_TIME_S)
            pace = pace + way if abs(way) < 1e-4 else pace + part * way
            state = state._replace(pace=pace)
        path: Path | Free
        match goal:
            case PathGoal() | Route():
                state, path = self._straightly(state, goal, T, twist, factor, begin)
            case TwistRoute():
                state, path = self._by_twists(
                    state, goal, self._freed(state, T, twist, factor, begin)
                )
            case Pursuit():
                aim = np.zeros(6) if goal.T_world_target is None else goal.T_world_target
                path = self._freed(state, T, twist, factor, begin)._replace(aim=aim)
        return state, path

    def _straightly(
        self,
        state: PositionState,
        goal: PathGoal | Route,
        T: Pose,
        twist: Array,
        factor: float,
        begin: bool,
    ) -> tuple[PositionState, Path]:
        legs = goal.legs if isinstance(goal, Route) else (goal,)
        path = state.path
        if begin or not isinstance(path, Path):
            return state, self._straight.plan(legs[state.leg], T, twist, factor)
        if state.leg + 1 < len(legs) and not state.behind:
            near = isinstance(goal, Route) and goal.blend > 0.0 and path.distance() < goal.blend
            if path.finished or near:
                leg = state.leg + 1
                turned = self._straight.turn(path, legs[leg], factor)
                if turned is not None:
                    return state._replace(leg=leg), turned
        return state, path

    def _by_twists(
        self, state: PositionState, goal: TwistRoute, free: Free
    ) -> tuple[PositionState, Free]:
        leg, leg_s = state.leg, state.leg_s
        # What a segment runs over by is the next one's, so that none lasts too long.
        while leg < len(goal.segments) and leg_s > goal.segments[leg].duration_s - 1e-9:
            leg_s -= goal.segments[leg].duration_s
            leg += 1
        aim = np.zeros(6)
        if leg < len(goal.segments):
            aim = state.pace * free.factor * goal.segments[leg].twist
            if goal.moving_axes:
                aim = rotate_twist(free.pose.R, aim)
        return state._replace(leg=leg, leg_s=leg_s), free._replace(aim=aim)

    def _freed(
        self, state: PositionState, T: Pose, twist: Array, factor: float, begin: bool
    ) -> Free:
        """Return the reference that is steered; a new one starts from where the MRF is."""
        if begin or not isinstance(state.path, Free):
            return Free(T, twist.copy(), np.zeros(6), np.zeros(6), factor)
        return state.path._replace(factor=factor)

    def reached(self, state: PositionState, path: Path | Free, goal: Goal, T: Pose) -> bool:
        """Return whether what is led, now at T, is at the end of the goal."""
        if isinstance(goal, Pursuit) or not path.finished:
            return False
        if isinstance(goal, TwistRoute) and state.leg < len(goal.segments):
            return False
        if isinstance(goal, Route) and state.leg + 1 < len(goal.legs):
            return False
        return within_bounds(pose_error(goal.T_world_target or path.now()[0], T), REACHED)


def within_bounds(error: Array, bounds: tuple[float, float]) -> bool:
    """Return whether an error (6,) is below bounds of distance [m] and angle [rad]."""
    return (
        math.sqrt(float(error[:3] @ error[:3])) < bounds[0]
        and math.sqrt(float(error[3:] @ error[3:])) < bounds[1]
    )
