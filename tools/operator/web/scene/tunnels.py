"""Tunnels of a cell's snakes: frames along the centre line of what has walls."""

from typing import Any

from .....config.load import Cell
from .....server.control.backbone.curve import centre_line
from .....server.control.spatial import Pose

STEP = 0.0075
"""Frames are at most so far apart [m]."""


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
                "pieces": [[_nine(T) for T in row] for row in centre_line(backbone, STEP)],
            }
        )
    return found


def _nine(T: Pose) -> list[float]:
    """Return a frame's origin, its y (to the left) and its z, in World."""
    return [round(x, 6) for x in (*T.p.tolist(), *T.R[:, 1].tolist(), *T.R[:, 2].tolist())]
