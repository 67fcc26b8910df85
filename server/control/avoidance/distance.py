"""Distances of segments from segments and boxes, in closed form, many pairs in one pass.

All arrays broadcast; points are (..., 3) [m]. The normal points from the second thing to the
first: moving the first along it widens the distance.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..frames import Array

Flags = NDArray[np.bool_]
Index = NDArray[np.int64]

TOUCHING = 1e-9
"""Closer than this there is no direction between nearest points [m]."""

_PARALLEL = 1e-12
"""Sine squared of the angle below which two segments have no one nearest place [1]."""

_TINY = 1e-300


class Near(NamedTuple):
    """Two things' nearest places."""

    distance: Array
    """(...,) [m]; below zero for a segment inside a box: how far it has to come out."""
    normal: Array
    """(..., 3)."""
    place: Array
    """On the first thing (..., 3) [m]."""
    part: Array
    """Where that is on the second thing, if a segment: 0 at its start, 1 at its end (...,)."""


def dot(a: Array, b: Array) -> Array:
    """Return the dot products (...,) of vectors (..., 3)."""
    return np.asarray(np.einsum("...i,...i->...", a, b))


def cross(a: Array, b: Array) -> Array:
    """Return a × b of rows (k, 3), written out: several times quicker than numpy's."""
    c = np.empty_like(a)
    c[:, 0] = a[:, 1] * b[:, 2] - a[:, 2] * b[:, 1]
    c[:, 1] = a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]
    c[:, 2] = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return c


def segments(a: Array, b: Array, c: Array, d: Array) -> Near:
    """Return where segments a–b and c–d are nearest (after Ericson 2005, section 5.1.9)."""
    u, v, r = b - a, d - c, a - c
    uu, vv, uv, ur, vr = dot(u, u), dot(v, v), dot(u, v), dot(u, r), dot(v, r)
    safe_u, safe_v = np.maximum(uu, _TINY), np.maximum(vv, _TINY)
    sine2 = uu * vv - uv * uv
    crossing = sine2 > _PARALLEL * uu * vv
    s = np.where(crossing, (uv * vr - ur * vv) / np.where(crossing, sine2, 1.0), 0.5)
    t = np.clip((uv * np.clip(s, 0.0, 1.0) + vr) / safe_v, 0.0, 1.0)
    s = np.clip((uv * t - ur) / safe_u, 0.0, 1.0)
    place = a + s[..., None] * u
    between = place - (c + t[..., None] * v)
    distance = np.sqrt(dot(between, between))
    normal = between / np.maximum(distance, TOUCHING)[..., None]
    touching = distance < TOUCHING
    if touching.any():
        normal = np.where(touching[..., None], _across(u, v), normal)
    return Near(distance, normal, place, t)


def segments_boxes(a: Array, b: Array, R: Array, centre: Array, half: Array) -> Near:
    """Return where segments a–b are nearest to boxes at R (..., 3, 3), centre, half sides.

    The squared distance along a segment is convex, with a derivative that is linear between the
    places where the segment crosses the planes of the sides.
    """
    p = np.einsum("...ji,...j->...i", R, a - centre)
    u = np.einsum("...ji,...j->...i", R, b - a)
    # Where each coordinate passes a side; what never does is put at the start.
    steep = np.where(np.abs(u) > _TINY, u, np.inf)
    t = np.empty((*u.shape[:-1], 8))
    t[..., 0], t[..., 7] = 0.0, 1.0
    t[..., 1:4], t[..., 4:7] = (-half - p) / steep, (half - p) / steep
    t = np.minimum(np.maximum(t, 0.0), 1.0)
    x = p[..., None, :] + t[..., None] * u[..., None, :]
    sides = half[..., None, :]
    out = x - np.minimum(np.maximum(x, -sides), sides)
    best = _least(t, np.einsum("...ki,...i->...k", out, u))
    x = p + best[..., None] * u
    out = x - np.minimum(np.maximum(x, -half), half)
    distance = np.sqrt(dot(out, out))
    normal = out / np.maximum(distance, TOUCHING)[..., None]
    inside = distance < TOUCHING
    if inside.any():
        distance, normal, best = _pushed_out(p, u, half, inside, distance, normal, best)
    return Near(
        distance,
        np.einsum("...ij,...j->...i", R, normal),
        a + best[..., None] * (b - a),
        np.zeros_like(distance),
    )


def _least(t: Array, slope: Array) -> Array:
    """Return where a convex function is least (...,), by its slopes at places t (..., k).

    Between the last place where it falls and the first where it does not, the slope is linear;
    where it is level all the way between two places, the middle is taken.
    """
    falls = slope < 0.0
    last, first = np.where(falls, t, 0.0).max(axis=-1), np.where(falls, 1.0, t).min(axis=-1)
    down = np.where(falls, slope, -np.inf).max(axis=-1)
    up = np.where(falls, np.inf, slope).min(axis=-1)
    level = up == 0.0
    if level.any():
        end = np.where(slope <= 0.0, t, 0.0).max(axis=-1)
        up = np.where(level, 1.0, up)
        middle = np.where(level, 0.5 * (first + end), 0.0)
    share = 1.0 / (1.0 - up / np.where(np.isinf(down), -_TINY, down))
    place = last + np.where(np.isinf(down), 1.0, share) * (first - last)
    return np.where(level, middle, place) if level.any() else place


def _pushed_out(
    p: Array, u: Array, half: Array, inside: Flags, distance: Array, normal: Array, best: Array
) -> tuple[Array, Array, Array]:
    """Return the shortest way out for segments that cut a box: separating axes, one by one."""
    distance, normal, best = distance.copy(), normal.copy(), best.copy()
    half = np.broadcast_to(half, p.shape)
    for i in np.ndindex(*inside.shape):
        if not inside[i]:
            continue
        axes = [sign * e for e in np.eye(3) for sign in (1.0, -1.0)]
        for e in np.eye(3):
            n = np.array([u[i][1] * e[2] - u[i][2] * e[1], u[i][2] * e[0] - u[i][0] * e[2],
                          u[i][0] * e[1] - u[i][1] * e[0]])  # fmt: skip
            length = float(np.sqrt(n @ n))
            if length > TOUCHING:
                axes += [n / length, -n / length]
        ways = []
        for n in axes:
            start, end = float(n @ p[i]), float(n @ (p[i] + u[i]))
            ways.append(float(np.abs(n) @ half[i]) - min(start, end))
        k = int(np.argmin(ways))
        along = float(axes[k] @ u[i])
        # The end that is deepest; all of it, where the segment lies across the way out.
        best[i] = 0.5 if abs(along) < TOUCHING else float(along < 0.0)
        distance[i], normal[i] = -ways[k], axes[k]
    return distance, normal, best


def _across(u: Array, v: Array) -> Array:
    """Return unit vectors (..., 3) across both u and v, or across u where they are parallel."""
    u, v = np.broadcast_arrays(u, v)
    n = np.cross(u, v)
    k = np.argmin(np.abs(u), axis=-1)
    other = np.cross(u, np.eye(3)[k])
    size = np.sqrt(dot(n, n))[..., None]
    n = np.where(size > TOUCHING * np.sqrt(dot(u, u) * dot(v, v))[..., None], n, other)
    length = np.sqrt(dot(n, n))[..., None]
    up = np.zeros_like(n)
    up[..., 2] = 1.0
    return np.where(length > 0.0, n / np.maximum(length, _TINY), up)
