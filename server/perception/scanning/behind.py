"""Ground that was seen: how far back a base may be driven at speed, where no scanner looks.

Columns of the odometry's frame remember at which heights rays went through them, or ended in them,
and where the base itself has been. Ground that nobody saw, or long ago, counts as taken.
"""

import math
from typing import Final

import numpy as np

from ...control.compiled import (
    FLAGS,
    MATRIX,
    NUMBER,
    STACK,
    TABLE,
    VECTOR,
    compiled,
)
from ...control.scene import Flags
from ...control.spatial import Array, Pose

CELL: Final = 0.1
"""Side of a column, and height of one of its bands [m]."""
BANDS: Final = 12
"""Bands of a column, from `LOWEST` up [1]."""
LOWEST: Final = 0.05
"""What is lower is the floor [m]."""
SIDE: Final = 128
"""Columns along a side; farther on they are used anew [1]."""
FARTHEST: Final = 3.0
"""Rays are followed so far [m]."""
BEFORE_HIT: Final = 0.1
"""A ray says nothing of the last piece before its echo [m]."""
SEEN_S: Final = 60.0
"""Ground is known for so long after it was seen [s]."""
TAKEN: Final = 1.0
"""Echoes that are left of a band in which something stands [1]."""
LOOKS_BACK: Final = 2.0
"""Ground is looked at so far behind the base [m]."""
BESIDE: Final = 0.05
"""And so far beside it [m]."""
STAND_OFF: Final = 0.15
"""The base is slow so far before it [m]."""


class GroundBehind:
    """What is known of the ground around a base of a width, `rear` behind its axle [m]."""

    def __init__(self, width: float, rear: float, height: float) -> None:
        """Build it; the base itself is as high as `height` [m], with its arm above that."""
        half = 0.5 * width + BESIDE
        across = np.linspace(-half, half, 1 + math.ceil(4.0 * half / CELL))
        back = np.arange(0.0, LOOKS_BACK, 0.5 * CELL)
        self._back = back
        self._behind = _grid(-rear - back, across)
        own = np.linspace(-rear, rear, 1 + math.ceil(4.0 * rear / CELL))
        self._own = _grid(own, across).reshape(-1, 3)
        self._own_bands = min(BANDS, math.ceil((height - LOWEST) / CELL))
        self.forget()

    def forget(self) -> None:
        """Know nothing."""
        self._seen_s = np.full((SIDE, SIDE, BANDS), -np.inf)
        self._echoes = np.zeros((SIDE, SIDE, BANDS))
        self._place = np.full((SIDE, 2 * SIDE), np.nan)

    def see(self, p: Array, ends: Array, echo: Flags, own: Flags, time_s: float) -> None:
        """Take in rays from p (3,) to their ends (n, 3) [m], in the odometry's frame.

        `echo` (n,) tells those that end on something; the arm's `own` (n,) tell nothing.
        """
        tables = self._seen_s, self._echoes, self._place
        _follow(p, ends, echo, own, time_s, *tables)

    def stand(self, T_world_base: Pose, time_s: float) -> None:
        """Take in where the base stands: there nothing else does."""
        at = _places(T_world_base, self._own)
        i, j = self._columns(at)
        self._seen_s[i, j] = time_s
        self._echoes[i, j, : self._own_bands] = 0.0

    def room(self, T_world_base: Pose, time_s: float) -> float:
        """Return how far the base may go straight back over ground that was seen [m]."""
        i, j = self._columns(_places(T_world_base, self._behind.reshape(-1, 3)))
        known = (self._seen_s[i, j] >= time_s - SEEN_S).all(axis=1)
        free = known & (self._echoes[i, j] < TAKEN).all(axis=1)
        rows = free.reshape(self._behind.shape[:2]).all(axis=1)
        taken = np.flatnonzero(~rows)
        far = LOOKS_BACK if not len(taken) else float(self._back[taken[0]])
        return max(0.0, far - STAND_OFF)

    def _columns(self, at: Array) -> tuple[Array, Array]:
        """Return the columns (k,), (k,) at places (k, 3); those of another place know nothing."""
        cells = np.floor(at[:, :2] / CELL).astype(np.int64)
        i, j = (cells % SIDE).T
        other = (self._place[i, 2 * j] != cells[:, 0]) | (self._place[i, 2 * j + 1] != cells[:, 1])
        if other.any():
            i_new, j_new = i[other], j[other]
            self._seen_s[i_new, j_new], self._echoes[i_new, j_new] = -np.inf, 0.0
            self._place[i_new, 2 * j_new], self._place[i_new, 2 * j_new + 1] = cells[other].T
        return i, j


def _grid(x: Array, y: Array) -> Array:
    """Return points (x, y, 3) on the floor."""
    found = np.zeros((len(x), len(y), 3))
    found[..., 0], found[..., 1] = x[:, None], y
    return found


def _places(T: Pose, points: Array) -> Array:
    found: Array = points @ T.R.T + T.p
    return found


@compiled(VECTOR, MATRIX, FLAGS, FLAGS, NUMBER, STACK, STACK, TABLE)
def _follow(
    p: Array,
    ends: Array,
    echo: Flags,
    own: Flags,
    time_s: float,
    seen_s: Array,
    echoes: Array,
    place: Array,
) -> None:
    side, bands = seen_s.shape[0], seen_s.shape[2]
    for k in range(ends.shape[0]):
        if own[k] or np.isnan(ends[k, 0]):
            continue
        x, y, z = ends[k, 0] - p[0], ends[k, 1] - p[1], ends[k, 2] - p[2]
        length = np.sqrt(x * x + y * y + z * z)
        if length <= 0.0:
            continue
        most = min(FARTHEST, length - BEFORE_HIT if echo[k] else length)
        steps = int(most / (0.5 * CELL))
        for s in range(steps + 1):
            ends_here = s == steps
            if ends_here and (not echo[k] or length > FARTHEST):
                continue
            t = 1.0 if ends_here else s * 0.5 * CELL / length
            band = int(np.floor((p[2] + t * z - LOWEST) / CELL))
            if band < 0 or band >= bands:
                continue
            a, b = np.floor((p[0] + t * x) / CELL), np.floor((p[1] + t * y) / CELL)
            i, j = int(a) % side, int(b) % side
            if place[i, 2 * j] != a or place[i, 2 * j + 1] != b:
                place[i, 2 * j], place[i, 2 * j + 1] = a, b
                for c in range(bands):
                    seen_s[i, j, c], echoes[i, j, c] = -np.inf, 0.0
            seen_s[i, j, band] = time_s
            if ends_here:
                echoes[i, j, band] = min(5.0, echoes[i, j, band] + 1.0)
            else:
                echoes[i, j, band] *= 0.9
