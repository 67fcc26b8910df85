"""Target poses (Williams 1997, section 2.3): jerk-limited paths, and how they are followed."""

import math
from typing import Final, NamedTuple

import numpy as np

from ....config.schema.sources import PositionSection
from ..axes import HeldAxes
from ..compiled import MATRIX, NUMBER, ROW, VECTOR, compiled
from ..inputs import Goal, Inputs, PathGoal, Pursuit, Route, TwistRoute
from ..spatial import (
    NO_TWIST,
    Array,
    Motion,
    Pose,
    differ,
    from_target,
    largest,
    motion_at,
    pose_error,
    rotate_twist,
    rotation_exp,
    turned,
    twist_at,
)
from ..stop.trajectory import PositionPlanner, Profile, TrajectoryError, VelocityPlanner
from .source import Context, Granted, Redefined, Shaping, Source

# --- Straight, jerk-limited paths to a pose: translation in a line, rotation by the geodesic ------

LONGEST_S = 5000.0
"""No part of a path is planned to take longer [s]: planning works in times below 7600 s."""
_LEAST_SHARE = 1e-3
"""Every axis gets some of the bounds, so that it can be corrected [1]."""


class Path(NamedTuple):
    """A path under way: World position, and rotation vector from the target's attitude."""

    goal: PathGoal
    profile: Profile

    def now(self) -> tuple[Pose, Array]:
        """Return the path's pose in World and its own twist (6,) in World axes."""
        q, dq = self.profile.now()
        R, twist = turned(self.goal.T_world_target.R, q[3:], dq)
        return Pose(R, q[:3]), twist

    @property
    def finished(self) -> bool:
        """True once it stands on its target."""
        return self.profile.finished

    @property
    def part(self) -> float:
        """How much of its time is over, 0 to 1 [1]."""
        duration_s = self.profile.duration_s
        return 1.0 if self.finished else self.profile.elapsed_s / max(duration_s, 1e-9)

    def advanced(self, by_s: float) -> "Path":
        """Return the same path, further along."""
        return self if self.finished else Path(self.goal, self.profile.advanced(by_s))

    def distance(self) -> float:
        """Return how far from its target the path is now [m]."""
        away = self.goal.T_world_target.p - self.profile.at().q[:3]
        return math.sqrt(float(away @ away))


class StraightPlanner:
    """Plans paths under speed, acceleration and jerk bounds (6,)."""

    def __init__(self, speed: Array, acceleration: Array, jerk: Array) -> None:
        self._speed = speed
        self._acceleration = acceleration
        self._jerk = jerk
        self._planner = PositionPlanner(6)

    def plan(self, goal: PathGoal, T: Pose, twist: Array, factor: float) -> Path:
        """Return the path from a pose in World and its twist (6,), at `factor` of the speed."""
        start = self._start(goal, T, twist, np.zeros(3))
        # Sharing the bounds out by direction makes them hold along the path, not per axis.
        shares = np.full(6, 1.0 / math.sqrt(3.0))
        if largest(twist) < 1e-6:
            start = Motion.at_rest(start.q)
            shares = along(self._span(goal, start), shares)
        try:
            return self._planned(goal, start, shares, factor)
        except TrajectoryError:  # from rest there is always a way; the limits ease the change
            return self._planned(goal, Motion.at_rest(start.q), shares, factor)

    def turn(self, path: Path, goal: PathGoal, factor: float) -> Path | None:
        """Return the path that leaves another one in full motion for the next target.

        None where there is none from this very state; the end of the old one is at rest.
        """
        T, twist = path.now()
        start = self._start(goal, T, twist, path.profile.at().ddq[:3])
        if path.finished:
            start = Motion.at_rest(start.q)
        shares = np.full(6, 1.0 / math.sqrt(3.0))
        span = along(self._span(goal, start), shares)
        shares = along(np.maximum(span, along(start.dq, np.zeros(6))), shares)
        try:
            return self._planned(goal, start, shares, factor)
        except TrajectoryError:
            return None

    def _span(self, goal: PathGoal, start: Motion) -> Array:
        return np.concatenate([goal.T_world_target.p, np.zeros(3)]) - start.q

    def _start(self, goal: PathGoal, T: Pose, twist: Array, acceleration: Array) -> Motion:
        r, dr = from_target(goal.T_world_target.R, T.R, twist[3:])
        motion = np.zeros((3, 6))
        motion[0, :3], motion[0, 3:] = T.p, r
        motion[1, :3], motion[1, 3:] = twist[:3], dr
        motion[2, :3] = acceleration
        return Motion(*motion)

    def _planned(self, goal: PathGoal, start: Motion, shares: Array, factor: float) -> Path:
        target, speed = np.zeros(6), self._speed
        target[:3] = goal.T_world_target.p
        if goal.speed is not None:
            speed = speed.copy()
            speed[:3] = goal.speed
        bounds = _bounds(
            factor,
            shares,
            speed,
            self._acceleration,
            self._jerk,
            target - start.q,
            start.dq,
            start.ddq,
        )
        return Path(goal, self._planner.plan(start, target, (bounds[0], bounds[1], bounds[2])))


