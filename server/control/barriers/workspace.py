"""The box that the tool's MRF stays in: six walls, each a gap like any other."""

import math
from typing import Final, NamedTuple

import numpy as np

from ....config.load import Cell
from ..compiled import ARRAY4, COUNT, VECTOR, compiled
from ..proximity.capsules import Capsules
from ..spatial import Array, Pose
from .velocity_damper import Walled

BETWEEN: Final = 0.002
"""Kept from a wall for what a path dips between two looks at a stop [m]."""


class _Tip(NamedTuple):
    """The MRF on the last body of the chain."""

    T_wrist_mrf: Pose
    p: Array
    """Where it is there (3,) [m]."""
    reach: Array
    """Bounds on its levers (n,) [m]."""


class Walls:
    """The workspace of one cell."""

    def __init__(self, cell: Cell, capsules: Capsules) -> None:
        """Build that of one mechanism's tool; `cell` is the cell of it alone."""
        workspace = cell.config.avoidance.workspace
        self.given = workspace is not None
        margin, none = cell.config.avoidance.margin, np.zeros(0)
        self._capsules = capsules
        self._low, self._high = none, none
        if workspace is not None:
            self._low, self._high = np.array(workspace.low), np.array(workspace.high)
        self._low_barrier, self._high_barrier = self._low + margin, self._high - margin
        tip = f"{cell.prefix}{cell.config.mechanism.tip_link}"
        self.body, self._T_last_wrist = capsules.forest.body_of(tip)
        self._tip: _Tip | None = None

    def around(self, J: Array, p: Array) -> Walled:
        """Return the MRF at p (3,), with its Jacobian J (6, n), between the barriers."""
        return Walled(J, p, self._low_barrier, self._high_barrier)

    def far(self, p: Array, T_wrist_mrf: Pose, way: Array) -> bool:
        """Return whether joints that move by `way` (n,) cannot lead the MRF out of the box."""
        return _stays(p, self._low, self._high, self._tip_at(T_wrist_mrf).reach, way)

    def shortfall(
        self, p: Array, T_wrist_mrf: Pose, q: Array, T_world_base: Pose | None = None
    ) -> float:
        """Return by how much the MRF leaves the box along postures q (s, n) [m]; 0 inside.

        From where it is at p (3,), outside, it may only come nearer.
        """
        frames = self._capsules.forest.frames(q, T_world_base)
        low = np.minimum(self._low + BETWEEN, p - 1e-4)
        high = np.maximum(self._high - BETWEEN, p + 1e-4)
        return _beyond(frames, self.body - 1, self._tip_at(T_wrist_mrf).p, low, high)

    def _tip_at(self, T_wrist_mrf: Pose) -> _Tip:
        """Return where the MRF is on the chain; it stays there from tick to tick."""
        if self._tip is None or self._tip.T_wrist_mrf is not T_wrist_mrf:
            p = (self._T_last_wrist @ T_wrist_mrf).p
            reach = self._capsules.reach(self.body, math.sqrt(float(p @ p)))
            self._tip = _Tip(T_wrist_mrf, p, reach)
        return self._tip


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, VECTOR)
def _stays(p: Array, low: Array, high: Array, reach: Array, way: Array) -> bool:
    """Return whether a point at p (3,) that moves by less than `reach` · `way` stays in a box."""
    gone = BETWEEN
    for j in range(len(way)):
        gone += reach[j] * way[j]
    nearest = np.inf
    for i in range(3):
        nearest = min(nearest, p[i] - low[i], high[i] - p[i])
    return gone < nearest


@compiled(ARRAY4, COUNT, VECTOR, VECTOR, VECTOR)
def _beyond(frames: Array, last: int, tip: Array, low: Array, high: Array) -> float:
    """Return how far a point of a mechanism leaves a box at most [m]; 0 inside.

    `frames` (s, n, 3, 4) are the joints' at s postures; `tip` (3,) is the point in the `last` one
    of the mechanism.
    """
    worst = 0.0
    for s in range(len(frames)):
        for i in range(3):
            x = frames[s, last, i, 3]
            for k in range(3):
                x += frames[s, last, i, k] * tip[k]
            worst = max(worst, low[i] - x, x - high[i])
    return worst
