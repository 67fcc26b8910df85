"""Straight, jerk-limited paths to a pose: translation in a line, rotation by the geodesic."""

import math
from typing import NamedTuple

import numpy as np

from ...compiled import NUMBER, VECTOR, compiled
from ...spatial import Array, Pose, from_target, turned
from ...stop.motion import Motion
from ...stop.trajectory import PositionPlanner, Profile, TrajectoryError
from .goals import PathGoal

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
        if float(np.abs(twist).max()) < 1e-6:
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
