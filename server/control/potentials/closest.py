"""The point of a line that is closest to each link, which may stand for the line.

Scott & Carignan, section IV B. Where line and link are parallel no point is closest: the paper
takes the middle of the line, and so it is here, with the jump that the paper reports.
"""

import numpy as np

from ..frames import Array

_PARALLEL = 1e-12
"""Squared sine of the angle below which line and link count as parallel."""
_NONE = 1e-300


def closest_points(p1: Array, p2: Array, start: Array, end: Array) -> Array:
    """Return the points (3, m, l) of segments start–end (3, l) closest to segments p1–p2 (3, m)."""
    u, v = (p2 - p1)[:, :, None], (end - start)[:, None]
    w = p1[:, :, None] - start[:, None]
    uu, vv, uv = (u * u).sum(axis=0), (v * v).sum(axis=0), (u * v).sum(axis=0)
    uw, vw = (u * w).sum(axis=0), (v * w).sum(axis=0)
    square = uu * vv - uv * uv
    parallel = square <= _PARALLEL * uu * vv
    # On the link for the whole lines; then on the line for that point, and back, both bounded.
    s = np.where(parallel, 0.5, (uv * vw - vv * uw) / np.where(parallel, 1.0, square))
    s = np.clip(s, 0.0, 1.0)
    t = np.clip((vw + s * uv) / np.maximum(vv, _NONE), 0.0, 1.0)
    s = np.clip((t * uv - uw) / np.maximum(uu, _NONE), 0.0, 1.0)
    t = np.clip((vw + s * uv) / np.maximum(vv, _NONE), 0.0, 1.0)
    t = np.where(parallel, 0.5, t)
    return np.asarray(start[:, None] + t * v)
