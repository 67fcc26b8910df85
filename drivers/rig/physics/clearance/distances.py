"""Distances in the physics: of arms from what stands around them, and from each other."""

from collections.abc import Collection, Sequence
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
TOOL_BALL = "tool_ball"
"""Geom at the MRF that touches things."""
WALL = "wall_plate"
"""Geom of the wall, which is there to be pushed."""


class TrueNearest(NamedTuple):
    """Where the arm is nearest to something."""

    distance: float
    """[m]; negative inside one another, at most 1."""
    on_arm: Vector
    """In World (3,) [m]."""
    on_other: Vector
    other: str
    """Name of the other body."""


class _Shapes(NamedTuple):
    """Geoms of the arms (a,) and of what stands (f,), which may be moved but keep their sizes."""

    arm: NDArray[np.int64]
    fixed: NDArray[np.int64]
    radius: Vector
    """Of the arms' bounding balls (a,) [m]."""
    reach: Vector
    """Of the bounding balls of what stands (f, 1) [m]; 0 of a box."""
    halves: Vector
    """Half the sizes of what stands (f, 1, 3) [m]; 0 of what is no box."""


class WorldDistances:
    """Finds distances of one world's geoms; `roots` are the arms' bases, `fixed` what stands."""

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        fixed: Collection[int],
        roots: Sequence[int],
    ) -> None:
        self._model, self._data = model, data
        self._fixed, self._roots = fixed, tuple(roots)

    def between_arms(self, within: float = 1.0) -> float | None:
        """Return the least distance between two arms of the cell [m], at most `within`.

        Negative inside one another; None for one arm.
        """
        if len(self._roots) < 2:
            return None
        mujoco.mj_kinematics(self._model, self._data)
        bound, least = self._bounds(self._arm_pairs), within
        for i in np.argsort(bound, kind="stable"):
            if bound[i] >= least:
                break
            a, b = (int(g) for g in self._arm_pairs[i])
            distance = mujoco.mj_geomDistance(self._model, self._data, a, b, least, None)
            least = min(least, float(distance))
        return least

    def clearance(self) -> float | None:
        """Return the least distance of arm or tool from wall, boxes and obstacles [m].

        Negative inside one another, None where there is nothing to touch.
        """
        nearest = self.nearest()
        return None if nearest is None else nearest.distance

    def nearest(self) -> TrueNearest | None:
        """Return where arm or tool are nearest to wall, boxes and obstacles, if there are any.

        A tool's ball at the wall is a push, and no clearance.
        """
        if self._pushes.all():
            return None
        mujoco.mj_kinematics(self._model, self._data)
        bound = np.where(self._pushes, np.inf, self._bounds_of_fixed())
        fromto = np.zeros(6)
        found = TrueNearest(1.0, np.zeros(3), np.zeros(3), "")
        # Lower bounds tell which pairs can be the nearest at all.
        for i in np.argsort(bound, kind="stable"):
            if bound[i] >= found.distance:
                break
            arm, fixed = (int(g) for g in self._pairs[i])
            least = found.distance
            distance = mujoco.mj_geomDistance(self._model, self._data, arm, fixed, least, fromto)
            if distance < least:
                name = self._body_of[fixed]
                found = TrueNearest(float(distance), fromto[:3].copy(), fromto[3:].copy(), name)
        return found

    def gaps(self, within: float) -> Vector:
        """Return the distances (k,) of parts of arm and tool from wall, boxes and obstacles [m].

        At most `within`, one for each pair, in the same order every time.
        """
        mujoco.mj_kinematics(self._model, self._data)
        return np.array(
            [
                mujoco.mj_geomDistance(self._model, self._data, arm, fixed, within, None)
                if bound < within
                else within
                for (arm, fixed), bound in zip(
                    self._pairs.tolist(), self._bounds_of_fixed(), strict=True
                )
            ]
        )

    def _bounds(self, pairs: NDArray[np.int64]) -> Vector:
        """Return lower bounds of the distances (k,) of pairs (k, 2), by bounding balls [m]."""
        first, second = pairs.T
        way = self._data.geom_xpos[first] - self._data.geom_xpos[second]
        reach = self._model.geom_rbound[pairs].sum(axis=1)
        return np.asarray(np.sqrt((way * way).sum(axis=1)) - reach)

    def _bounds_of_fixed(self) -> Vector:
        """Return lower bounds of the distances of arms from what stands, in the order of `_pairs`.

        A bounding ball fits a wide box badly: beside one, the box itself counts.
        """
        known, places = self._shapes, self._data.geom_xpos
        way = places[known.arm] - places[known.fixed][:, None]
        local = np.abs(way @ self._data.geom_xmat[known.fixed].reshape(-1, 3, 3))
        beyond = np.maximum(local - known.halves, 0.0)
        beside = np.sqrt((beyond * beyond).sum(axis=2))
        # What is in the middle of a box may be deeper than its own radius.
        found = np.where(beside > 0.0, beside - known.radius - known.reach, -np.inf)
        return np.asarray(found.T.ravel())

    @cached_property
    def _shapes(self) -> "_Shapes":
        model, count = self._model, len(self._fixed)
        arm, fixed = self._pairs[::count, 0], self._pairs[:count, 1]
        box = (model.geom_type[fixed] == mujoco.mjtGeom.mjGEOM_BOX)[:, None]
        return _Shapes(
            arm,
            fixed,
            model.geom_rbound[arm],
            np.where(box, 0.0, model.geom_rbound[fixed][:, None]),
            np.where(box, model.geom_size[fixed], 0.0)[:, None],
        )

    @cached_property
    def _body_of(self) -> dict[int, str]:
        """Name of the body that each geom of what stands belongs to."""
        model = self._model
        return {g: model.body(model.geom_bodyid[g]).name for g in self._fixed}

    @cached_property
    def _pairs(self) -> NDArray[np.int64]:
        weld = self._model.body_weldid[self._model.geom_bodyid]
        arm = [g for g in range(self._model.ngeom) if g not in self._fixed and weld[g] != 0]
        pairs = [(a, f) for a in arm for f in sorted(self._fixed)]
        return np.array(pairs, dtype=np.int64).reshape(-1, 2)

    @cached_property
    def _pushes(self) -> NDArray[np.bool_]:
        """Which of `_pairs` (k,) are a tool's ball and the wall, which is there to be pushed."""
        names = [self._model.geom(g).name for g in range(self._model.ngeom)]
        return np.array(
            [names[a].endswith(TOOL_BALL) and names[f] == WALL for a, f in self._pairs.tolist()],
            dtype=bool,
        )

    @cached_property
    def _arm_pairs(self) -> NDArray[np.int64]:
        """Pairs (p, 2) of geoms that belong to different arms."""
        bodies = self._model.geom_bodyid.tolist()
        # Built to overlap, as shoulders and a torso.
        excluded = self._model.exclude_signature.tolist()
        apart = {frozenset((pair >> 16, pair & 0xFFFF)) for pair in excluded}
        root = self._model.body_rootid[self._model.geom_bodyid]
        touches = self._model.geom_conaffinity
        arms = [
            [g for g in range(self._model.ngeom) if root[g] == base and touches[g]]
            for base in self._roots
        ]
        pairs = [
            (a, b)
            for i, first in enumerate(arms)
            for second in arms[i + 1 :]
            for a in first
            for b in second
            if frozenset((bodies[a], bodies[b])) not in apart
        ]
        return np.array(pairs, dtype=np.int64).reshape(-1, 2)
