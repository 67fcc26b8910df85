"""Description of a cell for the page: all that does not change while it runs, as JSON."""

from typing import Any, Final, NamedTuple

from .....config.drives import joint_bounds
from .....config.load import Cell
from .....config.schema.surroundings import CameraSection
from .links import described_links
from .meshes import Meshes
from .poses import of_pose
from .surroundings import described_obstacles, described_rig
from .tunnels import described_tunnels

BOUNDLESS: Final = 1e6
"""Joints that may turn this far turn for ever [rad]."""


class Scene(NamedTuple):
    """All that a page needs to draw a cell."""

    description: dict[str, Any]
    """What `describe` returns."""
    files: dict[str, bytes]
    """Meshes as binary glTF, by the addresses that the description has."""


def scene_of(cell: Cell) -> Scene:
    """Return a cell's description and its meshes; reads them, which may take seconds."""
    meshes = Meshes()
    description = describe(cell, meshes)
    return Scene(description, meshes.files())


def describe(cell: Cell, meshes: Meshes | None = None) -> dict[str, Any]:
    """Return a cell's frames, shapes and surroundings.

    Joint vectors are in the order of State. Poses are `[x, y, z, qx, qy, qz, qw]`, SI throughout;
    shapes have addresses of `meshes`, and `missing` those that cannot be drawn. Names are as files
    have them, those of a URDF's links any text at all: whoever shows them must escape them.
    """
    meshes = Meshes() if meshes is None else meshes
    config, links = cell.config, described_links(cell, meshes)
    workspace = config.avoidance.workspace
    return {
        "cell": config.name,
        "description": config.description,
        "period_s": config.timing.period_s,
        "joints": _joints(cell),
        "links": links,
        "missing": [row._asdict() for row in meshes.missing],
        "tasks": _tasks(cell, {link["name"]: i for i, link in enumerate(links)}),
        "cameras": [
            _camera(camera, part.task) for part in cell.parts for camera in part.config.cameras
        ],
        "obstacles": described_obstacles(cell),
        "avoidance": {
            "told": config.keeps_clear,
            "clearance": config.avoidance.clearance,
            "self_clearance": config.avoidance.self_clearance,
            "near": config.avoidance.near_distance,
        },
        "tool_planes": [
            {"point": plane.point, "normal": plane.normal} for plane in config.avoidance.tool_planes
        ],
        "workspace": None if workspace is None else {"low": workspace.low, "high": workspace.high},
        "tunnels": described_tunnels(cell),
        "T_world_carrier": of_pose(config.frames.T_world_carrier),
        "moving": sorted(config.frames.moving),
        "rig": described_rig(cell),
        "foot": None if config.contour is None else config.contour.foot,
    }


def _joints(cell: Cell) -> list[dict[str, Any]]:
    """Return name, kind, bounds and start of all joints, bounds as the daemon keeps them.

    Wheels turn for ever: their bounds are none.
    """
    found = []
    for part in cell.parts:
        drives, joints = part.config.mechanism.drives, part.robot.joints
        bounds = joint_bounds(joints, drives)
        start = part.config.mechanism.postures["start"]
        found += [
            {
                "name": f"{part.prefix}{joint.name}",
                "kind": joint.kind,
                "lower": _bound(bounds.lower[i]),
                "upper": _bound(bounds.upper[i]),
                "max_velocity": drives[i].max_velocity,
                "max_torque": drives[i].max_torque,
                "start": start[i],
            }
            for i, joint in enumerate(joints)
        ]
    return found


def _bound(angle: float) -> float | None:
    return None if abs(angle) >= BOUNDLESS else angle


def _tasks(cell: Cell, links: dict[str, int]) -> list[dict[str, Any]]:
    """Return the tasks of all arms, then those that several hold together."""
    tasks, first = [], 0
    for part in cell.parts:
        mechanism, count = part.config.mechanism, len(part.robot.joints)
        tip = links[part.prefix + mechanism.tip_link]
        tasks.append(
            {
                "name": part.task,
                "mechanism": mechanism.name,
                "by": [mechanism.name],
                "first_joint": first,
                "joints": count,
                "tip": tip,
                "T_wrist_mrf": of_pose(mechanism.T_wrist_mrf),
                "force": mechanism.force_torque is not None,
            }
        )
        first += count
    for task in cell.joint_tasks:
        holder = next(t for t in tasks if t["mechanism"] == task.by[0])
        shared = {"name": task.name, "by": list(task.by), "force": False}
        tasks.append({**holder, **shared, "T_wrist_mrf": of_pose(task.T_wrist_mrf[0])})
    return tasks


def _camera(camera: CameraSection, task: str) -> dict[str, Any]:
    return {
        "name": camera.name,
        "task": task,
        "on": camera.on,
        "pose": of_pose(camera.place),
        "size": camera.size,
        "focal": camera.focal,
    }
