"""Which cells of a contour are forbidden, because links project on them (Zhang, eqs. 12 and 13).

Two readings: with the cells that a segment crosses and their neighbours, as printed; and with all
cells within a reach of it, since one neighbour of 50 mm is too thin for a real housing.
"""

from typing import Final, NamedTuple

import numpy as np

from ...control.compiled import COUNT, MATRIX, NUMBER, TABLE, VECTOR, compiled
from ...control.scene import Flags
from ...control.spatial import Array
from .contour import CellPlane, Contour


class Obstacles(NamedTuple):
    """Rectangles of the k occupied cells of a contour."""

    low: Array
    """Least y, z of each (k, 2) [m]."""
    high: Array
    """Greatest y, z (k, 2) [m]."""
    near: Array
    """Depths at which they begin (k,) [m]."""

    @staticmethod
    def of(contour: Contour, plane: CellPlane) -> "Obstacles":
        """Return the occupied cells, without the strips inside their borders that are free."""
        i, j = np.nonzero(~np.isnan(contour.nearest))
        low = np.stack([j * plane.cell - 0.5 * plane.width, i * plane.cell], axis=1)
        high = low + plane.cell
        if contour.free is not None:
            below, above, right, left = contour.free[:, i, j]
            low, high = low + np.stack([right, below], 1), high - np.stack([left, above], 1)
        return Obstacles(low, high, contour.nearest[i, j])

    @staticmethod
    def behind(contour: Contour, plane: CellPlane) -> "Obstacles":
        """Return the occupied cells of what is passed: depths are those at which they end."""
        found = Obstacles.of(contour, plane)
        return found._replace(near=contour.farthest[~np.isnan(contour.nearest)])

    def lifted(self, by: float) -> "Obstacles":
        """Return them so much higher [m]."""
        up = np.array([0.0, by])
        return Obstacles(self.low + up, self.high + up, self.near)

    def beside(self, others: "Obstacles") -> "Obstacles":
        """Return these and others."""
        return Obstacles(*(np.concatenate(pair) for pair in zip(self, others, strict=True)))

    def within(self, least: float, most: float) -> "Obstacles":
        """Return those that begin beyond one depth, and no farther than another [m]."""
        which = (self.near > least) & (self.near <= most)
        return self if which.all() else Obstacles(*(part[which] for part in self))


