"""Tunnels of a cell's snakes: frames along the centre line of what has walls."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .....config.load import Cell
from .....config.schema.mechanism.backbone import BackboneSection
from .....config.schema.section import PoseSection
from .....server.control.spatial import rotation_exp, rotation_rpy

STEP = 0.0075
"""Frames are at most so far apart [m]."""

_Matrix = NDArray[np.float64]


def described_tunnels(cell: Cell) -> list[dict[str, Any]]:
    """Return the tunnel of each mechanism that has one."""
    found = []
    for part in cell.parts:
        backbone = part.config.mechanism.backbone
        if backbone is None:
            continue
        rig = part.config.rig
        found.append(
            {
                "mechanism": part.config.mechanism.name,
                "planar": backbone.axes == "planar",
                "half_width": backbone.half_width,
                "thickness": 0.01 if rig is None else rig.tunnel.thickness,
                "half_height": 0.05 if rig is None else rig.tunnel.half_height,
                "pieces": centre_line(backbone),
            }
        )
    return found


def centre_line(backbone: BackboneSection) -> list[list[list[float]]]:
    """Return a row of frames for each stretch without a gap.

    A frame is its origin, its y (to the left) and its z, in World: nine numbers.
    """
    p, R = _placed(backbone.entrance)
    rows: list[list[list[float]]] = [[_nine(p, R)]]
    for piece in backbone.tunnel:
        if piece.open:
            break
        if piece.to is not None:
            p, R = _placed(piece.to)
            rows.append([_nine(p, R)])
            continue
        count = math.ceil(piece.length / STEP)
        turn = np.array([0.0, -piece.climb, piece.bend]) / count
        angle = float(np.linalg.norm(turn))
        shorter = math.sin(0.5 * angle) / (0.5 * angle) if angle else 1.0
        half, whole = rotation_exp(0.5 * turn), rotation_exp(turn)
        for _ in range(count):
            # The chord of an arc points along the tangent in its middle.
            p = p + piece.length / count * shorter * (R @ half)[:, 0]
            R = R @ whole
            rows[-1].append(_nine(p, R))
    return rows


def _placed(pose: PoseSection) -> tuple[_Matrix, _Matrix]:
    return np.array(pose.xyz), rotation_rpy(*pose.rpy)


def _nine(p: _Matrix, R: _Matrix) -> list[float]:
    return [round(x, 6) for x in (*p.tolist(), *R[:, 1].tolist(), *R[:, 2].tolist())]
