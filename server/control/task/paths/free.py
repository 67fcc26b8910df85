"""A reference that is steered: by twists, or after a pose that moves.

Its twist is continuous, with bounded acceleration and jerk, whatever it is told: so a new twist, a
new target or none at all never makes it jump.
"""

from typing import NamedTuple

import numpy as np

from ...spatial import Array, Pose, pose_error, rotation_exp
from ...stop.motion import Motion
from ...stop.trajectory import PositionPlanner, TrajectoryError, VelocityPlanner
from .straight import along

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
        stands = float(np.abs(self.twist).max()) < AT_REST
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
