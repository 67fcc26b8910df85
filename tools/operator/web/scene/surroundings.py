"""Surroundings of a cell: what the arms keep away from, and what the virtual world holds."""

import math
from typing import Any

from .....config.load import Cell
from .....config.schema.rig import RigBeamSection, RigBridgeSection, RigSection
from .....config.schema.surroundings import ObstacleSection, RigTagSection
from .....drivers.device import DeviceError
from .poses import Seven, along, of_pose, seven


def described_obstacles(cell: Cell) -> list[dict[str, Any]]:
    """Return what arms keep away from, with the distance to keep [m]."""
    default = cell.config.avoidance.clearance
    return [_obstacle(obstacle, default) for obstacle in cell.config.obstacles]


def _obstacle(obstacle: ObstacleSection, default: float) -> dict[str, Any]:
    soft = obstacle.shape == "sight_line"
    return {
        "name": obstacle.name,
        "shape": obstacle.shape,
        "xyz": obstacle.xyz,
        "to": obstacle.to,
        "rpy": obstacle.rpy,
        "radius": obstacle.radius or 0.0,
        "half_size": obstacle.half_size,
        "camera": obstacle.camera,
        "clearance": default if obstacle.clearance is None else obstacle.clearance,
        "hard": (not soft) if obstacle.hard is None else obstacle.hard,
        "moves": obstacle.max_speed > 0.0,
    }


def described_rig(cell: Cell) -> dict[str, Any] | None:
    """Return the bodies of the virtual world; None for a cell of real hardware."""
    rig = cell.config.rig
    if rig is None:
        return None
    return {
        "boxes": [
            {"name": b.name, "pose": seven(b.xyz, b.rpy), "half_size": b.half_size}
            for b in rig.boxes
        ]
        + ([] if rig.bridge is None else _bridge(rig.bridge)),
        "wall": _wall(rig),
        "holes": [
            {
                "name": hole.name,
                "pose": of_pose(hole.T_world_hole),
                **hole.model_dump(include={"radius", "chamfer", "depth", "half_size"}),
            }
            for hole in rig.holes
        ],
        "tags": [_tag(tag) for tag in rig.tags],
        "peg": None if rig.peg is None else rig.peg.model_dump(include={"radius", "length"}),
        "beam": None if rig.beam is None else _beam(rig.beam),
        "tool_radius": rig.tool_radius,
    }


def _bridge(bridge: RigBridgeSection) -> list[dict[str, Any]]:
    """Return pillars and beam; the near face's middle is `distance` ahead of World."""
    c, s = math.cos(bridge.skew), math.sin(bridge.skew)
    depth, side = 0.5 * bridge.thickness, 0.5 * bridge.side
    across, high = 0.5 * bridge.width + side, 0.5 * bridge.height
    each = (
        ("bridge_left", across, high, (depth, side, high)),
        ("bridge_right", -across, high, (depth, side, high)),
        ("bridge_beam", 0.0, bridge.height + side, (depth, across + side, side)),
    )
    return [
        {
            "name": name,
            "pose": seven(
                (bridge.distance + c * depth - s * y, bridge.offset + s * depth + c * y, z),
                (0.0, 0.0, bridge.skew),
            ),
            "half_size": half,
        }
        for name, y, z, half in each
    ]


def _wall(rig: RigSection) -> dict[str, Any] | None:
    if rig.wall is None:
        return None
    pose: Seven = [*rig.wall.xyz, *along(rig.wall.normal)]
    return {"pose": pose, "half_size": rig.wall.half_size}


def _tag(tag: RigTagSection) -> dict[str, Any]:
    place = tag.T_world_tag if tag.T_world_tag is not None else tag.T_wrist_tag
    return {
        "name": tag.name,
        "on": "world" if tag.T_world_tag is not None else "wrist",
        "pose": None if place is None else of_pose(place),
        "size": tag.size,
        "colour": tag.colour,
        "cells": _cells(tag),
    }


def _cells(tag: RigTagSection) -> list[list[int]] | None:
    """Return the tag's picture with its white margin, rows of 0 (black) and 1; None unless OpenCV
    is installed."""
    try:
        from .....drivers.vision.opencv import marker
    except DeviceError:
        return None
    found: list[list[int]] = (marker(tag.family, tag.tag, 1) > 127).astype(int).tolist()
    return found


def _beam(beam: RigBeamSection) -> dict[str, Any]:
    return {
        "half_size": beam.half_size,
        "pegs": [of_pose(peg) for peg in beam.pegs],
        "peg": beam.peg.model_dump(include={"radius", "length"}),
    }
