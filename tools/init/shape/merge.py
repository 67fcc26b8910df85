"""Fewer capsules for parts that belong to one body: what is near each other gets one for both.

A cell has room for so many. Parts that stand need the least detail, so they are merged first; a
link that is left with no capsule of its own is named by the one that holds it.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from .capsules import Fit, Tube, around
from .shapes import Array

MOST: Final = 64
"""Capsules of a cell [1]."""


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
        _Item(places[fit.link].body, fit.link, _placed(tube, places[fit.link]), {fit.link})
        for fit in fits
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
        tubes = tuple(_seen_from(item.tube, places[fit.link]) for item in own)
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
    """Return the capsule around a segment that holds others."""
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


def _placed(tube: Tube, at: Place) -> Tube:
    return Tube(at.R @ tube.start + at.p, at.R @ tube.end + at.p, tube.radius)


def _seen_from(tube: Tube, at: Place) -> Tube:
    start, end = (tube.start - at.p) @ at.R, (tube.end - at.p) @ at.R
    # Rounded to four digits in the file: a tenth of a millimetre off, at most.
    return Tube(start.round(4), end.round(4), tube.radius + 1e-4)