@compiled(NUMBER, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR)
def _bounds(
    factor: float,
    shares: Array,
    speed: Array,
    acceleration: Array,
    jerk: Array,
    span: Array,
    dq: Array,
    ddq: Array,
) -> Array:
    """Return the bounds (3, 6) of a path on speed, acceleration and jerk, shared out by axis.

    What a path begins with, `dq` and `ddq` (6,), is inside them; and it goes through `span` (6,) in
    `LONGEST_S`, however slowly it was told to go.
    """
    out = np.empty((3, 6))
    for i in range(6):
        slowest = abs(span[i]) / LONGEST_S
        out[0, i] = max(speed[i] * shares[i] * factor, slowest, abs(dq[i]) * 1.001)
        out[1, i] = max(acceleration[i] * shares[i], abs(ddq[i]) * 1.001)
        out[2, i] = jerk[i] * shares[i]
    return out


def along(way: Array, otherwise: Array) -> Array:
    """Return the share of each axis in a way (6,), of translation and rotation apart."""
    shares = otherwise.copy()
    for part in (slice(0, 3), slice(3, 6)):
        length = math.sqrt(float(way[part] @ way[part]))
        if length > 1e-9:
            shares[part] = np.maximum(np.abs(way[part]) / length, _LEAST_SHARE)
    return shares


# --- A reference that is steered: by twists, or after a pose that moves ---------------------------
#
# Its twist is continuous, with bounded acceleration and jerk, whatever it is told: so a new
# twist, a new target or none at all never makes it jump.

AT_REST = 1e-6
"""A reference this slow stands [m/s, rad/s]."""


class Free(NamedTuple):
    """Where the reference is, and how it moves; all in World."""

    pose: Pose
    twist: Array
    acceleration: Array
    aim: Array | Pose
    """The twist (6,) to take up, or the pose to get to."""
    factor: float
    """The reduced-speed setting [1]."""

    def now(self) -> tuple[Pose, Array]:
        """Return the pose, and the twist (6,) in World axes."""
        return self.pose, self.twist

    @property
    def finished(self) -> bool:
        """True while it stands, and is told to."""
        stands = largest(self.twist) < AT_REST
        return stands and not isinstance(self.aim, Pose) and not self.aim.any()


class FreePlanner:
    """Moves references under speed, acceleration and jerk bounds (6,)."""

    def __init__(self, speed: Array, acceleration: Array, jerk: Array) -> None:
        self._speed, self._acceleration, self._jerk = speed, acceleration, jerk
        self._velocity = VelocityPlanner(acceleration, jerk)
        self._position = PositionPlanner(6, straight=False)

    def step(self, free: Free, period_s: float) -> Free:
        """Return the reference `period_s` later."""
        if period_s <= 0.0:
            return free
        start = Motion(np.zeros(6), free.twist, free.acceleration)
        if isinstance(free.aim, Pose):
            target = pose_error(free.aim, free.pose)
            if not (target.any() or free.twist.any() or free.acceleration.any()):
                return free
            none = np.zeros(6)
            ways = np.maximum(along(target, none), along(free.twist, none))
            speed = free.factor * self._speed * np.maximum(along(ways, none), 0.1)
            bounds = (
                np.maximum(speed, np.abs(free.twist) * 1.001),
                np.maximum(self._acceleration, np.abs(free.acceleration) * 1.001),
                self._jerk,
            )
            try:
                moved = self._position.plan(start, target, bounds).at(period_s)
            except TrajectoryError:  # slow down for a tick: the next one asks anew
                moved = self._velocity.step(start, np.zeros(6), period_s, synchronised=False)
        elif not (free.aim.any() or free.twist.any() or free.acceleration.any()):
            return free
        else:
            moved = self._velocity.step(start, free.aim, period_s, synchronised=True)
        pose = Pose(rotation_exp(moved.q[3:]) @ free.pose.R, free.pose.p + moved.q[:3])
        return free._replace(pose=pose, twist=moved.dq, acceleration=moved.ddq)


# --- Leading along the path to a goal: begun, turned from leg to leg, paused, and reached ---------

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


