"""A chain at one posture: its joints as screws and its links as segments, all about World's origin.

A small way ahead along a joint motion needs no kinematics: link ends move by the joints' twists,
and a screw is turned by the twist of the body that carries it, dS_i = [Σ_{j<i} S_j dq_j, S_i].
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..frames import Array

Index = NDArray[np.int64]


class Shape(NamedTuple):
    """n joints and m links at one posture."""

    q: Array
    """(n,) [rad]."""
    screws: Array
    """Twist of a joint's rate (6, n), taken at World's origin: `[v; ω]`."""
    p1: Array
    """First ends of the links, in World (3, m) [m]."""
    p2: Array
    """Second ends (3, m)."""


def shape(q: Array, J: Array, p: Array, ends: Array) -> Shape:
    """Return the shape at q (n,), with the Jacobian J (6, n) of a point p (3,) in World axes.

    `ends` (m, 2, 3) are the links' ends in World.
    """
    (vx, vy, vz, wx, wy, wz), (x, y, z) = J, p.tolist()
    # How the point of each body moves that is at World's origin.
    screws = np.empty_like(J)
    screws[0] = vx - wy * z + wz * y
    screws[1] = vy - wz * x + wx * z
    screws[2] = vz - wx * y + wy * x
    screws[3:] = J[3:]
    turned = ends.transpose(1, 2, 0)
    return Shape(q, screws, turned[0], turned[1])


def ahead(at: Shape, body: Index, way: Array, step: float) -> Shape:
    """Return the shape a small `step` ahead along joint rates `way` (n,), to first order.

    `body` (m,) counts the joints inboard of each link.
    """
    S = at.screws
    n = S.shape[1]
    twists = np.zeros((6, n + 1))
    np.cumsum(S * (step * way), axis=1, out=twists[:, 1:])
    v, w, vj, wj = twists[:3, :n], twists[3:, :n], S[:3], S[3:]
    turn = np.concatenate([_cross(w, vj) + _cross(v, wj), _cross(w, wj)])
    v, w = twists[:3, body], twists[3:, body]
    return Shape(
        at.q + step * way, S + turn, at.p1 + v + _cross(w, at.p1), at.p2 + v + _cross(w, at.p2)
    )


def _cross(a: Array, b: Array) -> Array:
    """Return a × b over the first axis."""
    (ax, ay, az), (bx, by, bz) = a, b
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
