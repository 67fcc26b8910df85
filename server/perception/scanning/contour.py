"""Contour ahead of the arm: the nearest obstacle in each cell of a plane (Zhang, eq. 11).

The plane is parallel to y and z of the arm's Base, `height` from Base upwards and `width` about it.
NaN is nothing: the paper's 0 would be an obstacle at the shoulder.
"""

from typing import Final, NamedTuple

import numpy as np

from ...control.compiled import MATRIX, NUMBER, TABLE, VECTOR, compiled
from ...control.spatial import Array

INSIDE: Final = 0.012
"""A hit so far inside of its cell is an inner one [m]: the scanner's noise."""
LEAST_HITS: Final = 2.0
"""Hits that an occupied cell has at least [1]."""
LEAST_SHARE: Final = 0.15
"""Inner hits of an occupied cell, of those of its fullest neighbour [1]: tails of noise add up."""

LEAST_TAIL: Final = 0.6
"""Hits of an occupied cell away from a border, of those in its fuller neighbour near that [1].

A surface at the border, seen straight, leaves 16 % of its hits there and 34 % in the other strip;
one that is 10 mm inside 42 % and 17 %.
"""
STRIPS: Final = 10
"""Strips along each side of a cell, in which hits are counted: edges lie between two [1]."""
EDGE: Final = 0.005
"""An edge inside a cell may be so far outside of its outermost hits [m]: rays are apart."""
LEAST_EDGE_HITS: Final = 10.0
"""A cell with fewer hits is taken to be full [1]."""
NOISE_SHARE: Final = 0.03
"""Of the hits of a cell, so many are beyond an edge by noise [1]."""


class CellPlane(NamedTuple):
    """Cells of the plane, and how far ahead of Base what fills them is collected."""

    width: float = 2.0
    height: float = 1.0
    cell: float = 0.05
    collect: float = 3.0

    @property
    def shape(self) -> tuple[int, int]:
        """Rows, upwards, and columns, from right to left."""
        return round(self.height / self.cell), round(self.width / self.cell)

    def cell_of(self, y: float, z: float) -> tuple[int, int]:
        """Return row and column of a point, from 0; they may be outside of the plane."""
        # A point on a border is in the cell above, whatever its last bit says.
        return (
            int(np.floor(z / self.cell + 1e-9)),
            int(np.floor((y + 0.5 * self.width) / self.cell + 1e-9)),
        )


class Contour(NamedTuple):
    """The nearest and farthest obstacle of each cell (rows, columns), ahead of Base [m]; or NaN."""

    nearest: Array
    farthest: Array
    free: Array | None = None
    """Width of the empty strip inside each border of a cell (4, rows, columns) [m].

    Borders in the order of `WAYS`; None: cells are full.
    """


def contour_of(points: Array, hits: Array, plane: CellPlane, rear: float) -> Contour:
    """Return the contour of n points (n, 3) [m] in the arm's Base, seen `hits` (n,) times each.

    What is behind `rear` [m] is passed. A cell is occupied if it was hit at least twice, once well
    inside, not so rarely that a neighbour's noise explains it, and not by the tail of a surface
    that lies on the border: that is the fuller neighbour's.
    """
    rows, columns = plane.shape
    counts = np.zeros((COUNTS, rows * columns))
    strips = np.zeros((2 * STRIPS, rows * columns))
    nearest = np.full((rows, columns), np.inf)
    farthest = np.full((rows, columns), -np.inf)
    _count(points, hits, rear, *plane, counts, strips, nearest, farthest)
    every, inner, across, up, *edges = counts.reshape(COUNTS, rows, columns)
    halves = edges[4:]
    fullest = np.maximum.reduce([_beside(inner, *way) for way in WAYS])
    occupied = (every >= LEAST_HITS) & (inner >= 1.0) & (inner >= LEAST_SHARE * fullest)
    # The edge of the neighbour on one side is the one that it has on the other; and what is in a
    # cell's other half is nobody's tail.
    for way, opposite, middle in zip(WAYS, (1, 0, 3, 2), (up, up, across, across), strict=True):
        edge = _beside(edges[opposite], *way)
        tail = (middle < LEAST_TAIL * edge) & (halves[opposite] < LEAST_SHARE * edge)
        occupied &= ~(tail & (every < _beside(every, *way)))
    free = _free_strips(strips.reshape(2, STRIPS, rows, columns), every, plane.cell)
    for strip, way in zip(free, WAYS, strict=True):
        strip[_beside(occupied, *way)] = 0.0  # between two cells of one surface nothing is free
    return Contour(np.where(occupied, nearest, np.nan), np.where(occupied, farthest, np.nan), free)


