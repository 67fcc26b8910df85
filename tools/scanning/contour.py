"""Contour ahead of the arm: the nearest obstacle in each cell of a plane (Zhang, eq. 11).

The plane is parallel to y and z of the arm's Base, `height` from Base upwards and `width` about it.
NaN is nothing: the paper's 0 would be an obstacle at the shoulder.
"""

from typing import Final, NamedTuple

import numpy as np

from ...server.control.compiled import MATRIX, NUMBER, TABLE, VECTOR, compiled
from ...server.control.spatial import Array

INSIDE: Final = 0.012
"""A hit so far inside of its cell is an inner one [m]: the scanner's noise."""
LEAST_HITS: Final = 2.0
"""Hits that an occupied cell has at least [1]."""
LEAST_SHARE: Final = 0.15
"""Inner hits of an occupied cell, of those of its fullest neighbour [1]: tails of noise add up."""


class Plane(NamedTuple):
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


def contour_of(points: Array, hits: Array, plane: Plane, rear: float) -> Contour:
    """Return the contour of n points (n, 3) [m] in the arm's Base, seen `hits` (n,) times each.

    What is behind `rear` [m] is passed. A cell is occupied if it was hit at least twice, once well
    inside, and not so rarely that a neighbour's noise explains it.
    """
    rows, columns = plane.shape
    counts = np.zeros((2, rows * columns))
    nearest = np.full((rows, columns), np.inf)
    farthest = np.full((rows, columns), -np.inf)
    _count(points, hits, rear, *plane, counts, nearest, farthest)
    every, inner = counts.reshape(2, rows, columns)
    around = np.zeros((rows + 2, columns + 2))
    around[1:-1, 1:-1] = inner
    fullest = np.maximum.reduce(
        [around[:-2, 1:-1], around[2:, 1:-1], around[1:-1, :-2], around[1:-1, 2:]]
    )
    occupied = (every >= LEAST_HITS) & (inner >= 1.0) & (inner >= LEAST_SHARE * fullest)
    return Contour(np.where(occupied, nearest, np.nan), np.where(occupied, farthest, np.nan))


@compiled(
    MATRIX, VECTOR, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, TABLE, TABLE, TABLE
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
    nearest: Array,
    farthest: Array,
) -> None:
    rows, columns = nearest.shape
    for k in range(points.shape[0]):
        x, y, z = points[k, 0], points[k, 1] + 0.5 * width, points[k, 2]
        if not (rear < x < collect and 0.0 <= y < width and 0.0 <= z < height):
            continue
        i, j = min(int(z / cell), rows - 1), min(int(y / cell), columns - 1)
        counts[0, i * columns + j] += hits[k]
        dz, dy = z - i * cell, y - j * cell
        if min(dz, cell - dz, dy, cell - dy) >= INSIDE:
            counts[1, i * columns + j] += hits[k]
            nearest[i, j] = min(nearest[i, j], x)
            farthest[i, j] = max(farthest[i, j], x)
