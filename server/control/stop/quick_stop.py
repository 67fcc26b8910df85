"""Ramps of a quick stop by which joints that mean something together come to rest together."""

import numpy as np

from ..spatial import Array


def ramps_in_proportion(dq: Array, deceleration: Array, spread: Array) -> Array:
    """Return ramps (n,) by which joints at rates dq (n,) come to rest at one instant [rad/s²].

    That is when the slowest does with its own `deceleration` (n,) [rad/s²], which none exceeds. A
    drive may go by up to `spread` (n,) [rad/s] faster than it was told last: no ramp is so gentle
    that this would double the time.
    """
    speed = np.abs(dq)
    takes_s = float((speed / deceleration).max())
    if takes_s <= 0.0:
        return deceleration
    return np.minimum(deceleration, np.maximum(speed, spread) / takes_s)
