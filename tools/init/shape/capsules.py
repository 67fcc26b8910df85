"""Capsules around a link's shape: one to three, as tight as a local search finds them.

Each holds all corners of its piece of the shape; pieces are cut by planes, and what lies between
two planes lies in the convex hull of its surface there. So their union holds the shape.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .shapes import Array, LinkMesh, hull_of

WORTH: Final = 0.85
"""Each capsule more has to leave less than this part of the volume that all hold [1]."""
MOST: Final = 3
"""Capsules of a link [1]."""
_CUTS: Final = (0.2, 0.35, 0.5, 0.65, 0.8)
"""Where a shape is cut along an axis, by its length [1]."""
_RADII: Final = np.array([1.0, 1.02, 1.05, 1.1, 1.2, 1.35])
_HERE: Final = np.zeros(4)
_STEPS: Final = (0.3, 0.15, 0.07, 0.03, 0.012, 0.005)
_SPARE: Final = 2e-4
"""Added to every radius: numbers are written with four digits [m]."""
_CORNERS: Final = 240
"""Corners that a search looks at; the end is held against all [1]."""
_TRIANGLES: Final = 600
"""Triangles that a search for cuts looks at [1]."""
_SAMPLES: Final = 20_000


class Tube(NamedTuple):
    """A capsule in a link's frame."""

    start: Array
    end: Array
    radius: float

    def volume(self) -> float:
        """Return its volume [m³]."""
        length = float(np.linalg.norm(self.end - self.start))
        return math.pi * self.radius**2 * (length + 4.0 / 3.0 * self.radius)

    def distance(self, points: Array) -> Array:
        """Return the distances (p,) of points (p, 3) from it, negative inside [m]."""
        along = self.end - self.start
        length2 = max(float(along @ along), 1e-18)
        part = np.clip((points - self.start) @ along / length2, 0.0, 1.0)
        off = points - self.start - part[:, None] * along
        return np.asarray(np.sqrt((off * off).sum(axis=1)) - self.radius)

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """Return which of some points (p, 3) are inside (p,)."""
        return np.asarray(self.distance(points) <= 0.0)


class Fit(NamedTuple):
    """The capsules of a link, and how tight they are."""

    link: str
    tubes: tuple[Tube, ...]
    ratio: float
    """Volume of their union by that of the shape's convex hull [1]; inf for a flat shape."""
    source: str
    """Shape that they hold, in words."""
    holds: tuple[str, ...] = ()
    """Links that have none of their own: these hold their shapes, too."""


