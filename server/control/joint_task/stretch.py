"""The promise of stretch: how far grasps of one payload move apart along a stop.

Arms that stop in proportion go along straight lines in joint space, which bend apart in the payload
by d²/2R. A stop that would stretch the payload by more than is promised is none, so that the arms
are slower where it bends too much.
"""

from collections.abc import Sequence

import numpy as np

from ....config.load import Cell
from ..proximity.forest import Forest
from ..spatial import Array, Pose
from ..stop.way_to_rest import Stop

STEP_S = 0.03
"""A stop is looked at every so long [s]."""

MOST_SAMPLES = 24
"""At so many instants at most [1]."""


class Stretch:
    """How far the grasps of some mechanisms of a cell move apart along stops."""

    def __init__(self, cell: Cell, members: Sequence[int], promised: float) -> None:
        """Build it for mechanisms by their places in the cell; `promised` is the bound [m]."""
        self._forest, self._promised = Forest(cell), promised
        parts = [cell.parts[i] for i in members]
        found = [self._forest.body_of(p.prefix + p.config.mechanism.tip_link) for p in parts]
        self._joints = [body - 1 for body, _ in found]
        self._T_body_wrist = [T for _, T in found]

    def shortfall(
        self, stop: Stop, views: Sequence[Pose], grasps: Array, giving_way: float
    ) -> float:
        """Return by how much grasps move apart more than is promised [m], 0 for not.

        `views` are T_wrist_mrf of each arm, `grasps` (k, 3) where the grasps are in the MRF [m].
        `giving_way` is the relative speed that force control asks for [m/s]: coming to rest from
        that is no stretch.
        """
        to_go_s = stop.to_go_s
        if to_go_s <= 0.0:
            return 0.0
        samples = min(MOST_SAMPLES, 2 + int(to_go_s / STEP_S))
        times = np.linspace(0.0, to_go_s, samples)
        frames = self._forest.frames(stop.postures(times))
        places = []
        for joint, T, view in zip(self._joints, self._T_body_wrist, views, strict=True):
            in_body = T @ view
            points = grasps @ in_body.R.T + in_body.p
            R, p = frames[:, joint, :, :3], frames[:, joint, :, 3]
            places.append(np.einsum("sij,kj->ski", R, points) + p[:, None, :])
        most = 0.0
        for i in range(1, len(places)):
            for other in range(i):
                apart = places[i] - places[other]
                way = apart - apart[0]
                most = max(most, float((way * way).sum(axis=2).max()))
        allowed = self._promised + 0.5 * giving_way * to_go_s
        return max(0.0, float(np.sqrt(most)) - allowed)
