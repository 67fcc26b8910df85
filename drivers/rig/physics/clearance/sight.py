"""How far the arm's housing truly is from each camera's line of sight, by the physics' geometry.

A camera that stands in World and looks for a tag that stands there has a line of sight from its
pinhole to the tag's middle. Along it lies a geom that touches nothing and is as thin as can be.
"""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from .....config.load import Cell

Vector = NDArray[np.float64]

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
