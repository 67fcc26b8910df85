"""Boxes around the occupied cells of a contour: at most so many, with few empty cells in them."""

from typing import Final, NamedTuple

import numpy as np

from ...control.scene import Flags
from ...control.spatial import Array
from .contour import CellPlane, Contour

MOST: Final = 16
"""Boxes of one contour [1]."""
DEPTH: Final = 0.05
"""An obstacle is at least so thick [m]."""


class CellBox(NamedTuple):
    """Rows and columns of cells, the ends not included, and the depths that they fill."""

    rows: tuple[int, int]
    columns: tuple[int, int]
    near: float
    far: float

    def corners(self, plane: CellPlane) -> tuple[Array, Array]:
        """Return the least and the greatest corner (3,) in the arm's Base [m]."""
        half, cell = 0.5 * plane.width, plane.cell
        return (
            np.array([self.near, self.columns[0] * cell - half, self.rows[0] * cell]),
            np.array([self.far, self.columns[1] * cell - half, self.rows[1] * cell]),
        )


def boxes_of(contour: Contour, most: int = MOST) -> tuple[CellBox, ...]:
    """Return boxes that hold every occupied cell, at most so many.

    Single holes are closed; the largest rectangles come first; then the two are merged that take in
    the fewest empty cells. So what is told is never less than what was seen.
    """
    filled = ~np.isnan(contour.nearest)
    left = filled | _holes(filled)
    areas: list[tuple[int, int, int, int]] = []
    while left.any():
        top, bottom, first, last = _largest(left)
        left[top:bottom, first:last] = False
        areas.append((top, bottom, first, last))
    while len(areas) > most:
        areas = _merged(areas)
    return tuple(_box(contour, area) for area in areas)


def _holes(filled: Flags) -> Flags:
    """Return single empty cells between four occupied ones."""
    holes = np.zeros_like(filled)
    beside = filled[:-2, 1:-1] & filled[2:, 1:-1] & filled[1:-1, :-2] & filled[1:-1, 2:]
    holes[1:-1, 1:-1] = beside & ~filled[1:-1, 1:-1]
    return holes


def _largest(filled: Flags) -> tuple[int, int, int, int]:
    """Return the largest rectangle of occupied cells: rows from, to, columns from, to."""
    rows, columns = filled.shape
    best, found = 0, (0, 0, 0, 0)
    height = np.zeros(columns, dtype=np.int64)
    for row in range(rows):
        height = np.where(filled[row], height + 1, 0)
        stack: list[tuple[int, int]] = []  # first column, height; rising
        for column, high in enumerate([*height.tolist(), 0]):
            first = column
            while stack and stack[-1][1] >= high:
                first, tall = stack.pop()
                if tall * (column - first) > best:
                    best = tall * (column - first)
                    found = (row + 1 - tall, row + 1, first, column)
            stack.append((first, high))
    return found


def _merged(areas: list[tuple[int, int, int, int]]) -> list[tuple[int, int, int, int]]:
    """Return the rectangles with the two merged that add the fewest cells."""
    a = np.array(areas)
    low = np.minimum(a[:, None], a[None])[..., [0, 2]]
    high = np.maximum(a[:, None], a[None])[..., [1, 3]]
    size = (a[:, 1] - a[:, 0]) * (a[:, 3] - a[:, 2])
    more = (high - low).prod(axis=2) - size[:, None] - size[None]
    more[np.tril_indices(len(a))] = np.iinfo(np.int64).max
    i, j = np.unravel_index(int(np.argmin(more)), more.shape)
    both = (*low[i, j].tolist(), *high[i, j].tolist())
    whole = (both[0], both[2], both[1], both[3])
    inside = [
        area
        for area in areas
        if not (
            whole[0] <= area[0]
            and area[1] <= whole[1]
            and whole[2] <= area[2]
            and area[3] <= whole[3]
        )
    ]
    return [*inside, whole]


def _box(contour: Contour, area: tuple[int, int, int, int]) -> CellBox:
    top, bottom, first, last = area
    near = float(np.nanmin(contour.nearest[top:bottom, first:last]))
    far = float(np.nanmax(contour.farthest[top:bottom, first:last]))
    return CellBox((top, bottom), (first, last), near, max(far, near + DEPTH))
