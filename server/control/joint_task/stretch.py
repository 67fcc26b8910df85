"""The promise of stretch: how far grasps of one payload move apart along a stop.

Arms that stop in proportion go along straight lines in joint space, which bend apart in the payload
by d²/2R. A stop that would stretch the payload by more than is promised is none, so that the arms
are slower where it bends too much.
"""

import math
from collections.abc import Sequence

import numpy as np

from ....config.load import Cell
from ..compiled import ARRAY3, ARRAY4, BLOCK, INDEX, MATRIX, compiled
from ..proximity.forest import Forest
from ..scene import Index
from ..spatial import Array, Pose
from ..stop.way_to_rest import Stop

STEP_S = 0.03
"""A stop is looked at every so long [s]."""

MOST_SAMPLES = 24
"""At so many instants at most [1]."""

Carried = tuple[Array, Array]
"""Where bodies that joints move have the MRF: R (k, 3, 3) and p (k, 3) [m]."""


class Stretch:
    """How far the grasps of some mechanisms of a cell move apart along stops."""

    def __init__(self, cell: Cell, members: Sequence[int], promised: float) -> None:
        """Build it for mechanisms by their places in the cell; `promised` is the bound [m]."""
        self._forest, self._promised = Forest(cell), promised
        parts = [cell.parts[i] for i in members]
        found = [self._forest.body_of(p.prefix + p.config.mechanism.tip_link) for p in parts]
        self._joints = np.array([body - 1 for body, _ in found])
        self._T_body_wrist = [T for _, T in found]

    def carried(self, views: Sequence[Pose]) -> Carried:
        """Return where each arm has the MRF; `views` are their T_wrist_mrf."""
        in_body = [T @ view for T, view in zip(self._T_body_wrist, views, strict=True)]
        return np.array([T.R for T in in_body]), np.array([T.p for T in in_body])

    def shortfall(self, stop: Stop, carried: Carried, grasps: Array, giving_way: float) -> float:
        """Return by how much grasps move apart more than is promised [m], 0 for not.

        `carried` is where each arm has the MRF, `grasps` (k, 3) where the grasps are in it [m].
        `giving_way` is the relative speed that force control asks for [m/s]: coming to rest from
        that is no stretch.
        """
        to_go_s = stop.to_go_s
        if to_go_s <= 0.0:
            return 0.0
        samples = min(MOST_SAMPLES, 2 + int(to_go_s / STEP_S))
        times = np.arange(samples, dtype=np.float64) * (to_go_s / (samples - 1))
        times[-1] = to_go_s
        frames = self._forest.frames(stop.postures(times))
        places = np.empty((samples, len(self._joints), len(grasps), 3))
        most = _most_apart(frames, self._joints, *carried, grasps, places)
        allowed = self._promised + 0.5 * giving_way * to_go_s
        return max(0.0, math.sqrt(most) - allowed)


def relative_speed(twists: Sequence[Array]) -> float:
    """Return the greatest difference in speed [m/s] of two twists (6,)."""
    most = 0.0
    for i, a in enumerate(twists):
        for b in twists[:i]:
            apart = (a - b)[:3]
            most = max(most, float(apart @ apart))
    return math.sqrt(most)


@compiled(ARRAY4, INDEX, ARRAY3, MATRIX, MATRIX, BLOCK)
def _most_apart(
    frames: Array, joints: Index, R: Array, p: Array, grasps: Array, places: Array
) -> float:
    """Return the greatest square [m²] of how far two arms take one point of the payload apart.

    Each of k arms carries the points (j, 3) [m], where they are at `R` (k, 3, 3) and `p` (k, 3) in
    the body that a joint moves; `frames` (s, n, 3, 4) are the joints' frames at s instants, the
    first of which is what counts from. Places (s, k, j, 3) are filled in.
    """
    samples, arms, points, _ = places.shape
    for arm in range(arms):
        for point in range(points):
            for i in range(3):
                in_body = p[arm, i]
                for axis in range(3):
                    in_body += R[arm, i, axis] * grasps[point, axis]
                places[0, arm, point, i] = in_body
            x, y, z = places[0, arm, point, 0], places[0, arm, point, 1], places[0, arm, point, 2]
            joint = joints[arm]
            for s in range(samples):
                for i in range(3):
                    places[s, arm, point, i] = (
                        frames[s, joint, i, 0] * x
                        + frames[s, joint, i, 1] * y
                        + frames[s, joint, i, 2] * z
                        + frames[s, joint, i, 3]
                    )
    most = 0.0
    for arm in range(1, arms):
        for other in range(arm):
            for point in range(points):
                for s in range(1, samples):
                    square = 0.0
                    for i in range(3):
                        way = places[s, arm, point, i] - places[s, other, point, i]
                        way -= places[0, arm, point, i] - places[0, other, point, i]
                        square += way * way
                    most = max(most, square)
    return most
