"""The oracle's centre line of a tunnel: dense points, integrated step by step from the cell."""

import math

import numpy as np
from telerobot.config.schema.mechanism import BackboneSection

from .poses import Array, matrix, rotation

STEP = 0.004
"""Points of the centre line are at most so far apart [m]."""
INSIDE = 2.0
"""Points farther from the centre line than this many half widths are not in the tunnel [1]."""


class Tunnel:
    """Where the centre line of what has walls is."""

    def __init__(self, backbone: BackboneSection) -> None:
        T = matrix(backbone.entrance)
        R, p, points, tangents = T[:3, :3], T[:3, 3], [T[:3, 3]], [T[:3, 0]]
        begins: list[int] = []
        for piece in backbone.tunnel:
            if piece.open:
                break
            if piece.to is not None:
                T = matrix(piece.to)
                R, p = T[:3, :3], T[:3, 3]
                begins.append(len(points))
                continue
            count = math.ceil(piece.length / STEP)
            turn = np.array([piece.roll, -piece.climb, piece.bend]) / count
            whole, along = rotation(turn), _averaged(turn)
            for _ in range(count):
                p = p + piece.length / count * (R @ along)
                R = R @ whole
                points.append(p)
                tangents.append(R[:, 0])
        self.points = np.array(points)
        """(k, 3) in World [m]."""
        self.rows = np.split(self.points, begins)
        """The same, tunnel by tunnel."""
        self.end = R, p
        """Attitude (3, 3), x along the tangent, and place (3,) [m] of the last exit."""
        self._tangents = np.array(tangents)
        self._squares = (self.points**2).sum(axis=1)
        self._near = INSIDE * backbone.half_width

    def off_centre(self, points: Array) -> float:
        """Return how far those of points (m, 3) that are in the tunnel are off its centre line [m].

        At most; 0 where none is inside.
        """
        # Least |p − c|², less what is the same for all c.
        nearest = (self._squares - 2.0 * points @ self.points.T).argmin(axis=1)
        inside = (nearest > 0) & (nearest < len(self.points) - 1)
        way = points - self.points[nearest]
        along = (way * self._tangents[nearest]).sum(axis=1)
        off = np.sqrt(np.maximum(0.0, (way * way).sum(axis=1) - along**2))
        found = off[inside & (np.abs(along) < STEP) & (off < self._near)]
        return float(found.max()) if len(found) else 0.0


def _averaged(turn: Array) -> Array:
    """Return the tangent's average (3,) over an even turn (3,) [rad], by Simpson's rule."""
    shares = np.linspace(0.0, 1.0, 9)
    tangents = np.array([rotation(share * turn)[:, 0] for share in shares])
    weights = np.array([1.0, 4.0, 2.0, 4.0, 2.0, 4.0, 2.0, 4.0, 1.0]) / 24.0
    return np.asarray(weights @ tangents)
