"""Virtual spheres on the arm: how far their centres are from obstacles, and the slope of that."""

from typing import NamedTuple

import numpy as np

from ....config.errors import ConfigError
from ....config.load import Cell
from ....config.priority import VirtualSphere
from ..frames import Array, Pose
from ..scene import Scene
from .chain import Chain
from .distance import cross
from .points import apart

ALIKE = 0.005
"""Distances that differ by so much are nearly one, and their slopes are mixed [m]. Where another
sphere or obstacle becomes the nearest, the direction to go turns over; it does not jump."""


class Distances(NamedTuple):
    """How far the spheres' centres are from obstacles at one posture."""

    each: Array
    """Of each to the nearest surface (s,) [m]; infinite without obstacles."""
    slope: Array
    """Of the least of them in the joint angles (n,) [m/rad]."""

    @property
    def least(self) -> float:
        """The least of them [m]."""
        return float(self.each.min())


class Spheres:
    """The virtual spheres of one cell."""

    def __init__(self, cell: Cell, spheres: tuple[VirtualSphere, ...]) -> None:
        """Place them. Raises `ConfigError` for one on a link that there is not, or that stands."""
        self._chain = Chain(cell)
        placed = [self._place(cell, i, sphere) for i, sphere in enumerate(spheres)]
        body = np.array([b for b, _ in placed])
        self._joint = body - 1
        self._centre = np.array([[*p, 1.0] for _, p in placed])
        self._moved = (np.arange(1, self._chain.n + 1) <= body[:, None]).astype(float)

    def look(self, q: Array, scene: Scene | None, T_world_base: Pose | None = None) -> Distances:
        """Return the distances at joint angles q (n,) [rad]."""
        frames = self._chain.frames(q[None], T_world_base)[0]
        centre = (frames[self._joint] @ self._centre[:, :, None])[:, :, 0]
        nothing = Distances(np.full(len(centre), np.inf), np.zeros(len(q)))
        if scene is None:
            return nothing
        distance, normal = apart(centre, scene)
        if not distance.size:
            return nothing
        share = np.exp((distance.min() - distance) / ALIKE)
        away = np.einsum("sk,ski->si", share / share.sum(), normal)
        return Distances(distance.min(axis=1), self._slope(frames, centre, away))

    def _slope(self, frames: Array, centre: Array, away: Array) -> Array:
        """Return Σ Jᵀ away (n,), by away·(z × (centre − o)) = z·(centre × away) − away·(z × o)."""
        z, o = self._chain.axes(frames), frames[:, :, 3]
        rows = cross(centre, away) @ z.T - away @ cross(z, o).T
        prismatic = self._chain.prismatic
        if prismatic.any():
            rows[:, prismatic] = away @ z[prismatic].T
        return np.asarray((rows * self._moved).sum(axis=0))

    def _place(self, cell: Cell, i: int, sphere: VirtualSphere) -> tuple[int, Array]:
        where = f"{cell.path}: priority.spheres[{i}].link: value '{sphere.link}'"
        try:
            body, T = self._chain.body_of(sphere.link)
        except KeyError:
            raise ConfigError(f"{where}: no such link in {cell.robot.urdf}") from None
        if body == 0:
            raise ConfigError(f"{where}: no joint of the arm moves it")
        return body, T.R @ np.array(sphere.centre) + T.p
