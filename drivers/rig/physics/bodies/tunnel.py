"""The walls of a tunnel, as boxes: on either side of a planar arm, in rings of eight in space.

Each box is tangent to the tunnel's wall in the middle of its piece of the centre line, and moved
back where the wall bulges inward: the free room is nowhere narrower than the rig says.
"""

import math
from collections.abc import Iterator
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from .....config.load import Cell
from .....config.schema.mechanism.backbone import BackboneSection
from ..geoms import fixed

STEP = math.pi / 8
"""A box spans so much of a turn [rad]."""
LONGEST = 0.05
"""A ring of boxes around a straight piece is at most so long, in half lengths [m]."""

_Vector = NDArray[np.float64]


class _Piece(NamedTuple):
    """A short piece of the centre line: where its middle is, and how it turns."""

    middle: _Vector
    """(3,) [m]"""
    R: NDArray[np.float64]
    """Columns: tangent in the middle, to where it turns, and across (3, 3)."""
    length: float
    angle: float


def add_tunnel(spec: mujoco.MjSpec, cell: Cell) -> None:
    """Add the walls of a cell's tunnel to the model, all of one body, `tunnel`."""
    backbone, rig = cell.config.mechanism.backbone, cell.config.rig
    if backbone is None or rig is None:
        return
    walls, tunnel = spec.worldbody.add_body(name=f"{cell.prefix}tunnel"), rig.tunnel
    planar = backbone.axes == "planar"
    sides = (0.0, math.pi) if planar else tuple(i * math.pi / 4 for i in range(8))
    depth = 0.0
    for i, piece in enumerate(_pieces(backbone)):
        half = backbone.half_width
        if tunnel.half_width is not None and depth >= tunnel.narrow_from:
            half = tunnel.half_width
        depth += piece.length
        for k, side in enumerate(sides):
            out = math.cos(side) * piece.R[:, 1] + math.sin(side) * piece.R[:, 2]
            reach, inward = 0.5 * piece.length, 0.0
            if piece.angle > 0.0:
                radius = piece.length / piece.angle - half * math.cos(side)
                reach = radius * math.tan(0.5 * piece.angle)
                inward = max(0.0, math.cos(side)) * radius * (1.0 - math.cos(0.5 * piece.angle))
            away = half + inward + 0.5 * tunnel.thickness
            across = tunnel.half_height
            if not planar:
                across = (half + inward + tunnel.thickness) * math.tan(math.pi / 8)
            R = np.column_stack((piece.R[:, 0], out, np.cross(piece.R[:, 0], out)))
            quat = np.zeros(4)
            mujoco.mju_mat2Quat(quat, R.ravel())
            fixed(
                walls.add_geom(
                    name=f"{cell.prefix}tunnel_{i}_{k}",
                    type=mujoco.mjtGeom.mjGEOM_BOX,
                    pos=piece.middle + away * out + np.array(tunnel.shift),
                    quat=quat,
                    size=(reach, 0.5 * tunnel.thickness, across),
                )
            )


def _pieces(backbone: BackboneSection) -> Iterator[_Piece]:
    """Cut the centre line of what has walls into short pieces."""
    p, R = np.array(backbone.entrance.xyz), _attitude(backbone.entrance.rpy)
    for segment in backbone.tunnel:
        if segment.open:
            return
        if segment.to is not None:
            p, R = np.array(segment.to.xyz), _attitude(segment.to.rpy)
            continue
        angle = math.hypot(segment.bend, segment.climb)
        count = max(1, math.ceil(angle / STEP - 1e-9))
        if not angle:
            count = max(1, math.ceil(segment.length / (2.0 * LONGEST) - 1e-9))
        axis = np.array([0.0, -segment.climb, segment.bend]) / max(angle, 1e-12)
        inward = np.cross(axis, [1.0, 0.0, 0.0]) if angle else np.array([0.0, 1.0, 0.0])
        length, turn = segment.length / count, angle / count
        for _ in range(count):
            middle = p + R @ _along(0.5 * length, 0.5 * turn, inward)
            mid = R @ _turned(axis, 0.5 * turn)
            to = mid @ inward
            yield _Piece(
                middle, np.column_stack((mid[:, 0], to, np.cross(mid[:, 0], to))), length, turn
            )
            p, R = p + R @ _along(length, turn, inward), R @ _turned(axis, turn)


def _along(length: float, angle: float, inward: _Vector) -> _Vector:
    """Return the way (3,) along an arc from its first frame on [m]."""
    if not angle:
        return np.array([length, 0.0, 0.0])
    radius = length / angle
    way: _Vector = radius * np.array([math.sin(angle), 0.0, 0.0])
    return way + radius * (1.0 - math.cos(angle)) * inward


def _turned(axis: _Vector, angle: float) -> NDArray[np.float64]:
    """Return the rotation (3, 3) about a unit axis (3,)."""
    quat, R = np.zeros(4), np.zeros(9)
    mujoco.mju_axisAngle2Quat(quat, axis, angle)
    mujoco.mju_quat2Mat(R, quat)
    return R.reshape(3, 3)


def _attitude(rpy: tuple[float, float, float]) -> NDArray[np.float64]:
    quat, R = np.zeros(4), np.zeros(9)
    mujoco.mju_euler2Quat(quat, np.array(rpy), "XYZ")
    mujoco.mju_quat2Mat(R, quat)
    return R.reshape(3, 3)
