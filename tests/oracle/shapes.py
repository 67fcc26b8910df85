"""Shapes for contact: balls along the links of an arm, and the boxes around it."""

import math
import xml.etree.ElementTree as ET
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from telerobot.config.load import Cell

from .poses import Array, matrix, matrix_of, origin_of

PLATE = 0.04
"""Thickness of the rig's wall [m]."""


class BallModel(NamedTuple):
    """Balls fixed to the links: all arrays have one row per ball."""

    link: NDArray[np.int64]
    """Index of the link's frame."""
    centre: Array
    """In the link's frame (m, 3) [m]."""
    radius: Array


class Block(NamedTuple):
    """A box in World: pose (4, 4) of its centre, half the sides (3,) [m]."""

    T: Array
    half: Array


def shape_of(root: ET.Element, index: dict[str, int], cell: Cell) -> BallModel:
    """Return the balls of a URDF and of the rig's tool; `index` numbers the links' frames."""
    links: list[int] = []
    centres: list[Array] = []
    radii: list[float] = []

    def add(link: int, T: Array, half_length: float, radius: float) -> None:
        count = 1 + math.ceil(2.0 * half_length / radius)
        for z in np.linspace(-half_length, half_length, count) if count > 1 else (0.0,):
            links.append(link)
            centres.append(T[:3, :3] @ np.array([0.0, 0.0, z]) + T[:3, 3])
            radii.append(radius)

    for element in root.findall("link"):
        link = index[element.get("name", "")]
        for collision in element.findall("collision"):
            T = origin_of(collision)
            cylinder = collision.find("geometry/cylinder")
            sphere = collision.find("geometry/sphere")
            if cylinder is not None:
                radius = float(cylinder.get("radius", "0"))
                half_length = 0.5 * float(cylinder.get("length", "0"))
                add(link, T, max(0.0, half_length - 0.5 * radius), radius)
            elif sphere is not None:
                add(link, T, 0.0, float(sphere.get("radius", "0")))
    rig = cell.config.rig
    if rig is not None and rig.tool_radius > 0.0:
        tip = index[cell.config.mechanism.tip_link]
        add(tip, matrix(cell.config.mechanism.T_wrist_mrf), 0.0, rig.tool_radius)
    return BallModel(np.array(links), np.array(centres), np.array(radii))


def blocks_of(cell: Cell) -> list[Block]:
    """Return the boxes and the wall of a cell's rig."""
    rig = cell.config.rig
    if rig is None:
        return []
    blocks = [
        Block(matrix_of(np.array(b.xyz), np.array(b.rpy)), np.array(b.half_size)) for b in rig.boxes
    ]
    if rig.wall is not None:
        z = np.array(rig.wall.normal) / np.linalg.norm(rig.wall.normal)
        x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
        x /= np.linalg.norm(x)
        T = np.eye(4)
        T[:3, :3] = np.column_stack([x, np.cross(z, x), z])
        T[:3, 3] = np.array(rig.wall.xyz) - 0.5 * PLATE * z
        half = np.array([rig.wall.half_size, rig.wall.half_size, 0.5 * PLATE])
        blocks.append(Block(T, half))
    return blocks
