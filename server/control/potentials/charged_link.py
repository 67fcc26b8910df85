"""A link as a uniformly charged segment, in the field of point charges.

Scott & Carignan, "A Line-Based Obstacle Avoidance Technique for Dexterous Manipulator
Operations", eqs. 11–14, in a form that loses no precision anywhere: as c, the distance from the
charge to the link's line, falls to zero, the printed forms are differences of large numbers.

With r1, r2 from the charge to the link's ends, u along the link, r⊥ the way from the charge to
the link's line, L the length and S = |r1||r2| + r1·r2:

    F  = k [ r⊥ L (|r1| + |r2|) / (|r1||r2| S)  +  u (|r2| − |r1|) / (|r1||r2|) ]
    M1 = k (u × r⊥) L² / (|r2| S)                                    about the link's first end
    V  = k ln[(|r1| + |r2| + L)² / 2S]

Where r1·r2 < 0, S is |r1 × r2|² / (|r1||r2| − r1·r2). On the link itself F grows as 2k/c. A least
distance bounds it: the charge is taken that far aside, in a direction of its own which is square to
all others. So the field stays smooth, and the torques the exact slope of the potential.
"""

from typing import NamedTuple

import numpy as np

from ..frames import Array

_NONE = 1e-300
"""Keeps what has no length or no distance from dividing by zero."""


class Pairs(NamedTuple):
    """What unit charges do to links, pair by pair, k = 1; components lead, for speed."""

    u: Array
    """Along each link (3, m)."""
    across: Array
    """From the charge to the link's line, square to it (3, m, c) [m]."""
    lateral: Array
    """Force over `across` (m, c)."""
    axial: Array
    """Force along `u` (m, c)."""
    turning: Array
    """Moment about the link's first end over u × `across` (m, c)."""
    potential: Array
    """(m, c), zero at infinity."""

    @property
    def force(self) -> Array:
        """On each link by each charge (m, c, 3)."""
        sideways = self.lateral * self.across
        return np.moveaxis(sideways + self.axial * self.u[:, :, None], 0, -1)

    @property
    def moment(self) -> Array:
        """On each link about its first end by each charge (m, c, 3)."""
        (ux, uy, uz), (x, y, z) = self.u[:, :, None], self.turning * self.across
        return np.stack([uy * z - uz * y, uz * x - ux * z, ux * y - uy * x], axis=-1)


class Load(NamedTuple):
    """What all charges together do to each link."""

    wrench: Array
    """(6, m): force, and moment about World's origin [N, N·m for k in N·m]."""
    potential: Array
    """(m,) [J]."""


def pairs(p1: Array, p2: Array, charges: Array, least: float = 0.0) -> Pairs:
    """Return the field of charges (3, c) on links from p1 to p2 (3, m) each; all in World [m].

    Charges (3, m, c) are each link's own. `least` bounds the distance from below [m]; with 0 there
    is no bound on the link itself. A link without length carries no charge.
    """
    along = p2 - p1
    L = np.sqrt((along * along).sum(axis=0))
    u = along / np.maximum(L, _NONE)
    L = L[:, None]
    r1 = p1[:, :, None] - (charges if charges.ndim == 3 else charges[:, None])
    # Along the link and square to it, each by itself: nothing cancels later.
    unit = u[:, :, None]
    t1 = (r1 * unit).sum(axis=0)
    across = r1 - t1 * unit
    t2 = t1 + L
    c2 = (across * across).sum(axis=0) + max(least * least, _NONE)
    n1, n2 = np.sqrt(t1 * t1 + c2), np.sqrt(t2 * t2 + c2)
    dot, product, total = t1 * t2 + c2, n1 * n2, n1 + n2
    # Where the charge is abreast of the link, the sum is a difference: the squares' is exact.
    S = np.where(dot >= 0.0, product + dot, L * L * c2 / np.maximum(product - dot, _NONE))
    S = np.maximum(S, _NONE)
    w = L / S
    return Pairs(
        u,
        across,
        lateral=w * total / product,
        axial=L * (t1 + t2) / (total * product),
        turning=w * L / n2,
        potential=np.log((total + L) ** 2 / (2.0 * S)) * (L > 0.0),
    )


def load(p1: Array, p2: Array, charges: Array, k: Array, least: float) -> Load:
    """Return what charges of strength k (c,) [N·m] do to links; the rest as for `pairs`."""
    f = pairs(p1, p2, charges, least)
    wrench = np.empty((6, p1.shape[1]))
    force = (f.across * (f.lateral * k)).sum(axis=2) + (f.axial @ k) * f.u
    (fx, fy, fz), (px, py, pz) = force, p1
    (ux, uy, uz), (ax, ay, az) = f.u, (f.across * (f.turning * k)).sum(axis=2)
    wrench[:3] = force
    wrench[3] = py * fz - pz * fy + uy * az - uz * ay
    wrench[4] = pz * fx - px * fz + uz * ax - ux * az
    wrench[5] = px * fy - py * fx + ux * ay - uy * ax
    return Load(wrench, f.potential @ k)
