"""Distances in the physics: of arms from what stands around, each other, and lines of sight."""

import math
from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from ....config.load import Cell
from ....server.control.compiled import INDEX, MATRIX, ROW, VECTOR, compiled
from .geoms import owners

# --- Distances in the physics: of arms from what stands around them, and from each other ----------

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
    """Of the bounding balls of what stands (f,) [m]; 0 of a box."""
    halves: Vector
    """Half the sizes of what stands (f, 3) [m]; 0 of what is no box."""


@compiled(MATRIX, MATRIX, INDEX, INDEX, VECTOR, VECTOR, MATRIX, ROW)
def _lower_bounds(
    places: Vector,
    turned: Vector,
    arm: NDArray[np.int64],
    fixed: NDArray[np.int64],
    radius: Vector,
    reach: Vector,
    halves: Vector,
    bounds: Vector,
) -> None:
    """Write lower bounds (a·f,) of distances [m]: places (g, 3), matrices (g, 9), `_Shapes`."""
    for i in range(len(arm)):
        for j in range(len(fixed)):
            R, beside = fixed[j], 0.0
            for k in range(3):
                local = 0.0
                for m in range(3):
                    local += (places[arm[i], m] - places[R, m]) * turned[R, 3 * m + k]
                beside += max(abs(local) - halves[j, k], 0.0) ** 2
            # What is in the middle of a box may be deeper than its own radius.
            bound = math.sqrt(beside) - radius[i] - reach[j] if beside > 0.0 else -math.inf
            bounds[i * len(fixed) + j] = bound


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
        clear = self._clear
        if not len(clear):
            return None
        mujoco.mj_kinematics(self._model, self._data)
        bound = self._bounds_of_fixed()[clear]
        order = bound.argsort(kind="stable")
        fromto, points, least, nearest = np.zeros(6), np.zeros(6), 1.0, -1
        # Lower bounds tell which pairs can be the nearest at all.
        for low, (arm, fixed) in zip(
            bound[order].tolist(), self._pairs[clear[order]].tolist(), strict=True
        ):
            if low >= least:
                break
            distance = mujoco.mj_geomDistance(self._model, self._data, arm, fixed, least, fromto)
            if distance < least:
                least, nearest = distance, fixed
                points[:] = fromto
        name = self._body_of[nearest] if nearest >= 0 else ""
        return TrueNearest(least, points[:3], points[3:], name)

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
        bounds = np.empty(len(self._pairs))
        _lower_bounds(self._data.geom_xpos, self._data.geom_xmat, *self._shapes, bounds)
        return bounds

    @cached_property
    def _shapes(self) -> "_Shapes":
        model, count = self._model, len(self._fixed)
        arm, fixed = self._pairs[::count, 0], self._pairs[:count, 1]
        box = model.geom_type[fixed] == mujoco.mjtGeom.mjGEOM_BOX
        return _Shapes(
            arm,
            fixed,
            model.geom_rbound[arm],
            np.where(box, 0.0, model.geom_rbound[fixed]),
            np.where(box[:, None], model.geom_size[fixed], 0.0),
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
    def _clear(self) -> NDArray[np.int64]:
        """Which of `_pairs` are none of a tool's ball and the wall, which is there to be pushed."""
        names = [self._model.geom(g).name for g in range(self._model.ngeom)]
        pushes = [
            names[a].endswith(TOOL_BALL) and names[f] == WALL for a, f in self._pairs.tolist()
        ]
        return np.flatnonzero(np.logical_not(pushes))

    @cached_property
    def _arm_pairs(self) -> NDArray[np.int64]:
        """Pairs (p, 2) of geoms that belong to different arms."""
        bodies = self._model.geom_bodyid.tolist()
        # Built to overlap, as shoulders and a torso.
        excluded = self._model.exclude_signature.tolist()
        apart = {frozenset((pair >> 16, pair & 0xFFFF)) for pair in excluded}
        owner = owners(self._model, self._roots)
        touches = self._model.geom_conaffinity
        arms = [
            [g for g in range(self._model.ngeom) if owner[bodies[g]] == arm and touches[g]]
            for arm in range(len(self._roots))
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


# --- How far the arm's housing truly is from each camera's line of sight, by the physics' geometry
#
# A camera that stands in World and looks for a tag that stands there has a line of sight from
# its pinhole to the tag's middle. Along it lies a geom that touches nothing and is as thin as
# can be.

PROBE = "sight_probe"
"""Name of the geom."""

PROBE_RADIUS = 1e-4
"""Its radius, which is taken off again [m]."""

TOUCHES_NOTHING = 8
"""Contact group of its own: without any, it might be taken for mere decoration and left out."""

_FARTHEST = 10.0
"""Distances beyond count as this one [m]."""


def add_probe(spec: mujoco.MjSpec) -> None:
    """Add the geom to a model that is being built."""
    probe = spec.worldbody.add_geom(
        name=PROBE, type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=(PROBE_RADIUS, 1.0, 0.0), density=0
    )
    probe.contype, probe.conaffinity = TOUCHES_NOTHING, 0
    probe.group = 5
    probe.rgba[:] = 0.0


class SightLines:
    """The lines of sight of a cell's standing cameras."""

    def __init__(self, cell: Cell, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        rig = cell.config.rig
        tags = () if rig is None else rig.tags
        self._model, self._data = model, data
        self._lines = [
            (camera.name, camera.T_world_lens.xyz, tag.name)
            for camera in cell.cameras
            for tag in tags
            if camera.T_world_lens is not None
            and tag.T_world_tag is not None
            and (tag.tag, tag.family) == (camera.tag, camera.family)
        ]
        self._geoms = [
            (g, model.body(int(model.geom_bodyid[g])).name)
            for g in range(model.ngeom)
            if model.body_weldid[model.geom_bodyid[g]] != 0 and model.geom_conaffinity[g]
        ]

    def clearances(self, tags: Mapping[str, Sequence[float]]) -> dict[str, dict[str, float]]:
        """Return each camera's distance to each moving link [m], negative inside a housing.

        `tags` says where the tags are. The model's kinematics must be up to date.
        """
        return {
            camera: self._distances(np.array(start), np.array(tags[tag][:3]))
            for camera, start, tag in self._lines
        }

    def _distances(self, start: Vector, end: Vector) -> dict[str, float]:
        model, data = self._model, self._data
        probe = int(model.geom(PROBE).id)
        along = end - start
        quat, R = np.zeros(4), np.zeros(9)
        mujoco.mju_quatZ2Vec(quat, along / np.linalg.norm(along))
        mujoco.mju_quat2Mat(R, quat)
        data.geom_xpos[probe], data.geom_xmat[probe] = 0.5 * (start + end), R
        model.geom_size[probe, 1] = 0.5 * np.linalg.norm(along)
        found: dict[str, float] = {}
        for geom, link in self._geoms:
            distance = mujoco.mj_geomDistance(model, data, probe, geom, _FARTHEST, None)
            found[link] = min(found.get(link, _FARTHEST), distance + PROBE_RADIUS)
        return found