NOTHING: Final = Obstacles(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
"""No obstacle at all."""


def crossed(start: Array, end: Array, plane: CellPlane) -> Flags:
    """Return the cells (rows, columns) that a projected segment touches, and their neighbours.

    From y, z (2,) to y, z (2,) [m] (eq. 12).
    """
    rows, columns = plane.shape
    wide = np.zeros((rows + 2, columns + 2), dtype=bool)
    cuts = [0.0, 1.0]
    way = end - start
    for axis, origin in ((0, -0.5 * plane.width), (1, 0.0)):
        if abs(way[axis]) > 1e-12:
            ends = np.sort([start[axis] - origin, end[axis] - origin]) / plane.cell
            borders = np.arange(np.ceil(ends[0] - 1e-9), np.floor(ends[1] + 1e-9) + 1)
            cuts += ((borders * plane.cell + origin - start[axis]) / way[axis]).tolist()
    at = np.unique(np.clip(cuts, 0.0, 1.0))
    # The middle between two borders is inside of a cell; ends and borders belong to the cell above.
    for t in np.concatenate([at, 0.5 * (at[:-1] + at[1:])]).tolist():
        y, z = (start + t * way).tolist()
        i, j = plane.cell_of(y, z)
        if -1 <= i <= rows and -1 <= j <= columns:
            wide[i + 1, j + 1] = True
    grown = np.zeros_like(wide)
    for di in (-1, 0, 1):
        for dj in (-1, 0, 1):
            grown |= np.roll(np.roll(wide, di, axis=0), dj, axis=1) if di or dj else wide
    return grown[1:-1, 1:-1]


def forbidden(start: Array, end: Array, plane: CellPlane, reach: float) -> Flags:
    """Return the cells (rows, columns) of which any point is within `reach` of a segment [m]."""
    rows, columns = plane.shape
    i, j = (index.ravel() for index in np.indices((rows, columns)))
    low = np.stack([j * plane.cell - 0.5 * plane.width, i * plane.cell], axis=1)
    found = np.empty((2, len(low)))
    _distances(start, end, low, low + plane.cell, found)
    near: Flags = (found[0] <= reach).reshape(rows, columns)
    return near


def interference(contour: Contour, area: Flags) -> Array:
    """Return the contour where cells are forbidden, NaN elsewhere (eq. 13)."""
    return np.where(area, contour.nearest, np.nan)


def clearance(points: Array, obstacles: Obstacles) -> float:
    """Return the least distance of projected links from obstacles [m]; inf where there are none.

    The links lead from point to point (m, 3) [m].
    """
    return float(clearances(points, obstacles).min(initial=np.inf))


def clearances(points: Array, obstacles: Obstacles) -> Array:
    """Return the distances (k,) [m] of obstacles from the nearest projected link."""
    found = np.empty((len(points), len(obstacles.near)))
    for m in range(len(points) - 1):
        _distances(
            points[m, 1:], points[m + 1, 1:], obstacles.low, obstacles.high, found[m : m + 2]
        )
    least: Array = found[:-1].min(axis=0, initial=np.inf)
    return least


@compiled(VECTOR, VECTOR, MATRIX, MATRIX, TABLE)
def _distances(start: Array, end: Array, low: Array, high: Array, found: Array) -> None:
    """Write the distances of rectangles from a segment into the first row."""
    wy, wz = end[0] - start[0], end[1] - start[1]
    length = wy * wy + wz * wz
    for k in range(low.shape[0]):
        # Does it cross the rectangle? Clip it, side by side.
        t0, t1 = 0.0, 1.0
        for a in range(2):
            w = wy if a == 0 else wz
            before, behind = low[k, a] - start[a], high[k, a] - start[a]
            if abs(w) < 1e-12:
                if before > 0.0 or behind < 0.0:
                    t1 = -1.0
            else:
                t0 = max(t0, min(before / w, behind / w))
                t1 = min(t1, max(before / w, behind / w))
        if t0 <= t1:
            found[0, k] = 0.0
            continue
        best = np.inf
        for e in range(2):  # ends of the segment from the rectangle
            y = start[0] + e * wy
            z = start[1] + e * wz
            dy = max(0.0, low[k, 0] - y, y - high[k, 0])
            dz = max(0.0, low[k, 1] - z, z - high[k, 1])
            best = min(best, dy * dy + dz * dz)
        for c in range(4):  # its corners from the segment
            y = (low[k, 0] if c % 2 == 0 else high[k, 0]) - start[0]
            z = (low[k, 1] if c < 2 else high[k, 1]) - start[1]
            t = 0.0 if length <= 0.0 else min(1.0, max(0.0, (y * wy + z * wz) / length))
            best = min(best, (y - t * wy) ** 2 + (z - t * wz) ** 2)
        found[0, k] = np.sqrt(best)


NODES_PER_CELL = 4
"""Nodes of a field of distances along the side of a cell [1]."""


def distance_field(obstacles: Obstacles, plane: CellPlane) -> Array:
    """Return the distance [m] of nodes from the nearest obstacle, a quarter of a cell apart.

    (4 rows + 1, 4 columns + 1); at most 10.
    """
    rows, columns = plane.shape
    field = np.full((NODES_PER_CELL * rows + 1, NODES_PER_CELL * columns + 1), 100.0)
    _field(obstacles.low, obstacles.high, plane.cell / NODES_PER_CELL, -0.5 * plane.width, field)
    found: Array = np.sqrt(field)
    return found


@compiled(MATRIX, MATRIX, NUMBER, NUMBER, TABLE)
def _field(low: Array, high: Array, step: float, left: float, field: Array) -> None:
    for i in range(field.shape[0]):
        for j in range(field.shape[1]):
            y, z = left + j * step, i * step
            for k in range(low.shape[0]):
                dy = max(0.0, low[k, 0] - y, y - high[k, 0])
                dz = max(0.0, low[k, 1] - z, z - high[k, 1])
                field[i, j] = min(field[i, j], dy * dy + dz * dz)


@compiled(MATRIX, MATRIX, TABLE, NUMBER, NUMBER, NUMBER, COUNT, TABLE)
def free_links(
    starts: Array,
    ends: Array,
    field: Array,
    step: float,
    left: float,
    reach: float,
    pieces: int,
    found: Array,
) -> None:
    """Write 0 into `found` (1, s) for links from (s, 3) to (s, 3) nearer than `reach` to anything.

    What is outside of the plane is free: nothing is known there. Rows that are 0 already are left.
    """
    for k in range(starts.shape[0]):
        if found[0, k] == 0.0:
            continue
        for m in range(pieces + 1):
            t = m / pieces
            y = (starts[k, 1] + t * (ends[k, 1] - starts[k, 1]) - left) / step
            z = (starts[k, 2] + t * (ends[k, 2] - starts[k, 2])) / step
            i, j = int(np.floor(z)), int(np.floor(y))
            if i < 0 or j < 0 or i >= field.shape[0] - 1 or j >= field.shape[1] - 1:
                continue
            a, b = z - i, y - j
            d = (1.0 - a) * ((1.0 - b) * field[i, j] + b * field[i, j + 1])
            d += a * ((1.0 - b) * field[i + 1, j] + b * field[i + 1, j + 1])
            if d < reach:
                found[0, k] = 0.0
                break
