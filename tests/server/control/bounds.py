"""Joints with bounds, of which a test says what matters to it."""

import numpy as np
from telerobot.server.control.joints import Joints


def bounded(lower, upper, acceleration, jerk, velocity=1e12, leash=0.03, names=None):
    """Return joints with these bounds, each (n,) or one for all."""
    n = len(np.atleast_1d(upper))
    names = tuple(f"j{i}" for i in range(n)) if names is None else names
    given = (lower, upper, velocity, acceleration, jerk, leash, np.inf, 1.0)
    return Joints(names, *(np.broadcast_to(np.asarray(b, float), n).copy() for b in given))
