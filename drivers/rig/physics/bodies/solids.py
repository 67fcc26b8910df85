"""The cell's obstacles as physical things: solid bodies that can be moved."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from .....config.schema.obstacles import ObstacleSection
from .....config.schema.section import PoseSection

Vector = NDArray[np.float64]

POINT = 0.001
"""Radius of what is only a point to the daemon [m]."""


def add_solid(
    spec: mujoco.MjSpec, obstacle: ObstacleSection, quat: tuple[float, float, float, float]
) -> mujoco.MjsGeom | None:
    """Add an obstacle that can be moved; return its shape, None for a sight line."""
    if obstacle.shape == "sight_line" or obstacle.xyz is None:
        return None
    body = spec.worldbody.add_body(
        name=f"obstacle_{obstacle.name}", pos=obstacle.xyz, quat=quat, mocap=True
    )
    kind = mujoco.mjtGeom
    radius = obstacle.radius or POINT
    name = f"obstacle_{obstacle.name}_shape"
    match obstacle.shape:
        case "box":
            return body.add_geom(name=name, type=kind.mjGEOM_BOX, size=obstacle.half_size)
        case "capsule":
            end = np.subtract(obstacle.to or obstacle.xyz, obstacle.xyz)
            fromto = [0.0, 0.0, 0.0, *end.tolist()]
            return body.add_geom(
                name=name, type=kind.mjGEOM_CAPSULE, fromto=fromto, size=[radius, 0.0, 0.0]
            )
        case _:
            return body.add_geom(name=name, type=kind.mjGEOM_SPHERE, size=[radius, 0.0, 0.0])


def attitude(obstacle: ObstacleSection) -> PoseSection:
    """Return the attitude of an obstacle's body: a box's own."""
    return PoseSection(rpy=obstacle.rpy if obstacle.shape == "box" else (0.0, 0.0, 0.0))


def place(model: mujoco.MjModel, data: mujoco.MjData, name: str, xyz: Vector) -> None:
    """Move an obstacle. Raises `ValueError`, in one line, for one that there is not."""
    bodies = (f"obstacle_{name}", name)
    found = [mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body) for body in bodies]
    body = next((i for i in found if i >= 0 and model.body_mocapid[i] >= 0), -1)
    if body < 0:
        raise ValueError(f"fault place: no solid obstacle {name!r} in the cell")
    data.mocap_pos[model.body_mocapid[body]] = xyz
