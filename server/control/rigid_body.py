"""Twists and wrenches of one rigid body in other axes and at another of its points.

Williams 1997, eqs. 1 and 5.
"""

import numpy as np

from .compiled import MATRIX, ROW, VECTOR, compiled
from .spatial import Array, Pose, cross, sizes
from .stop.motion import Motion


def differ(a: Pose, b: Pose) -> bool:
    """Return whether two poses are not the same to the last bit."""
    return a is not b and not (np.array_equal(a.p, b.p) and np.array_equal(a.R, b.R))


def rotate_twist(R: Array, twist: Array) -> Array:
    """Return the same twist (6,) (or wrench), same point, in the axes that R (3, 3) maps to."""
    out = np.empty(6)
    _rotate(R, twist, out)
    return out


@compiled(MATRIX, VECTOR, ROW)
def _rotate(R: Array, twist: Array, out: Array) -> None:
    for i in range(3):
        out[i] = R[i, 0] * twist[0] + R[i, 1] * twist[1] + R[i, 2] * twist[2]
        out[3 + i] = R[i, 0] * twist[3] + R[i, 1] * twist[4] + R[i, 2] * twist[5]


def twist_at(twist: Array, lever: Array) -> Array:
    """Return a body's twist (6,) at a point that is `lever` (3,) [m] away, in the same axes."""
    moved = np.empty(6)
    _at(twist, lever, moved)
    return moved


@compiled(VECTOR, VECTOR, ROW)
def _at(twist: Array, lever: Array, out: Array) -> None:
    out[0] = twist[0] + (twist[4] * lever[2] - twist[5] * lever[1])
    out[1] = twist[1] + (twist[5] * lever[0] - twist[3] * lever[2])
    out[2] = twist[2] + (twist[3] * lever[1] - twist[4] * lever[0])
    for i in range(3, 6):
        out[i] = twist[i]


def wrench_to(T_a_b: Pose, wrench_b: Array) -> Array:
    """Return a wrench (6,) given at b's origin in b's axes, at a's origin in a's axes.

    Williams 1997, eq. 5, with a the MRF and b the Sensor.
    """
    out = np.empty(6)
    _wrench_to(T_a_b.R, T_a_b.p, wrench_b, out)
    return out


def skew(a: Array) -> Array:
    """Return the matrix (3, 3) of `a ×`."""
    x, y, z = a.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def jacobian_at(J: Array, lever: Array) -> Array:
    """Return the Jacobian (6, n) of a point `lever` (3,) [m] away from the one whose this is."""
    moved = J.copy()
    moved[:3] -= skew(lever) @ J[3:]
    return moved


def motion_at(
    motion: Motion, lever: Array, most: tuple[float, float], acceleration: Array
) -> Motion:
    """Return a body's twist and how it changes, at a point that is `lever` (3,) [m] away.

    A far point of a body that turns is quick: the twist is slowed as a whole to `most` [m/s],
    [rad/s], and its change to `acceleration` (6,), unless they were beyond that before.
    """
    if not (motion.dq.any() or motion.ddq.any()):
        return motion
    bounds = np.maximum(acceleration, np.abs(motion.ddq))
    ddq = twist_at(motion.ddq, lever)
    ddq[:3] += cross(motion.dq[3:], cross(motion.dq[3:], lever))
    beyond = max(1.0, float((np.abs(ddq) / bounds).max()))
    return Motion(motion.q, slowed_at(motion.dq, lever, most), ddq / beyond)


def slowed_at(twist: Array, lever: Array, most: tuple[float, float]) -> Array:
    """Return a body's twist (6,) at a point that is `lever` (3,) [m] away, inside `most`.

    The whole of it is slowed to those bounds [m/s], [rad/s], unless it was beyond them before.
    """
    v, w = sizes(twist)
    return within(twist_at(twist, lever), (max(v, most[0]), max(w, most[1])))


def within(twist: Array, most: tuple[float, float]) -> Array:
    """Return a twist (6,), slowed as a whole to at most `most` [m/s], [rad/s]."""
    v, w = sizes(twist)
    share = min(1.0, most[0] / max(v, 1e-12), most[1] / max(w, 1e-12))
    return twist if share == 1.0 else share * twist


@compiled(MATRIX, VECTOR, VECTOR, ROW)
def _wrench_to(R: Array, p: Array, wrench: Array, out: Array) -> None:
    for i in range(3):
        out[i] = R[i, 0] * wrench[0] + R[i, 1] * wrench[1] + R[i, 2] * wrench[2]
        out[3 + i] = R[i, 0] * wrench[3] + R[i, 1] * wrench[4] + R[i, 2] * wrench[5]
    out[3] += p[1] * out[2] - p[2] * out[1]
    out[4] += p[2] * out[0] - p[0] * out[2]
    out[5] += p[0] * out[1] - p[1] * out[0]
