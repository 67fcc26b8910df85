"""Judge of an arm in tunnels: where its links truly are, and what they press on the walls."""

from typing import Any

import numpy as np

from ....config.load import Cell
from ....config.schema.mechanism import BackboneSection
from ....protocols.messages.rig import RigTruth
from ....server.control.backbone.curve import centre_line
from ....server.control.backbone.fit import Chain
from ....server.control.spatial import Array

STEP = 0.004
"""Points of the centre line are at most so far apart [m]."""
INSIDE = 2.0
"""Points farther from the centre line than this many half widths are not in the tunnel [1]."""


class TunnelJudge:
    """Judges every tick by the physics; idle for a cell without a backbone."""

    def __init__(self, cell: Cell) -> None:
        backbone = cell.config.mechanism.backbone
        self._chain = None if backbone is None else Chain.from_cell(cell)
        self._line = None if backbone is None else _CentreLine(backbone)
        self.centre_error = 0.0
        """The farthest that a link was off the centre line inside [m]."""
        self.insertion = self.deepest = 0.0
        """How far in along the centre line the tip is, and has been [m]."""
        self.wall_force = 0.0
        """The greatest force on walls and what else stands around, in any physics step [N]."""

    def judge(self, truth: RigTruth) -> None:
        """Take in a tick."""
        if self._chain is None or self._line is None:
            return
        links = self._chain.points(np.array([truth.q]))[0]
        self.insertion = self._line.along(links[-1])
        self.deepest = max(self.deepest, self.insertion)
        points = np.concatenate((links, 0.5 * (links[1:] + links[:-1])))
        self.centre_error = max(self.centre_error, self._line.off_centre(points))
        arms = truth.arms.values()
        self.wall_force = max(self.wall_force, *(arm.contact_peak for arm in arms))

    def figures(self) -> dict[str, Any]:
        """Return what a simulation's JSON tells; nothing for a plain arm."""
        if self._line is None:
            return {}
        return {
            "insertion_m": self.insertion,
            "deepest_m": self.deepest,
            "centre_error_m": self.centre_error,
            "wall_force_n": self.wall_force,
        }


class _CentreLine:
    """The centre line of what has walls, as points."""

    def __init__(self, backbone: BackboneSection) -> None:
        frames = [T for row in centre_line(backbone, STEP) for T in row]
        self._points = np.array([T.p for T in frames])
        self._tangents = np.array([T.R[:, 0] for T in frames])
        self._squares = (self._points**2).sum(axis=1)
        self._near = INSIDE * backbone.half_width
        steps = np.linalg.norm(np.diff(self._points, axis=0), axis=1)
        self._lengths = np.concatenate(([0.0], np.cumsum(steps)))

    def along(self, point: Array) -> float:
        """Return how far in along the centre line a point (3,) is [m]; what is before it, at 0."""
        nearest = int((self._squares - 2.0 * self._points @ point).argmin())
        onward = float((point - self._points[nearest]) @ self._tangents[nearest])
        ends = nearest in (0, len(self._points) - 1)
        return max(0.0, float(self._lengths[nearest]) + (onward if ends else 0.0))

    def off_centre(self, points: Array) -> float:
        """Return how far those of points (m, 3) that are in the tunnel are off its centre line [m].

        At most; 0 where none is inside.
        """
        # Least |p − c|², less what is the same for all c.
        nearest = (self._squares - 2.0 * points @ self._points.T).argmin(axis=1)
        inside = (nearest > 0) & (nearest < len(self._points) - 1)
        way = points - self._points[nearest]
        along = (way * self._tangents[nearest]).sum(axis=1)
        off = np.sqrt(np.maximum(0.0, (way * way).sum(axis=1) - along**2))
        found = off[inside & (np.abs(along) < STEP) & (off < self._near)]
        return float(found.max()) if len(found) else 0.0