_NOWHERE: Final = np.zeros(3)


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

    @property
    def way(self) -> Array:
        """Where a straight path goes as a whole, in World (3,) [m]; zeros without one."""
        if not isinstance(self.path, Path):
            return _NOWHERE
        plan = self.path.profile.plan
        return np.asarray(plan.target[:3] - plan.start.q[:3])


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

    def reached(
        self,
        state: PositionState,
        path: Path | Free,
        goal: Goal,
        T: Pose,
        held: HeldAxes | None = None,
    ) -> bool:
        """Return whether what is led, now at T, is at the end of the goal in the axes held."""
        if isinstance(goal, Pursuit) or not path.finished:
            return False
        if isinstance(goal, TwistRoute) and state.leg < len(goal.segments):
            return False
        if isinstance(goal, Route) and state.leg + 1 < len(goal.legs):
            return False
        error = pose_error(goal.T_world_target or path.now()[0], T)
        return within_bounds(error if held is None else held.error(error), REACHED)


def within_bounds(error: Array, bounds: tuple[float, float]) -> bool:
    """Return whether an error (6,) is below bounds of distance [m] and angle [rad]."""
    return (
        math.sqrt(float(error[:3] @ error[:3])) < bounds[0]
        and math.sqrt(float(error[3:] @ error[3:])) < bounds[1]
    )


# --- Target poses (Williams 1997, section 2.3): a jerk-limited path, followed with error feedback
#
# The path leads straight from where the MRF is to the target, the rotation along the geodesic;
# the rate is the path's own plus K_P times the pose error, rotation by logarithm. The path
# slows as the arm is held back, so that limits slow a motion without bending it; it leads on
# where the tool slides along a barrier, so that it comes out behind it; and it does not care
# how far a stick pushes the tool aside: on release the error feedback brings it home. Routes,
# timed twists and a master's pose are followed by the same law: only the path differs.

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
        return self._rate(context, state, gain, context.inputs.settings.T_world_crf.R)

    def advance(self, state: PositionState, granted: Granted) -> PositionState:
        """Return the state with the path moved on by what was granted of a period."""
        return self._leader.advance(state, granted.pace, granted.slid)

    def carry(self, state: PositionState, context: Context, redefined: Redefined) -> PositionState:
        """Return the state with a steered reference told at the point of the tool led now."""
        free, before, point = state.path, redefined.before.T_wrist_goal, context.T_wrist_goal
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
        before, goal = redefined.before, context.goal
        if redefined.grounded and context.carried is not None:
            if before.serial == (None if goal is None else goal.serial):
                return None
            return twist_at(before.twists["position"], redefined.way) - twist
        axes = before.R_world_crf
        if goal is None or np.array_equal(axes, context.inputs.settings.T_world_crf.R):
            return None
        return self._rate(context, state, gain, axes)[0] - twist

    def _rate(
        self, context: Context, state: PositionState, gain: Array, axes: Array
    ) -> tuple[Array, PositionState]:
        """Return the twist of the MRF and the next state; `axes` (3, 3) are the gains' in World."""
        goal, led, ground = context.goal, context.T_wrist_goal, context.ground
        if goal is None:
            return NO_TWIST, NO_GOAL
        T, twist, lever, held = context.k.T_world_mrf, context.twist, None, context.held
        if context.carried is not None:
            twist = twist - context.carried
        if differ(led, context.T_wrist_mrf):
            T = context.k.T_world_wrist @ led
            lever = T.p - context.k.T_world_mrf.p
            twist = twist_at(twist, lever)
        if context.off_path is not None:
            T = Pose(T.R, T.p - context.off_path)  # without the virtual link: it is held there
        if ground is not None:
            there = ground.T.R.T
            T, axes = ground.T.inverse() @ T, there @ axes
            twist, held = rotate_twist(there, twist), None if held is None else held.seen(there)
        rate, state = self._led(state, goal, T, twist, gain, axes, context.inputs, held)
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
        inputs: Inputs,
        held: HeldAxes | None,
    ) -> tuple[Array, PositionState]:
        """Return the twist (6,) of the point at T that is led, all seen from the goal's ground.

        `twist_now` (6,) is its commanded twist: a new path starts from it. Along axes that are not
        `held` nothing is asked for.
        """
        factor = inputs.settings.speed_factor
        state, path = self._leader.lead(state, goal, T, twist_now, factor, inputs.paused)
        T_path, twist_path = path.now()
        if isinstance(path, Path):
            twist_path = state.pace * twist_path
        error = pose_error(T_path, T)
        if held is not None:
            error = held.error(error)
        rate = np.zeros(6)
        _follow(R_axes, error, twist_path, gain, factor * self._speed, rate)
        return rate if held is None else held.part(rate), PositionState(
            path,
            self._leader.reached(state, path, goal, T, held),
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
