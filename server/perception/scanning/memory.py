"""Memory of points, in the odometry's frame: what the moving arm hides, or the view has lost.

Points that fall into one voxel are one, with the number of times that it was hit. It forgets what
the rays of later scans go through, and what has been passed.
"""

from typing import Final

import numpy as np

from ...control.compiled import COUNT, MATRIX, NUMBER, ROW, VECTOR, compiled
from ...control.scene import Flags
from ...control.spatial import Array

VOXEL: Final = 0.0125
"""Side of a voxel [m]: a quarter of a cell."""
BEYOND: Final = 0.10
"""A ray that goes on so far behind a point went through it [m]: eight times the noise."""
LEAST: Final = 0.4
"""A cell that rays went through until fewer hits are left is forgotten [1]."""
MOST_HITS: Final = 250.0
"""No point counts for more [1]."""
_BITS: Final = 20
_MIDDLE: Final = 1 << (_BITS - 1)


class PointMemory:
    """Points (n, 3) [m] in the odometry's frame, and how often each was hit (n,)."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Know nothing."""
        self.points: Array = np.empty((0, 3))
        self.hits: Array = np.empty(0)

    def add(self, points: Array) -> None:
        """Take in new points (n, 3); NaN is none."""
        points = points[~np.isnan(points[:, 0])]
        every = np.concatenate([self.points, points])
        hits = np.concatenate([self.hits, np.ones(len(points))])
        voxels = np.floor(every / VOXEL).astype(np.int64) + _MIDDLE
        keys = (voxels[:, 0] << 2 * _BITS) | (voxels[:, 1] << _BITS) | voxels[:, 2]
        _, place = np.unique(keys, return_inverse=True)
        count = np.bincount(place, hits)
        sums = [np.bincount(place, hits * axis) for axis in every.T]
        self.points = np.ascontiguousarray((np.stack(sums) / count).T)
        self.hits = np.minimum(count, MOST_HITS)

    def see_through(self, R: Array, p: Array, first: float, step: float, distance: Array) -> None:
        """Forget, by halves, what the rays of a scan go through.

        The scanner has attitude R (3, 3) and place p (3,); rays begin at angle `first`, one every
        `step` [rad]; their distances (n,) [m] are NaN where nothing can be told.
        """
        _see_through(self.points, R, p, first, step, distance, len(distance), self.hits)
        self._keep(self.hits >= LEAST)

    def pass_by(self, R: Array, p: Array, rear: float, far: float) -> None:
        """Forget what is behind `rear`, or further away than `far`, along x of a frame [m]."""
        ahead = (self.points - p) @ R[:, 0]
        self._keep((ahead > rear) & (np.abs(ahead) < far))

    def _keep(self, which: Flags) -> None:
        if not which.all():
            self.points, self.hits = self.points[which], self.hits[which]


@compiled(MATRIX, MATRIX, VECTOR, NUMBER, NUMBER, VECTOR, COUNT, ROW)
def _see_through(
    points: Array,
    R: Array,
    p: Array,
    first: float,
    step: float,
    distance: Array,
    n: int,
    hits: Array,
) -> None:
    for k in range(points.shape[0]):
        wx, wy, wz = points[k, 0] - p[0], points[k, 1] - p[1], points[k, 2] - p[2]
        z = R[0, 2] * wx + R[1, 2] * wy + R[2, 2] * wz
        far = np.sqrt(wx * wx + wy * wy + wz * wz)
        if abs(z) > step * far:  # not in the plane of this scan
            continue
        x = R[0, 0] * wx + R[1, 0] * wy + R[2, 0] * wz
        y = R[0, 1] * wx + R[1, 1] * wy + R[2, 1] * wz
        ray = int(np.floor((np.arctan2(x, -y) - first) / step + 0.5))
        if ray < 1 or ray >= n - 1:
            continue
        # All three rays beside it have to go on: at an edge, one does that misses it.
        through = True
        for i in range(ray - 1, ray + 2):
            through = through and distance[i] > far + BEYOND
        if through:
            hits[k] *= 0.5
