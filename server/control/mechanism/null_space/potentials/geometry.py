"""A chain at one posture: its joints as screws and its links as segments, all about World's origin.

A small way ahead along a joint motion needs no kinematics: link ends move by the joints' twists,
and a screw is turned by the twist of the body that carries it, dS_i = [Σ_{j<i} S_j dq_j, S_i].
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....compiled import ARRAY3, INDEX, MATRIX, NUMBER, ROW, STACK, TABLE, VECTOR, XYZ, compiled
from ....spatial import Array

Index = NDArray[np.int64]
Xyz = tuple[float, float, float]


class Shape(NamedTuple):
    """n joints and m links at one posture."""

    q: Array
    """(n,) [rad]."""
    screws: Array
    """Twist of a joint's rate (6, n), taken at World's origin: `[v; ω]`."""
    ends: Array
    """Both ends of the links, in World (m, 2, 3) [m]."""
    tool: Array
    """Where the tool's point is, in World (3,) [m]."""


def shape(q: Array, J: Array, p: Array, ends: Array) -> Shape:
    """Return the shape at q (n,), with the Jacobian J (6, n) of the tool's point p (3,) in World.

    `ends` (m, 2, 3) are the links' ends in World.
    """
    return Shape(q, screws(J, p), ends, p)


def ahead(at: Shape, body: Index, way: Array, step: float) -> Shape:
    """Return the shape a small `step` ahead along joint rates `way` (n,), to first order.

    `body` (m,) counts the joints inboard of each link.
    """
    there = Shape(
        np.empty(at.q.shape), np.empty(at.screws.shape), np.empty(at.ends.shape), np.empty(3)
    )
    _move(at.q, at.screws, at.ends, at.tool, body, way, step, *there)
    return there


@compiled(XYZ, XYZ)
def _cross(a: Xyz, b: Xyz) -> Xyz:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def screws(J: Array, p: Array) -> Array:
    """Return twists (6, n) at World's origin of joints whose Jacobian at p (3,) is J (6, n)."""
    found = np.empty(J.shape)
    _twist(J, p, found)
    return found


@compiled(MATRIX, VECTOR, TABLE)
def _twist(J: Array, p: Array, found: Array) -> None:
    for j in range(J.shape[1]):
        w = (J[3, j], J[4, j], J[5, j])
        # How the point of each body moves that is at World's origin.
        lever = _cross((p[0], p[1], p[2]), w)
        for i in range(3):
            found[i, j] = J[i, j] + lever[i]
            found[3 + i, j] = w[i]


@compiled(VECTOR, MATRIX, ARRAY3, VECTOR, INDEX, VECTOR, NUMBER, ROW, TABLE, STACK, ROW)
def _move(
    q: Array,
    S: Array,
    ends: Array,
    tool: Array,
    body: Index,
    way: Array,
    step: float,
    angles: Array,
    turned: Array,
    shifted: Array,
    moved: Array,
) -> None:
    """Write angles, screws, ends and tool of a shape after a small step."""
    n = len(q)
    twist = np.zeros((n + 1, 6))  # of each body, over the step
    for j in range(n):
        angles[j] = q[j] + step * way[j]
        v, w = (S[0, j], S[1, j], S[2, j]), (S[3, j], S[4, j], S[5, j])
        V = (twist[j, 0], twist[j, 1], twist[j, 2])
        W = (twist[j, 3], twist[j, 4], twist[j, 5])
        dv, vw, dw = _cross(W, v), _cross(V, w), _cross(W, w)
        for i in range(3):
            turned[i, j] = v[i] + dv[i] + vw[i]
            turned[3 + i, j] = w[i] + dw[i]
            twist[j + 1, i] = V[i] + step * way[j] * v[i]
            twist[j + 1, 3 + i] = W[i] + step * way[j] * w[i]
    for link in range(len(ends)):
        b = body[link]
        W = (twist[b, 3], twist[b, 4], twist[b, 5])
        for e in range(2):
            x = (ends[link, e, 0], ends[link, e, 1], ends[link, e, 2])
            dx = _cross(W, x)
            for i in range(3):
                shifted[link, e, i] = x[i] + twist[b, i] + dx[i]
    W = (twist[n, 3], twist[n, 4], twist[n, 5])
    dx = _cross(W, (tool[0], tool[1], tool[2]))
    for i in range(3):
        moved[i] = tool[i] + twist[n, i] + dx[i]
