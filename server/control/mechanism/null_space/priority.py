"""Avoidance that precedes following (Hamaguchi, Taniguchi, section 3).

Obstacles inside the virtual spheres ask some joints for rates ξ, which the null space takes (eqs.
7, 8), and leave less and less of the hand's force to be followed: (1 − α) of it (eqs. 9, 10).
"""

import math
from typing import NamedTuple, Self

import numpy as np

from .....config.load import Cell
from .....config.schema.null_space.priority import PrioritySection
from ...proximity.control_points import ControlPointDistances, ControlPoints
from ...scene import Scene
from ...spatial import Array, Pose

LEVEL = 0.005
"""Slope of the distance in a joint's self-motion below which its rate fades [m/rad]: where neither
way leads away from an obstacle, no sign is right."""

RELEASE_S = 0.2
"""α rises at once, and falls from 1 to 0 in no less than this [s]."""


class Near(NamedTuple):
    """Distances of the virtual spheres from obstacles, and the priority that follows."""

    names: tuple[str, ...]
    distances: ControlPointDistances
    alpha: float
    """Priority of avoiding, 0 to 1."""


class Priority:
    """The virtual spheres of one cell, and the law of eqs. 8 to 10."""

    def __init__(
        self, law: PrioritySection, points: ControlPoints, joints: Array, period_s: float
    ) -> None:
        """`joints` (n,) has ones where the joint's rate avoids, zeros elsewhere."""
        self._law, self._points, self._joints = law, points, joints
        self._names = tuple(sphere.name for sphere in law.spheres)
        self._release = period_s / RELEASE_S

    @classmethod
    def from_cell(cls, cell: Cell) -> Self | None:
        """Build what a cell describes, None where it has no spheres. Raises `ConfigError`."""
        law = cell.config.priority
        if law is None:
            return None
        joints = np.array([float(joint.name in law.joints) for joint in cell.robot.joints])
        return cls(law, ControlPoints(cell, law.spheres), joints, cell.config.timing.period_s)

    def look(
        self, q: Array, scene: Scene | None, before: Near | None, T_world_base: Pose | None = None
    ) -> Near:
        """Return what is near at joint angles q (n,) [rad]; `before` is that of the last tick."""
        distances = self._points.look(q, scene, T_world_base)
        alpha = alpha_of(distances.least, self._law) if self._law.precedence else 0.0
        if before is not None:
            alpha = max(alpha, before.alpha - self._release)
        return Near(self._names, distances, alpha)

    def rates(self, near: Near, null: Array) -> Array:
        """Return ξ (n,) [rad/s]: of each joint, the way that widens the distance by self-motion.

        `null` (r, n) has orthonormal rows that span the self-motions.
        """
        size = size_of(near.distances.least, self._law)
        if size <= 0.0:
            return np.zeros(len(self._joints))
        # Joint i alone, projected, widens the distance at (P slope)_i.
        widening = (null @ near.distances.slope) @ null
        return np.asarray(size * self._joints * np.clip(widening / LEVEL, -1.0, 1.0))


def size_of(distance: float, law: PrioritySection) -> float:
    """Return |ξ| of each joint [rad/s] at a distance [m] (eq. 8)."""
    part = (law.outer_radius - distance) / (law.outer_radius - law.inner_radius)
    return law.rate * max(0.0, part)


def alpha_of(distance: float, law: PrioritySection) -> float:
    """Return α at a distance [m] (eq. 9)."""
    part = (distance - law.inner_radius) / (law.outer_radius - law.inner_radius)
    return math.exp(-law.steepness * max(0.0, part))