COUNTS: Final = 12
"""Counts of a cell: all hits, inner ones, those away from the sides, those away from top and
bottom, those near its lower, upper, right, left edge, and those in these halves of it [1]."""
WAYS: Final = ((-1, 0), (1, 0), (0, -1), (0, 1))
"""To the neighbours below, above, right, left, by rows and columns."""


def _free_strips(strips: Array, every: Array, cell: float) -> Array:
    """Return how wide the empty strips inside the borders of cells are (4, rows, columns) [m].

    `strips` (2, `STRIPS`, rows, columns) are the hits in each, upwards and to the left.
    """
    free = np.empty((len(WAYS), *every.shape))
    for axis, hits in enumerate(strips):
        for end, ordered in enumerate((hits, hits[::-1])):
            beyond = np.cumsum(ordered, axis=0) < NOISE_SHARE * every
            free[2 * axis + end] = beyond.sum(axis=0) * (cell / STRIPS) - EDGE
    free[:, every < LEAST_EDGE_HITS] = 0.0
    return np.maximum(free, 0.0)


def _beside(values: Array, row: int, column: int) -> Array:
    """Return the values (rows, columns) of neighbours; 0 outside of the plane."""
    wide = np.pad(values, 1)
    rows, columns = values.shape
    return wide[1 + row : 1 + row + rows, 1 + column : 1 + column + columns]


@compiled(
    MATRIX, VECTOR, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, TABLE, TABLE, TABLE, TABLE
)  # fmt: skip
def _count(
    points: Array,
    hits: Array,
    rear: float,
    width: float,
    height: float,
    cell: float,
    collect: float,
    counts: Array,
    strips: Array,
    nearest: Array,
    farthest: Array,
) -> None:
    rows, columns = nearest.shape
    for k in range(points.shape[0]):
        x, y, z = points[k, 0], points[k, 1] + 0.5 * width, points[k, 2]
        if not (rear < x < collect and 0.0 <= y < width and 0.0 <= z < height):
            continue
        i, j = min(int(z / cell), rows - 1), min(int(y / cell), columns - 1)
        at, dz, dy = i * columns + j, z - i * cell, y - j * cell
        counts[0, at] += hits[k]
        strips[min(int(STRIPS * dz / cell), STRIPS - 1), at] += hits[k]
        strips[STRIPS + min(int(STRIPS * dy / cell), STRIPS - 1), at] += hits[k]
        across = min(dy, cell - dy) >= INSIDE
        up = min(dz, cell - dz) >= INSIDE
        if across:
            counts[2, at] += hits[k]
        if up:
            counts[3, at] += hits[k]
        if dz < INSIDE:
            counts[4, at] += hits[k]
        if cell - dz < INSIDE:
            counts[5, at] += hits[k]
        if dy < INSIDE:
            counts[6, at] += hits[k]
        if cell - dy < INSIDE:
            counts[7, at] += hits[k]
        half = 0.5 * cell
        counts[8 if dz < half else 9, at] += hits[k]
        counts[10 if dy < half else 11, at] += hits[k]
        if across and up:
            counts[1, at] += hits[k]
            nearest[i, j] = min(nearest[i, j], x)
            farthest[i, j] = max(farthest[i, j], x)
