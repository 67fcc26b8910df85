"""Capsules around the shapes of links: fitted, and merged."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from trimesh.intersections import slice_faces_plane

from ...config.urdf.shapes import CORNERS, Array, LinkMesh, Tube, extreme, hull_of, union

# --- Capsules around a link's shape: one to three, as tight as a local search finds them ----------
#
# Each holds all corners of its piece of the shape; pieces are cut by planes, and what lies
# between two planes lies in the convex hull of its surface there. So their union holds the
# shape.
WORTH: Final = 0.85
"""Each capsule more has to leave less than this part of the volume that all hold [1]."""
MOST: Final = 3  # capsules of a link [1]
_CUTS: Final = (0.2, 0.35, 0.5, 0.65, 0.8)  # where a shape is cut along an axis, by its length [1]
_RADII: Final = np.array([1.0, 1.02, 1.05, 1.1, 1.2, 1.35])
_HERE: Final = np.zeros(4)
_STEPS: Final = (0.3, 0.15, 0.07, 0.03, 0.012, 0.005)
_SPARE: Final = 2e-4  # added to every radius: numbers are written with four digits [m]
_TRIANGLES: Final = 600  # triangles that a search for cuts looks at [1]


class Fit(NamedTuple):
    """The capsules of a link, and how tight they are."""

    link: str
    tubes: tuple[Tube, ...]
    ratio: float
    """Volume of their union by that of the shape's convex hull [1]; inf for a flat shape."""
    source: str  # shape that they hold, in words
    holds: tuple[str, ...] = ()  # links that have none of their own: these hold their shapes, too


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
        _, along, at = min(trials, key=lambda trial: sum(tube.volume() for tube in trial[0]))
        exact = _in_pieces(triangles, along, at, quick=False)
        if exact is not None and union(exact[0]) < WORTH ** (count - len(best)) * union(best):
            best = exact[0]
    found = tuple(Tube(t.start.round(4), t.end.round(4), t.radius) for t in best)
    hull = hull_of(extreme(triangles.reshape(-1, 3), 4 * CORNERS))
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


def _cut(triangles: Array, axis: Array, at: float) -> list[Array]:
    """Return the triangles below and above a plane; those that it crosses are cut there."""
    corners = triangles.reshape(-1, 3)
    faces = np.arange(len(corners)).reshape(-1, 3)
    sides = (slice_faces_plane(corners, faces, way, at * axis) for way in (-axis, axis))
    return [np.asarray(corners[faces]) for corners, faces, _ in sides]


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


# --- Fewer capsules for parts that belong to one body: what is near each other gets one for both
#
# A cell has room for so many. Parts that stand need the least detail, so they are merged first;
# a link that is left with no capsule of its own is named by the one that holds it.
MOST_OF_CELL: Final = 64  # capsules of a cell [1]


class Place(NamedTuple):
    """Where a link is: fixed to a body, which the joint of that name moves; none moves ``."""

    body: str
    R: Array
    p: Array


@dataclass(eq=False)
class _Item:
    """One capsule in its body's frame, the link that it is named after, and all that it holds."""

    body: str
    link: str
    tube: Tube
    of: set[str]


def merged(fits: Sequence[Fit], places: Mapping[str, Place], most: int) -> list[Fit]:
    """Return capsules of the same links, at most so many where each body has one left."""
    items = [
        _Item(at.body, fit.link, tube.placed(at.R, at.p), {fit.link})
        for fit, at in ((fit, places[fit.link]) for fit in fits)
        for tube in fit.tubes
    ]
    for may in (lambda body: not body, lambda _body: True):
        while len(items) > most and (pair := _cheapest(items, may)) is not None:
            a, b = pair
            larger = a if a.tube.volume() >= b.tube.volume() else b
            both = _Item(a.body, larger.link, _around_both(a.tube, b.tube), a.of | b.of)
            items = [item for item in items if item not in (a, b)] + [both]
    return _by_link(items, fits, places)


def _cheapest(items: list[_Item], may: Callable[[str], bool]) -> tuple[_Item, _Item] | None:
    """Return the two of one body whose common capsule adds least volume; None for no two."""
    best, least = None, np.inf
    for j, b in enumerate(items):
        for a in items[:j]:
            if a.body == b.body and may(a.body):
                whole = _through_the_ends(a.tube, b.tube).volume()
                added = whole - a.tube.volume() - b.tube.volume()
                if added < least:
                    best, least = (a, b), added
    return best


def _by_link(items: list[_Item], fits: Sequence[Fit], places: Mapping[str, Place]) -> list[Fit]:
    """Return the capsules in the frames of the links that they are named after."""
    named = {item.link for item in items}
    found: list[Fit] = []
    for fit in fits:
        own = [item for item in items if item.link == fit.link]
        if not own:
            continue
        bare = {link for item in own for link in item.of} - named
        told = {link for earlier in found for link in earlier.holds}
        if len(own) == len(fit.tubes) and all(item.of == {fit.link} for item in own):
            found.append(fit)
            continue
        at = places[fit.link]
        # Rounded to four digits in the file: a tenth of a millimetre off, at most.
        tubes = tuple(
            Tube(t.start.round(4), t.end.round(4), t.radius + 1e-4)
            for t in (item.tube.seen_from(at.R, at.p) for item in own)
        )
        source = "its shape and others'" if bare - told else "its shape"
        found.append(Fit(fit.link, tubes, fit.ratio, source, tuple(sorted(bare - told))))
    return found


def _around_both(a: Tube, b: Tube) -> Tube:
    """Return a small capsule that holds two: their balls at the ends are enough."""
    rough, fine = _through_the_ends(a, b), around(np.concatenate([_points(a), _points(b)]))
    fine = _grown(fine.start, fine.end, (a, b))
    return min(rough, fine, key=Tube.volume)


def _through_the_ends(a: Tube, b: Tube) -> Tube:
    """Return the capsule along the longest line between ends of two that holds both."""
    ends = [a.start, a.end, b.start, b.end]
    pairs = [(ends[i], ends[j]) for j in range(4) for i in range(j)]
    start, end = max(pairs, key=lambda pair: float(np.linalg.norm(pair[0] - pair[1])))
    return _grown(start, end, (a, b))


def _grown(start: Array, end: Array, tubes: Sequence[Tube]) -> Tube:
    line = Tube(start, end, 0.0)
    far = [line.distance(np.stack([t.start, t.end])).max() + t.radius for t in tubes]
    return Tube(start, end, float(max(far)) + 1e-4)


def _points(tube: Tube) -> Array:
    """Return points on the surface of a capsule's ends."""
    k = np.arange(40) + 0.5
    up, turn = 1.0 - 2.0 * k / 40.0, np.pi * (1.0 + 5.0**0.5) * k
    level = np.sqrt(1.0 - up * up)
    ball = np.column_stack([level * np.cos(turn), level * np.sin(turn), up]) * tube.radius
    return np.concatenate([tube.start + ball, tube.end + ball])
