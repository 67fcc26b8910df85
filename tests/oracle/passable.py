"""Judge of whether an arm can go through a tunnel at all, from the curve alone.

The curve is integrated step by step, at many free lengths. Its curvature must be within what joints
can bend, its chords within the walls, and nothing of it near to what is elsewhere on the way: the
free part to the walls, and tunnel and arm to themselves. A gap between tunnels is crossed where a
Bézier curve of its length is no sharper than the joints take.
"""

import math

import numpy as np
from telerobot.config.schema.mechanism import BackboneSection

from .gap import crossing, sharpest_of
from .poses import Array, matrix
from .tunnel import STEP, Tunnel

LENGTHS = 12
"""So many free lengths are looked at [1]."""
SPARE = 0.012
"""Room that is asked for beyond all radii [m]."""
BEND = 0.9
"""Part of the joints' range that the curve may take [1]."""
APART = 0.12
"""Points that are so far apart along the arm are not to meet [m]."""


def passable(
    section: BackboneSection, link: float, length: float, most: float, thickness: float, base: Array
) -> bool:
    """Return whether an arm of links [m] with joints up to `most` [rad] goes through a tunnel.

    `length` is the arm's [m], `thickness` the walls' [m], and `base` (3,) its first joint in World.
    """
    per_joint = link if section.axes == "planar" else 2.0 * link
    sharpest = max(math.hypot(s.bend, s.climb) / s.length for s in section.tunnel)
    if sharpest * per_joint > BEND * most:
        return False
    if 0.125 * sharpest * per_joint**2 > 0.6 * (section.half_width - section.link_radius):
        return False
    tunnel = _whole(section, BEND * most / per_joint)
    if tunnel is None:
        return False
    outer = section.half_width + thickness
    if _meets(tunnel, 2.0 * outer, 4.0 * outer):
        return False
    h = float(np.linalg.norm(np.array(section.entrance.xyz) - base))
    for s1 in np.linspace(max(section.least, 1.0001 * h), length, LENGTHS):
        free = _free(section, base, float(s1), h)
        angle = np.linalg.norm(np.diff(free, n=2, axis=0), axis=1) / STEP**2
        if float(angle.max()) * per_joint > BEND * most:
            return False
        beyond = tunnel[round(2.0 * section.half_width / STEP) :]
        near = outer + section.link_radius + SPARE
        away = free[: -max(1, round(near / STEP))]
        if _least(away, beyond) < near or _meets(free, 2.0 * section.link_radius + SPARE, APART):
            return False
    return True


def _whole(section: BackboneSection, sharpest: float) -> Array | None:
    """Return points (k, 3) of tunnels and of what crosses their gaps; None where nothing does."""
    rows: list[Array] = []
    for i, piece in enumerate(section.tunnel):
        if piece.to is None:
            continue
        before = section.model_copy(update={"tunnel": section.tunnel[:i]})
        R, p = Tunnel(before).end
        T = matrix(piece.to)
        ends = np.stack((p, R[:, 0])), np.stack((T[:3, 3], T[:3, 0]))
        gap = crossing(*ends, piece.length, STEP)
        if gap is None or sharpest_of(gap) > sharpest:
            return None
        rows.append(gap[1:-1])
    walls = Tunnel(section).rows
    between = [row for pair in zip(walls, [*rows, None], strict=True) for row in pair]
    return np.vstack([row for row in between if row is not None])


def _free(section: BackboneSection, base: Array, s1: float, h: float) -> Array:
    """Return points (k, 3) of the free curve, whose amplitude is found by bisection."""
    share = np.arange(0.5 * STEP, s1, STEP) / s1
    modes = (1.0,) if section.exterior == "bessel" else section.modes
    waves = [c * np.sin(2.0 * math.pi * (m + 1) * share) for m, c in enumerate(modes)]
    shape = np.sum(waves, axis=0)
    low, high = 0.0, 2.404 / float(np.abs(shape).max())
    for _ in range(40):
        mu = 0.5 * (low + high)
        ahead = float(np.cos(mu * shape).mean()) * s1
        low, high = (mu, high) if ahead > h else (low, mu)
    theta = mu * shape
    R = matrix(section.entrance)[:3, :3]
    turns = [(p.bend, p.climb) for p in section.tunnel if p.bend or p.climb]
    bend, climb = turns[0] if turns else (1.0, 0.0)
    bow = section.bow
    if bow is None:
        bow = math.atan2(-climb, -bend) + (0.0 if section.axes == "planar" else 0.25 * math.pi)
    aside = R @ np.array([0.0, math.cos(bow), math.sin(bow)])
    steps = np.outer(np.cos(theta), R[:, 0]) + np.outer(np.sin(theta), aside)
    return np.asarray(base + STEP * np.cumsum(steps, axis=0))


def _least(one: Array, other: Array) -> float:
    """Return the least distance between two rows of points [m]."""
    if not len(one) or not len(other):
        return math.inf
    squares = (one**2).sum(axis=1)[:, None] + (other**2).sum(axis=1) - 2.0 * one @ other.T
    return math.sqrt(max(0.0, float(squares.min())))


def _meets(points: Array, near: float, apart: float) -> bool:
    """Return whether a row of points comes near to itself, farther apart along it."""
    squares = (points**2).sum(axis=1)[:, None] + (points**2).sum(axis=1) - 2.0 * points @ points.T
    i = np.arange(len(points))
    far = np.abs(i[:, None] - i) * STEP > apart
    return bool((squares[far] < near * near).any()) if far.any() else False
