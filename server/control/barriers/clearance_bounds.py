"""Minimum distances: promises plus tracking errors, margins and motion of obstacles."""

from typing import Final

import numpy as np

from ..compiled import COUNT, COUNTS, INDEX, MATRIX, NUMBER, ROW, TABLE, VECTOR, compiled
from ..scene import Index
from ..spatial import Array

HORIZON_S: Final = 0.4
"""Moving obstacles count if they can be near within this time [s]."""
ROUNDEST: Final = 0.02
"""Paths of links around things are no more curved than a circle with this radius [m]."""


def held(
    tube: Array, gap: Array, promise: Array, speed: Array, between: float
) -> tuple[Array, Array, Index]:
    """Return minimum gaps (k,) [m], floors as if none were held, and which are.

    A gap is held if it is below its minimum, or may be soon since an obstacle moves.
    """
    needed, floor = np.empty(len(gap)), np.empty(len(gap))
    which = np.empty(len(gap), dtype=np.int64)
    count = _hold(tube, gap, promise, speed, between, needed, floor, which)
    return needed, floor, which[:count]


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, NUMBER, ROW, ROW, COUNTS)
def _hold(
    tube: Array, gap: Array, promise: Array, speed: Array, between: float,
    needed: Array, floor: Array, which: Index,
) -> int:  # fmt: skip
    count = 0
    for i in range(len(gap)):
        needed[i], floor[i] = promise[i] + tube[i] + between, np.inf
        if gap[i] < needed[i] + speed[i] * HORIZON_S:
            which[count] = i
            count += 1
    return count


def kept(
    rows: Array, error: Array, gap: Array, promise: Array, speed: Array, nearer: Array,
    margin: float, between: float,
) -> tuple[Array, Array, Array, Array, Index]:  # fmt: skip
    """Return tube and room (k,), as in `Sight`, and what `held` does.

    `error` (n,) [rad] is what joints are behind; `nearer` (1, k) [m], or (0, 0), how much nearer
    pairs may be before the arm is where the command is now.
    """
    k = len(gap)
    tube, room, needed, floor = np.zeros(k), np.empty(k), np.empty(k), np.empty(k)
    which = np.empty(k, dtype=np.int64)
    count = _keep(
        rows, error, gap, promise, speed, nearer, margin, between, tube, room, needed, floor, which
    )
    return tube, room, needed, floor, which[:count]


@compiled(
    MATRIX, VECTOR, VECTOR, VECTOR, VECTOR, MATRIX, NUMBER, NUMBER, ROW, ROW, ROW, ROW, COUNTS
)
def _keep(
    rows: Array, error: Array, gap: Array, promise: Array, speed: Array, nearer: Array,
    margin: float, between: float,
    tube: Array, room: Array, needed: Array, floor: Array, which: Index,
) -> int:  # fmt: skip
    k, n = rows.shape
    for i in range(k):
        for j in range(n):
            tube[i] += abs(rows[i, j]) * abs(error[j])
        room[i] = gap[i] - promise[i] - margin - tube[i]
        if len(nearer):
            room[i] -= nearer[0, i]
    return _hold(tube, gap, promise, speed, between, needed, floor, which)


def wanted(
    count: int, pairs: Index, closer: Array, needed: Array, promise: Array, radii: Array,
    floor: Array, nearer: Array,
) -> Array:  # fmt: skip
    """Return minimum distances (count + 1, p) [m] between segments of `pairs` (p,) along a stop.

    The minimum gap, plus the sagitta of a path that comes `closer` (p,) in `count` steps and is no
    more curved than its radii, plus the approach of obstacles `nearer` (count + 1, k), or (0, 0);
    at most the floor.
    """
    found = np.empty((count + 1, len(pairs)))
    _want(count, pairs, closer, needed, promise, radii, floor, nearer, found)
    return found


@compiled(COUNT, INDEX, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, MATRIX, TABLE)
def _want(
    count: int, pairs: Index, closer: Array, needed: Array, promise: Array, radii: Array,
    floor: Array, nearer: Array, found: Array,
) -> None:  # fmt: skip
    for i in range(len(pairs)):
        k, chord = pairs[i], closer[i] / count
        round_off = chord * chord / (8.0 * max(radii[k] + promise[k], ROUNDEST))
        for s in range(count + 1):
            bound = needed[k] + round_off
            if len(nearer):
                bound += nearer[s, k]
            found[s, i] = min(bound, floor[k]) + radii[k]