def fit(shape: LinkMesh) -> Fit:
    """Return one to three capsules that hold a shape."""
    triangles = shape.triangles
    best: tuple[Tube, ...] = (around(triangles.reshape(-1, 3)),)
    few = extreme(triangles.reshape(-1, 3))
    axes = np.linalg.svd(few - few.mean(axis=0), full_matrices=False)[2]
    coarse = triangles[:: max(1, len(triangles) // _TRIANGLES)]
    for count in range(2, MOST + 1):
        trials = [
            tubes
            for axis in axes
            for cuts in _places(count)
            if (tubes := _in_pieces(coarse, axis, cuts, quick=True))
        ]
        if not trials:
            continue
        quick = min(range(len(trials)), key=lambda i: _volume(trials[i][0]))
        _, along, at = trials[quick]
        exact = _in_pieces(triangles, along, at, quick=False)
        if exact is not None and union(exact[0]) < WORTH ** (count - len(best)) * union(best):
            best = exact[0]
    found = tuple(Tube(t.start.round(4), t.end.round(4), t.radius) for t in best)
    hull = hull_of(extreme(triangles.reshape(-1, 3), 4 * _CORNERS))
    ratio = math.inf if hull is None else union(found) / hull.volume
    source = "its visual shape" if shape.from_visual else "its collision shape"
    return Fit(shape.link, found, ratio, source)


def _places(count: int) -> list[tuple[float, ...]]:
    if count == 2:
        return [(c,) for c in _CUTS]
    return [(0.2, 0.8), (0.33, 0.67), (0.25, 0.5), (0.5, 0.75), (0.15, 0.5), (0.5, 0.85)]


_Pieces = tuple[tuple[Tube, ...], Array, tuple[float, ...]]


def _in_pieces(
    triangles: Array, axis: Array, cuts: tuple[float, ...], *, quick: bool
) -> _Pieces | None:
    """Return the capsules of the pieces between cuts along an axis; None where one is empty."""
    low, high = float((triangles @ axis).min()), float((triangles @ axis).max())
    tubes, rest = [], triangles
    for cut in cuts:
        piece, rest = _cut(rest, axis, low + cut * (high - low))
        if len(piece) == 0 or len(rest) == 0:
            return None
        tubes.append(around(piece.reshape(-1, 3), quick=quick))
    tubes.append(around(rest.reshape(-1, 3), quick=quick))
    return tuple(tubes), axis, cuts


def _cut(triangles: Array, axis: Array, at: float) -> tuple[Array, Array]:
    """Return triangles below and above a plane; those that it crosses are in both, cut there."""
    height = triangles @ axis - at
    below, above = (height <= 0.0).all(axis=1), (height >= 0.0).all(axis=1)
    crossed, h = triangles[~(below | above)], height[~(below | above)]
    sides = []
    for sign in (1.0, -1.0):
        # A corner on the other side slides to the plane, once along each of its edges.
        out = sign * h > 0.0
        for k in range(2):
            moved = crossed.copy()
            for corner in range(3):
                other = (corner + 1 + k) % 3
                use = out[:, corner] & ~out[:, other]
                third = (corner + 2 - k) % 3
                use_third = out[:, corner] & out[:, other] & ~out[:, third]
                for mask, to in ((use, other), (use_third, third)):
                    span = h[mask, corner] - h[mask, to]
                    part = (h[mask, corner] / np.where(span == 0.0, 1.0, span))[:, None]
                    moved[mask, corner] = (1.0 - part) * crossed[mask, corner] + part * crossed[
                        mask, to
                    ]
            sides.append(moved)
    return (
        np.concatenate([triangles[below], sides[0], sides[1]]),
        np.concatenate([triangles[above], sides[2], sides[3]]),
    )


def around(points: Array, *, quick: bool = False) -> Tube:
    """Return a small capsule that holds points (p, 3)."""
    few = extreme(points)
    centre = 0.5 * (few.min(axis=0) + few.max(axis=0))
    size = max(float(np.ptp(few, axis=0).max()), 1e-4)
    axes = np.linalg.svd(few - few.mean(axis=0), full_matrices=False)[2]
    axes = np.concatenate([axes, np.eye(3)]) if not quick else axes
    frames = sorted((_frame(axis) for axis in axes), key=lambda f: _best(few, _HERE, f, centre)[0])
    found = []
    for frame in frames[: 1 if quick else 2]:
        x, cost = _HERE, _best(few, _HERE, frame, centre)[0]
        for step in _STEPS[:: 2 if quick else 1]:
            for _ in range(2 if quick else 4):
                before = cost
                for k in range(4):
                    for sign in (step, -step):
                        y = x.copy()
                        y[k] += sign * (1.0 if k < 2 else size)
                        value = _best(few, y, frame, centre)[0]
                        if value < cost:
                            x, cost = y, value
                            break
                if cost == before:
                    break
        found.append((cost, frame, x))
    _, frame, x = min(found, key=lambda f: f[0])
    return _best(points, x, frame, centre)[1]


def _best(points: Array, x: Array, frame: Array, centre: Array) -> tuple[float, Tube]:
    """Return the least volume of capsules along one line that hold points, and that capsule."""
    axis = frame[2] + x[0] * frame[0] + x[1] * frame[1]
    axis = axis / np.linalg.norm(axis)
    through = centre + x[2] * frame[0] + x[3] * frame[1]
    off = points - through
    along = off @ axis
    apart2 = np.maximum((off * off).sum(axis=1) - along * along, 0.0)
    radius = math.sqrt(float(apart2.max())) * _RADII + 1e-9  # (r,)
    half = np.sqrt(np.maximum(radius[:, None] ** 2 - apart2, 0.0))
    start, end = (along + half).min(axis=1), (along - half).max(axis=1)
    ball = start > end
    middle = 0.5 * (start + end)
    start, end = np.where(ball, middle, start), np.where(ball, middle, end)
    volume = math.pi * radius**2 * (end - start + 4.0 / 3.0 * radius)
    k = int(volume.argmin())
    tube = Tube(through + start[k] * axis, through + end[k] * axis, float(radius[k]) + _SPARE)
    return float(volume[k]), tube


def _frame(axis: Array) -> Array:
    """Return three directions (3, 3), the last of which is `axis`."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(axis, other)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis])


def extreme(points: Array, most: int = _CORNERS) -> Array:
    """Return those of many points that are the farthest in some direction."""
    if len(points) <= most:
        return points
    draw, across = np.random.default_rng(0).normal(size=(most, 3)), points.T.copy()
    found = [(draw[i : i + 16] @ across).argmax(axis=1) for i in range(0, most, 16)]
    return np.asarray(points[np.unique(np.concatenate(found))])


def _volume(tubes: tuple[Tube, ...]) -> float:
    return sum(tube.volume() for tube in tubes)


def union(tubes: tuple[Tube, ...]) -> float:
    """Return the volume of capsules, what they share once [m³]."""
    if len(tubes) == 1:
        return tubes[0].volume()
    low = np.min([np.minimum(t.start, t.end) - t.radius for t in tubes], axis=0)
    high = np.max([np.maximum(t.start, t.end) + t.radius for t in tubes], axis=0)
    points = np.random.default_rng(0).uniform(low, high, size=(_SAMPLES, 3))
    inside = np.any([t.holds(points) for t in tubes], axis=0)
    return float(np.prod(high - low) * inside.mean())
