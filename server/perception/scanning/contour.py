"""Contour ahead of the arm, the boxes around it, and which of its cells links project on."""

import math
from typing import Final, NamedTuple

import numpy as np

from ...control.compiled import ARRAY4, COUNT, MATRIX, NUMBER, TABLE, VECTOR, compiled
from ...control.scene import Flags
from ...control.spatial import Array

# --- Contour ahead of the arm: the nearest obstacle in each cell of a plane (Zhang, eq. 11) -------
#
# The plane is parallel to y and z of the arm's Base, `height` from Base upwards and `width`
# about it. NaN is nothing: the paper's 0 would be an obstacle at the shoulder.

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


def along_arc(points: Array, foot: Array, curvature: float) -> Array:
    """Return points (n, 3) as a base meets them that drives on an arc, left if positive [1/m].

    Points and what is returned are as if seen from the `foot` (3,) of its arm in Base [m]: x is the
    arc's length, y how far to the left of it. A part of the base on its middle line, x ahead of
    Base, is x² / 2 times the curvature to the outer side there, to second order.
    """
    if curvature == 0.0:
        return points
    radius, side = 1.0 / curvature, math.copysign(1.0, curvature)
    x, y = points[:, 0] + foot[0], radius - points[:, 1] - foot[1]
    found = points.copy()
    found[:, 0] = radius * np.arctan2(side * x, side * y) - foot[0]
    found[:, 1] = radius - side * np.hypot(x, y) - foot[1]
    return found


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


@compiled(ARRAY4, MATRIX, NUMBER)
def _free_strips(strips: Array, every: Array, cell: float) -> Array:
    """Return how wide the empty strips inside the borders of cells are (4, rows, columns) [m].

    `strips` (2, `STRIPS`, rows, columns) are the hits in each, upwards and to the left.
    """
    rows, columns = every.shape
    free = np.zeros((4, rows, columns))
    for way in range(4):
        for i in range(rows):
            for j in range(columns):
                empty, hits = 0, 0.0
                if every[i, j] < LEAST_EDGE_HITS:
                    continue
                for k in range(STRIPS):
                    hits += strips[way // 2, STRIPS - 1 - k if way % 2 else k, i, j]
                    if hits >= NOISE_SHARE * every[i, j]:
                        break
                    empty += 1
                free[way, i, j] = max(empty * (cell / STRIPS) - EDGE, 0.0)
    return free


def _beside(values: Array, row: int, column: int) -> Array:
    """Return the values (rows, columns) of neighbours; 0 outside of the plane."""
    rows, columns = values.shape
    wide = np.zeros((rows + 2, columns + 2), values.dtype)
    wide[1:-1, 1:-1] = values
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


# --- Boxes around the occupied cells of a contour: at most so many, with few empty cells in them

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


# --- Which cells of a contour are forbidden, because links project on them (Zhang, eqs. 12 and 13)
#
# Two readings: with the cells that a segment crosses and their neighbours, as printed; and with
# all cells within a reach of it, since one neighbour of 50 mm is too thin for a real housing.


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

    def wider(self, right: float, left: float) -> "Obstacles":
        """Return them so much wider on either side [m]."""
        return self._replace(
            low=self.low - np.array([right, 0.0]), high=self.high + np.array([left, 0.0])
        )

    def beside(self, others: "Obstacles") -> "Obstacles":
        """Return these and others."""
        return Obstacles(*(np.concatenate(pair) for pair in zip(self, others, strict=True)))

    def within(self, least: float, most: float) -> "Obstacles":
        """Return those that begin beyond one depth, and no farther than another [m]."""
        which = (self.near > least) & (self.near <= most)
        return self if which.all() else Obstacles(*(part[which] for part in self))


NOTHING: Final = Obstacles(np.empty((0, 2)), np.empty((0, 2)), np.empty(0))
"""No obstacle at all."""


def forbidden(start: Array, end: Array, plane: CellPlane, reach: float) -> Flags:
    """Return the cells (rows, columns) of which any point is within `reach` of a segment [m]."""
    rows, columns = plane.shape
    i, j = (index.ravel() for index in np.indices((rows, columns)))
    low = np.stack([j * plane.cell - 0.5 * plane.width, i * plane.cell], axis=1)
    found = np.empty((2, len(low)))
    _distances(start, end, low, low + plane.cell, found)
    near: Flags = (found[0] <= reach).reshape(rows, columns)
    return near


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
