"""The least potential that self-motion reaches: what the tick's one step per tick is held against.

Scott & Carignan, eqs. 2 and 5–7, with three differences. Steps follow the slope projected to the
self-motions, Pτ, over its own curvature, and are shortened until the potential falls. Each is
brought back to the tool's pose, or it would drift off by centimetres. And the search ends where
|Pτ| is small: a small step only says that the gain is.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from telerobot.server.control.mechanism.potentials import curvature
from telerobot.server.control.spatial import Array

LONGEST = 0.1
"""Longest step [rad]."""
_LOOK = 1e-5
"""Step of the finite difference for the curvature [rad]."""
_ON_TASK = 1e-10
"""Tool error from which a posture counts as on its pose [m, rad]."""
_CORRECTIONS = 8
"""Newton steps back to the tool's pose, at most [1]."""
_SHORTER = 12
"""Halvings of a step, at most [1]."""
_FALL = 1e-4
"""Part of the fall that the slope promises which a step must make (Armijo)."""


class Place(NamedTuple):
    """What there is to know at one posture."""

    error: Array
    """Way (m,) of the tool to its pose, in the rows of J [m, rad]."""
    J: Array
    """The task's Jacobian (m, n)."""
    torque: Array
    """−∂V/∂q (n,) [N·m]."""
    potential: float


class Found(NamedTuple):
    """Where a search ended."""

    q: Array
    slope: float
    """|Pτ| there [N·m]."""
    potential: float
    steps: int
    stationary: bool
    """The slope is below the threshold."""


def search(
    q: Array,
    look: Callable[[Array], Place],
    lower: Array,
    upper: Array,
    threshold: float,
    steps: int = 1000,
) -> Found:
    """Slide from q (n,) downhill along the self-motions until |Pτ| is below `threshold` [N·m].

    `look(q)` tells of a posture. Joints stay between `lower` and `upper` (n,) [rad]; one that is
    pressed against its bound is no freedom there. Raises `ValueError` where q cannot be brought to
    the tool's pose.
    """
    start = _onto(q, look, lower, upper)
    if start is None:
        raise ValueError("the posture cannot be brought to the tool's pose")
    q, here = start
    for done in range(steps + 1):
        slope, free = _slope(q, here, lower, upper)
        size = math.sqrt(float(slope @ slope))
        if size < threshold or done == steps:
            return Found(q, size, here.potential, done, size < threshold)
        way = slope / size
        step = LONGEST
        ahead = look(q + _LOOK * way)
        bend = curvature(way, here.J, here.torque, ahead.J, ahead.torque, _LOOK)
        if bend * LONGEST > size:
            step = size / bend
        for _ in range(_SHORTER):
            there = _onto(q + step * way, look, lower, upper, free)
            if there is not None and _better(there, here, step * size, size, lower, upper):
                break
            step *= 0.5
        else:
            return Found(q, size, here.potential, done, False)
        q, here = there
    raise AssertionError("unreachable")


def _slope(q: Array, here: Place, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Return Pτ (n,), and which joints are free to follow it (n,)."""
    free = np.ones(len(q), dtype=bool)
    while True:
        J, torque = here.J[:, free], here.torque[free]
        slope = np.zeros(len(q))
        slope[free] = torque - np.linalg.pinv(J) @ (J @ torque)
        barred = free & (((q <= lower) & (slope < 0.0)) | ((q >= upper) & (slope > 0.0)))
        if not barred.any():
            return slope, free
        free = free & ~barred


def _better(
    there: tuple[Array, Place], here: Place, fall: float, size: float, lower: Array, upper: Array
) -> bool:
    """Judge a step: the potential falls, or, where it is flat to rounding, the slope does."""
    q, place = there
    if place.potential <= here.potential - _FALL * fall:
        return True
    if abs(place.potential - here.potential) > 1e-12 * max(1.0, abs(here.potential)):
        return False
    slope = _slope(q, place, lower, upper)[0]
    return math.sqrt(float(slope @ slope)) < size


def _onto(
    q: Array,
    look: Callable[[Array], Place],
    lower: Array,
    upper: Array,
    free: Array | None = None,
) -> tuple[Array, Place] | None:
    """Return the posture near q (n,) that has the tool at its pose, None if there is none."""
    q = np.clip(q, lower, upper)
    free = np.ones(len(q), dtype=bool) if free is None else free
    for _ in range(_CORRECTIONS):
        place = look(q)
        if np.abs(place.error).max() < _ON_TASK:
            return q, place
        q = q.copy()
        q[free] += np.linalg.pinv(place.J[:, free]) @ place.error
        q = np.clip(q, lower, upper)
    return None
