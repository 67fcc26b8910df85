"""Control points on the arm: their distances from obstacles, and the slope of the least of them.

They are the centres of the cell's virtual spheres.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from ....config.errors import ConfigError
from ....config.load import Cell
from ....config.schema.null_space.priority import VirtualSphereSection
from ..compiled import ARRAY3, ARRAY4, FLAGS, FLAGS2, INDEX, MATRIX, compiled, record
from ..scene import Flags, Index, Scene
from ..spatial import Array, Pose
from .forest import Forest
from .points import apart

ALIKE: Final = 0.005
"""Distances that differ by so much are nearly one, and their slopes are mixed [m]. Where another
point or obstacle becomes the nearest, the direction to go turns over; it does not jump."""


class ControlPointDistances(NamedTuple):
    """Distances of the control points from obstacles at one posture."""

    each: Array
    """Of each to the nearest surface (s,) [m]; infinite without obstacles."""
    slope: Array
    """Of the least of them in the joint angles (n,) [m/rad]."""

    @property
    def least(self) -> float:
        """The least of them [m]."""
        return float(self.each.min())


class ControlPoints:
    """The centres of one cell's virtual spheres."""

    def __init__(self, cell: Cell, spheres: tuple[VirtualSphereSection, ...]) -> None:
        """Place them. Raises `ConfigError` for one on a link that there is not, or that stands."""
        self._forest = Forest(cell)
        placed = [self._place(cell, i, sphere) for i, sphere in enumerate(spheres)]
        self._body: Index = np.array([body for body, _ in placed], dtype=np.int64)
        self._moves = self._forest.moves(self._body)
        self._centre = np.array([p for _, p in placed])

    def look(
        self, q: Array, scene: Scene | None, T_world_base: Pose | None = None
    ) -> ControlPointDistances:
        """Return the distances at joint angles q (n,) [rad]."""
        if scene is not None:
            frames = self._forest.frames(q[None], T_world_base)
            centre = _placed(frames, self._body, self._centre)
            away = apart(centre, scene)
            if away.distance.size:
                joints = frames, self._forest.axes(frames), self._forest.tree.prismatic
                return ControlPointDistances(*_mixed(joints, self._moves, centre, away[:]))
        return ControlPointDistances(np.full(len(self._centre), np.inf), np.zeros(len(q)))

    def _place(self, cell: Cell, i: int, sphere: VirtualSphereSection) -> tuple[int, Array]:
        where = f"{cell.path}: priority.spheres[{i}].link: value '{sphere.link}'"
        try:
            body, T = self._forest.body_of(f"{cell.prefix}{sphere.link}")
        except KeyError:
            raise ConfigError(f"{where}: no such link in {cell.robot.urdf}") from None
        if body == 0:
            raise ConfigError(f"{where}: no joint of the arm moves it")
        return body, T.R @ np.array(sphere.centre) + T.p


@compiled(ARRAY4, INDEX, MATRIX)
def _placed(frames: Array, body: Index, centre: Array) -> Array:
    """Return the centres (s, 3) of spheres on bodies (s,), in World, by frames (1, n, 3, 4)."""
    found = np.empty(centre.shape)
    for s in range(len(body)):
        for i in range(3):
            found[s, i] = frames[0, body[s] - 1, i, 3]
            for k in range(3):
                found[s, i] += frames[0, body[s] - 1, i, k] * centre[s, k]
    return found


@compiled(record(ARRAY4, ARRAY3, FLAGS), FLAGS2, MATRIX, record(MATRIX, ARRAY3))
def _mixed(
    joints: tuple[Array, Array, Flags], moves: Flags, centre: Array, apart: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Return the least distance of each point (s,), and the slope of the least of all (n,).

    `joints` are frames (1, n, 3, 4) and axes (1, n, 3), and which are prismatic (n,); `moves` (s,
    n) tells which joints move the points at `centre` (s, 3); `apart` is a record `Apart`.
    """
    (frames, axes, prismatic), (distance, normal) = joints, apart
    points, obstacles = distance.shape
    each, slope = np.full(points, np.inf), np.zeros(axes.shape[1])
    for s in range(points):
        for k in range(obstacles):
            each[s] = min(each[s], distance[s, k])
    least, total = each.min(), 0.0
    for s in range(points):
        x = y = z = 0.0
        for k in range(obstacles):
            share = math.exp((least - distance[s, k]) / ALIKE)
            x += share * normal[s, k, 0]
            y += share * normal[s, k, 1]
            z += share * normal[s, k, 2]
            total += share
        for j in range(axes.shape[1]):
            if not moves[s, j]:
                continue
            a, b, c = axes[0, j, 0], axes[0, j, 1], axes[0, j, 2]
            if not prismatic[j]:  # the axis times the way from it to the centre
                u = centre[s, 0] - frames[0, j, 0, 3]
                v = centre[s, 1] - frames[0, j, 1, 3]
                w = centre[s, 2] - frames[0, j, 2, 3]
                a, b, c = b * w - c * v, c * u - a * w, a * v - b * u
            slope[j] += a * x + b * y + c * z
    return each, slope / total
