"""The box that the tool's MRF stays in: six walls, each a gap like any other."""

import numpy as np

from ....config.load import Cell
from ..frames import Array, Pose
from .approach import Braking, Rows
from .chain import Chain

BETWEEN = 0.002
"""Kept from a wall for what a path dips between two looks at a stop [m]."""


class Walls:
    """The workspace of one cell."""

    def __init__(self, cell: Cell, chain: Chain, braking: Braking) -> None:
        workspace = cell.config.avoidance.workspace
        self.given = workspace is not None
        self._margin = cell.config.avoidance.margin
        self._chain = chain
        self._braking = braking
        if workspace is not None:
            self._low, self._high = np.array(workspace.low), np.array(workspace.high)
        _, self._T_last_wrist = chain.body_of(cell.config.mechanism.tip_link)

    def rows(self, p: Array, J: Array, factor: float, widen: bool) -> Rows:
        """Return the barriers of the MRF at p (3,) in World, with its Jacobian J (6, n)."""
        room = np.concatenate([p - self._low, self._high - p]) - self._margin
        slopes = np.concatenate([J[:3], -J[:3]])
        return self._braking.rows(slopes, room, np.zeros(6), factor, widen)

    def shortfall(self, p: Array, T_wrist_mrf: Pose, q: Array) -> float:
        """Return by how much the MRF leaves the box along postures q (s, n) [m]; 0 inside.

        From where it is at p (3,), outside, it may only come nearer.
        """
        frames = self._chain.frames(q)[:, -1]
        tip = self._T_last_wrist @ T_wrist_mrf
        places = frames[:, :, :3] @ tip.p + frames[:, :, 3]
        low = np.minimum(self._low + BETWEEN, p - 1e-4)
        high = np.maximum(self._high - BETWEEN, p + 1e-4)
        return max(0.0, float(np.maximum(low - places, places - high).max()))
