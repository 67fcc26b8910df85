"""Curves over gaps between tunnels, by other means than the server's: cubic Bézier curves."""

import math

import numpy as np

from .poses import Array

FINE = 400
"""A curve is measured by so many chords [1]."""
HANDLES = (0.2, 3.0)
"""Of a Bézier curve, in lengths of its chord [1]."""


def crossing(begin: Array, end: Array, length: float, step: float) -> Array | None:
    """Return points (k, 3), a step [m] apart, of a curve over a gap; None where there is none.

    `begin` and `end` are place and tangent (2, 3) there; both handles are what gives the length.
    """
    chord = float(np.linalg.norm(end[0] - begin[0]))
    low, high = (share * chord for share in HANDLES)
    if not _length(_bezier(begin, end, low)) < length < _length(_bezier(begin, end, high)):
        return None
    for _ in range(40):
        middle = 0.5 * (low + high)
        if _length(_bezier(begin, end, middle)) < length:
            low = middle
        else:
            high = middle
    fine = _bezier(begin, end, low)
    way = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))))
    at = np.linspace(0.0, way[-1], max(3, math.ceil(length / step)) + 1)
    return np.column_stack([np.interp(at, way, fine[:, i]) for i in range(3)])


def sharpest_of(points: Array) -> float:
    """Return the greatest curvature [1/m] of a row of points (k, 3), chord by chord."""
    ways = np.diff(points, axis=0)
    lengths = np.linalg.norm(ways, axis=1)
    tangents = ways / lengths[:, None]
    turns = np.linalg.norm(np.diff(tangents, axis=0), axis=1)
    return float((turns / lengths[1:]).max())


def _bezier(begin: Array, end: Array, handle: float) -> Array:
    t = np.linspace(0.0, 1.0, FINE + 1)[:, None]
    one, other = begin[0] + handle * begin[1], end[0] - handle * end[1]
    return np.asarray(
        (1 - t) ** 3 * begin[0] + 3 * t * (1 - t) ** 2 * one + 3 * t**2 * (1 - t) * other
        + t**3 * end[0]
    )  # fmt: skip


def _length(points: Array) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
