"""Feasibility of a goal, judged beforehand by other means than the server's.

The judge knows the arm from its URDF only (`arm.py`). From a known posture it marches along the
straight path to a target pose (translation on a line, rotation on the geodesic) in small steps,
each solved by Newton's method with the plain pseudo-inverse of the Jacobian. A target is
feasible if all along the path

- every joint keeps `LIMIT_ROOM` more from its limits than the cell's `position_margin`,
- the least singular value, radians weighed with the cell's characteristic length, stays above
  `SINGULAR_ROOM` times the cell's `singular_region`: no damping is in force,
- no joint has to turn faster than its speed bound at the cell's path speed,
- arm and tool stay `CLEAR` away from the rig's fixed things and from the arm itself.

A posture is feasible if it keeps the same room from joint limits and is clear in the same way.
The way to a posture is not judged: it starts wherever the hostile part left the arm.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from telerobot.config.drives import joint_bounds
from telerobot.config.load import Cell

from .arm import OracleArm
from .poses import Array, difference, rotation

LIMIT_ROOM = 0.05
"""Kept from joint limits beyond the cell's margin [rad]."""
SINGULAR_ROOM = 1.2
"""Kept from the singular region: least singular value over σ0 [1]."""
CLEAR = 0.03
"""Kept from everything that can be touched [m]."""
STEP = (0.01, 0.03)
"""Length of a step of the march [m], [rad]."""
CONVERGED = 1e-7
"""A step is solved when metres and radians are left by less than this."""
ITERATIONS = 8


@dataclass
class GoalJudge:
    """Judges goals of one cell; joint arrays are (n,)."""

    arm: OracleArm
    lower: Array
    upper: Array
    velocity: Array
    weight: Array
    least_singular: float
    speed: tuple[float, float]

    @classmethod
    def of(cls, cell: Cell) -> Self:
        """Read the bounds of a cell."""
        config = cell.config
        drives = config.mechanism.drives
        bounds = joint_bounds(cell.robot.joints, drives, LIMIT_ROOM)
        length = config.resolve.characteristic_length
        return cls(
            OracleArm.of(cell),
            np.array(bounds.lower),
            np.array(bounds.upper),
            np.array([d.max_velocity for d in drives]),
            np.array([1.0] * 3 + [length] * 3),
            SINGULAR_ROOM * config.resolve.singular_region,
            (config.sources.position.speed, config.sources.position.angular_speed),
        )

    def posture(self, q: Array) -> str:
        """Return why a posture is not feasible, or nothing."""
        if ((q < self.lower) | (q > self.upper)).any():
            return "joint limit"
        if min(self.arm.clearance(q)) < CLEAR:
            return "collision"
        return ""

    def target(self, q: Array, T_target: Array) -> str:
        """Return why the target pose (4, 4) in World is not feasible from posture q, or nothing."""
        start = self.arm.tool(q)
        way = difference(T_target, start)
        sizes = float(np.linalg.norm(way[:3])), float(np.linalg.norm(way[3:]))
        steps = max(1, *(math.ceil(size / step) for size, step in zip(sizes, STEP, strict=True)))
        step_s = max(size / speed for size, speed in zip(sizes, self.speed, strict=True)) / steps
        for i in range(1, steps + 1):
            waypoint = np.eye(4)
            waypoint[:3, :3] = rotation(way[3:] * (i / steps)) @ start[:3, :3]
            waypoint[:3, 3] = start[:3, 3] + way[:3] * (i / steps)
            before = q
            q, sigma = self._solve(q, waypoint)
            why = self._wrong(before, q, sigma, waypoint, step_s)
            if why:
                return why
        return ""

    def _solve(self, q: Array, T: Array) -> tuple[Array, float]:
        """Return the posture near q with the tool at T, and the least singular value there."""
        sigma = 0.0
        for _ in range(ITERATIONS):
            J = self.weight[:, None] * self.arm.jacobian(q)
            sigma = float(np.linalg.svd(J, compute_uv=False)[-1])
            error = difference(T, self.arm.tool(q))
            if sigma < self.least_singular or np.abs(error).max() < CONVERGED:
                break
            q = q + np.linalg.pinv(J) @ (self.weight * error)
        return q, sigma

    def _wrong(self, before: Array, q: Array, sigma: float, T: Array, step_s: float) -> str:
        if sigma < self.least_singular:
            return "singular or out of reach"
        if np.abs(difference(T, self.arm.tool(q))).max() > CONVERGED:
            return "out of reach"
        if (np.abs(q - before) > self.velocity * step_s).any():
            return "joint speed"
        return self.posture(q)
