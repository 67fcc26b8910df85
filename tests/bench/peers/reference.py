"""Reference of all controllers: straight to the target, at one speed, in time."""

from typing import NamedTuple

import numpy as np
from telerobot.server.control.spatial import Array, Pose, pose_error, rotation_exp

PEAK = 1.875
"""Greatest rate of the quintic over its mean [1]."""


class Reference(NamedTuple):
    """A straight line and a geodesic, passed by a quintic in time: at rest at both ends."""

    start: Pose
    way: Array
    """From start to target (6,), World axes [m, rad]."""
    duration_s: float

    @classmethod
    def between(cls, start: Pose, target: Pose, speed: float, angular_speed: float) -> "Reference":
        """Return the reference whose greatest speeds are those given [m/s], [rad/s]."""
        way = pose_error(target, start)
        sizes = float(np.linalg.norm(way[:3])), float(np.linalg.norm(way[3:]))
        slowest = max(sizes[0] / speed, sizes[1] / angular_speed, 0.1)
        return cls(start, way, PEAK * slowest)

    def at(self, time_s: float) -> Pose:
        """Return where it is at a time after its start."""
        x = min(1.0, max(0.0, time_s / self.duration_s))
        part = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        return Pose(
            rotation_exp(part * self.way[3:]) @ self.start.R, self.start.p + part * self.way[:3]
        )

    def off_path(self, p: Array) -> float:
        """Return the distance of a point (3,) from the straight line [m]."""
        way = self.way[:3]
        length2 = float(way @ way)
        along = 0.0 if length2 == 0.0 else float(way @ (p - self.start.p)) / length2
        return float(np.linalg.norm(p - self.start.p - min(1.0, max(0.0, along)) * way))
