"""Image-based law of a camera's view: what leads seen corners to those of a stored picture.

Chaumette, Hutchinson: Visual Servo Control, Part I (IEEE Robotics & Automation Magazine, 2006).
The error is s − s* of image points, the twist of the camera −L⁺ (s − s*), times the gain. L is
taken where the points are now, with the depth of each from the pose that the camera saw: a wrong
depth, focal length or place of the Lens bends the way, and does not move where it ends.
"""

import math
from typing import Final

import numpy as np

from ..compiled import FLAG, MATRIX, ROW, VECTOR, compiled, inner_kernel
from ..inputs import ViewGoal
from ..spatial import Array, Pose, rotate_twist

DAMPING: Final = 1e-3
"""μ of L⁺ = (LᵀL + μ²)⁻¹ Lᵀ, L per point, its translations in units of the points' mean depth [1].

Seen head-on, a square hardly tells a way aside from a turn: of side 0.1 m at 0.55 m the least
singular value is 6e-3, of which damping takes 3 % off the rate, at 2 m 0.4e-3, and 84 %.
"""

MOST_ROLL: Final = math.pi / 6
"""The picture is asked to turn by at most so much at a time [rad].

For a turn of 180° about the optical axis, all points want to go straight through the middle, and
the camera backs off for ever. Asked to turn by at most θ, it is back by the factor 1 / cos θ: 1.15.
"""

NEAREST: Final = 1e-3
"""Points nearer to the Lens than this, or behind it, tell nothing [m]."""

WIDEST: Final = 10.0
"""Nor do points that are farther aside than no picture shows: x / z, y / z [1]."""


@inner_kernel
def _interaction(points: Array, out: Array) -> None:
    """Write L (2k, 6) of points (k, 3) in the Lens [m]: ṡ = L [v; ω] of the Lens, in its axes.

    s are their normalised image coordinates x, y in turn (Chaumette, Hutchinson 2006, eq. 11).
    """
    for i in range(len(points)):
        Z = points[i, 2]
        x, y = points[i, 0] / Z, points[i, 1] / Z
        a, b = 2 * i, 2 * i + 1
        out[a, 0], out[a, 1], out[a, 2] = -1.0 / Z, 0.0, x / Z
        out[a, 3], out[a, 4], out[a, 5] = x * y, -(1.0 + x * x), y
        out[b, 0], out[b, 1], out[b, 2] = 0.0, -1.0 / Z, y / Z
        out[b, 3], out[b, 4], out[b, 5] = 1.0 + y * y, -x * y, -x


@inner_kernel
def _within_a_turn(s: Array, wanted: Array, out: Array) -> None:
    """Write the picture (k, 2) to go for: the wanted one, turned to within `MOST_ROLL` of s.

    Turned about the ray through its middle, it is a picture that a camera can have, and its middle
    stays where it is wanted.
    """
    count = len(s)
    x = y = u = v = along = across = 0.0
    for i in range(count):
        x, y = x + s[i, 0] / count, y + s[i, 1] / count
        u, v = u + wanted[i, 0] / count, v + wanted[i, 1] / count
    for i in range(count):
        a, b, c, d = s[i, 0] - x, s[i, 1] - y, wanted[i, 0] - u, wanted[i, 1] - v
        along += a * c + b * d
        across += c * b - d * a
    roll = math.atan2(across, along)
    beyond = roll - min(MOST_ROLL, max(-MOST_ROLL, roll))
    cosine, sine = math.cos(beyond), math.sin(beyond)
    size = math.sqrt(u * u + v * v + 1.0)
    n0, n1, n2 = u / size, v / size, 1.0 / size
    for i in range(count):
        a, b = wanted[i, 0], wanted[i, 1]
        along = (n0 * a + n1 * b + n2) * (1.0 - cosine)
        c = cosine * a + sine * (n1 - n2 * b) + along * n0
        d = cosine * b + sine * (n2 * a - n0) + along * n1
        e = cosine + sine * (n0 * b - n1 * a) + along * n2
        out[i, 0], out[i, 1] = c / e, d / e


@inner_kernel
def _solve(A: Array, b: Array) -> None:
    """Put into b (n,) the solution of A x = b; A (n, n) becomes its Cholesky factor."""
    n = len(b)
    for j in range(n):
        for k in range(j):
            for i in range(j, n):
                A[i, j] -= A[i, k] * A[j, k]
        root = math.sqrt(A[j, j])
        for i in range(j, n):
            A[i, j] /= root
    for i in range(n):
        for k in range(i):
            b[i] -= A[i, k] * b[k]
        b[i] /= A[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= A[k, i] * b[k]
        b[i] /= A[i, i]


@compiled(MATRIX, VECTOR, MATRIX, MATRIX, FLAG, ROW)
def _correct(R: Array, p: Array, points: Array, wanted: Array, carried: bool, out: Array) -> None:
    """Write the displacement (6,) of the moved thing in Lens axes: −L⁺ (s − s*).

    `R` (3, 3) and `p` (3,) bring points (k, 3) into the Lens, `wanted` (k, 2) is s*. Of a Lens that
    is `carried` at its own origin; of what is seen, and moves with its points, at p.
    """
    count = len(points)
    P, s, w = np.empty((count, 3)), np.empty((count, 2)), np.empty((count, 2))
    depth = 0.0
    for i in range(count):
        for j in range(3):
            P[i, j] = (
                p[j] + R[j, 0] * points[i, 0] + R[j, 1] * points[i, 1] + R[j, 2] * points[i, 2]
            )
        if not P[i, 2] > NEAREST:
            return
        s[i, 0], s[i, 1] = P[i, 0] / P[i, 2], P[i, 1] / P[i, 2]
        if max(abs(s[i, 0]), abs(s[i, 1])) > WIDEST:
            return
        depth += P[i, 2] / count
    _within_a_turn(s, wanted, w)
    L = np.empty((2 * count, 6))
    _interaction(P, L)
    A, b = np.zeros((6, 6)), np.zeros(6)
    for m in range(2 * count):
        for j in range(3):
            L[m, j] *= depth
        e = s[m // 2, m % 2] - w[m // 2, m % 2]
        for j in range(6):
            b[j] -= L[m, j] * e / count
            for k in range(6):
                A[j, k] += L[m, j] * L[m, k] / count
    for j in range(6):
        A[j, j] += DAMPING * DAMPING
    _solve(A, b)
    for j in range(3):
        b[j] *= depth
    if carried:
        for j in range(6):
            out[j] = b[j]
        return
    # What is seen moves the other way, and its own origin is at p in the Lens.
    out[0] = -(b[0] + b[4] * p[2] - b[5] * p[1])
    out[1] = -(b[1] + b[5] * p[0] - b[3] * p[2])
    out[2] = -(b[2] + b[3] * p[1] - b[4] * p[0])
    for j in range(3, 6):
        out[j] = -b[j]


def view_error(goal: ViewGoal, here: Pose) -> Array:
    """Return the pose error (6,) that the picture tells of the moved thing at `here`, in World.

    To first order it is `pose_error` of where it is to be: what is beside the arm is led to where
    its picture is the stored one, and what is carried brings its Lens there.
    """
    carried, lens = goal.T_world_lens is None, goal.T_world_lens or here
    T = lens.inverse()
    if not carried:
        T = T @ here
    out = np.zeros(6)
    _correct(T.R, T.p, goal.picture.points, goal.picture.wanted, carried, out)
    return rotate_twist(lens.R, out)
