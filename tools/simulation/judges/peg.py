"""Judge of a peg as an arm's tool: how deep it truly is in a hole, wherever the hole really is."""

import math

import numpy as np

from ....config.load import Cell
from ....protocols.messages.rig import RigTruth
from .tool import placed


class PegJudge:
    """Finds the depth of each arm's peg; idle for a cell without pegs and holes."""

    def __init__(self, cell: Cell) -> None:
        rig = cell.config.rig
        holes = () if rig is None else rig.holes
        self._holes = [
            ((placed(h.T_world_hole) @ placed(h.misplaced)).inverse(), h.radius) for h in holes
        ]
        self._names = [
            part.config.mechanism.name
            for part in cell.parts
            if part.config.rig is not None and part.config.rig.peg is not None
        ]

    def depths(self, truth: RigTruth) -> list[float]:
        """Return how deep each peg's end is in the hole that it is nearest to the axis of [m].

        Negative before the mouth, 0 where it is below the mouth, but beside the hole.
        """
        if not self._holes:
            return []
        return [self._depth(truth.arms[name].pose_mrf[:3]) for name in self._names]

    def figures(self, truth: RigTruth) -> dict[str, object]:
        """Return the figures for a simulation's JSON; none without pegs and holes."""
        depths = self.depths(truth)
        return {"peg_depth_m": depths} if depths else {}

    def _depth(self, end: tuple[float, float, float]) -> float:
        found = []
        for T_hole_world, radius in self._holes:
            x, y, z = (T_hole_world.R @ np.array(end) + T_hole_world.p).tolist()
            aside = math.hypot(x, y)
            found.append((aside, -z if z > 0.0 or aside < radius else 0.0))
        return min(found)[1]
