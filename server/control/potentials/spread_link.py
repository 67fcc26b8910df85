"""A link as charge at a few points along it, in the field of lines and solids.

Scott & Carignan stand a line obstacle for its point closest to each link, and report that it
jumps where line and link are parallel. Here the link is taken apart instead, into the points of a
Gauss–Legendre rule, and each point meets the whole obstacle. A line is uniformly charged, in the
closed form of `charged_link`; a solid acts from its surface, by the distance to it: V = k / d.
The nearest point of a convex body to a point moves steadily and the slope of a distance is its
normal, so that the field is smooth and the torques are the exact slope of the potential.
"""

from typing import NamedTuple

import numpy as np

from ..frames import Array
from .charged_link import Load, pairs

_AT, _WEIGHT = np.polynomial.legendre.leggauss(5)
PART = 0.5 * (_AT + 1.0)
"""Where along a link its points are, 0 to 1 (g,)."""
SHARE = 0.5 * _WEIGHT
"""The part of its charge at each (g,)."""
_NONE = 1e-300


class Points(NamedTuple):
    """The points of m links, g on each."""

    x: Array
    """In World (3, m·g) [m]."""
    charge: Array
    """Length of link that each stands for (m·g,) [m]."""


def points(p1: Array, p2: Array) -> Points:
    """Return the points of links from p1 to p2 (3, m) [m]."""
    along = p2 - p1
    x = p1[:, :, None] + along[:, :, None] * PART
    charge = np.sqrt((along * along).sum(axis=0))[:, None] * SHARE
    return Points(x.reshape(3, -1), charge.ravel())


def lines(at: Points, start: Array, end: Array, k: Array, least: float) -> Load:
    """Return what charged lines from `start` to `end` (3, o) do to points.

    `k` (o,) is each line's strength per metre of it [N]; the distance is bounded by `least` [m].
    """
    f = pairs(start, end, at.x, least)
    k = k[:, None]
    # What the points do to the lines, turned round.
    push = (f.across * (f.lateral * k)).sum(axis=1) + f.u @ (f.axial * k)
    return _gathered(at, -push, (f.potential * k).sum(axis=0))


def solids(at: Points, distance: Array, normal: Array, k: Array, least: float) -> Load:
    """Return what solids do to points, by their distances (o, m·g) [m], negative inside.

    `normal` (3, o, m·g) leads out of each solid to each point; `k` (o,) is its strength [N·m]. The
    distance counts as d' = d/2 + √(d²/4 + least²): positive, and bounded from below smoothly.
    """
    root = np.sqrt(0.25 * distance * distance + least * least)
    d = 0.5 * distance + root
    k = k[:, None]
    # V = k/d', and ∂d'/∂d = d' / (d' + least²/d') = d' / 2 root
    pull = k / (2.0 * root * d)
    return _gathered(at, (normal * pull).sum(axis=1), (k / d).sum(axis=0))


def _gathered(at: Points, push: Array, potential: Array) -> Load:
    """Sum forces (3, m·g) and potentials (m·g,) per charge at the points to each link's."""
    (x, y, z), found = at.x, np.empty((7, len(at.charge)))
    fx, fy, fz = force = at.charge * push
    found[:3] = force
    found[3] = y * fz - z * fy
    found[4] = z * fx - x * fz
    found[5] = x * fy - y * fx
    found[6] = at.charge * potential
    of_link = found.reshape(7, -1, len(PART)).sum(axis=2)
    return Load(of_link[:6], of_link[6])
