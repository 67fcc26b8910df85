"""One rigid body's motion, told at another of its points (Williams 1997, eq. 1)."""

import numpy as np

from .spatial import Array, cross, sizes, skew
from .stop.trajectory import Motion


def twist_at(twist: Array, lever: Array) -> Array:
    """Return a body's twist (6,) at a point that is `lever` (3,) [m] away, in the same axes."""
    moved = twist.copy()
    moved[:3] += cross(twist[3:], lever)
    return moved


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
