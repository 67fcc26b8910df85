"""Stops of freedoms that mean something only together, as of two arms on one payload.

A stop is its phases, as in `velocity_profile.py`.
"""

import math

import numpy as np

from ..compiled import ARRAY3, NUMBER, STACK, VECTOR, compiled
from ..spatial import Array

_INSTANT = 1e-12
"""Durations below this are rounding [s]."""

_SLACK = 1.0 + 1e-9
"""Bounds are kept to rounding [1]."""

_LONGEST = 1e6
"""A stop in proportion lasts at most so much longer than the quickest of one freedom [1]."""

_BISECTIONS = 14
"""Halvings until the stretch of a stop is known well enough [1]."""

_SHAPES = 3
"""So many of the slowest freedoms lend their stops' shapes [1]."""

_LEAST_RAMP = 0.05
"""Each ramp of a stop in proportion takes at least this part of it [1]."""


@compiled(NUMBER, NUMBER, NUMBER, NUMBER, NUMBER)
def _held(dq: float, ddq: float, up_s: float, hold_s: float, down_s: float) -> float:
    """Return the acceleration that is held on a stop: ramp to it, hold it, ramp to zero."""
    return -(dq + 0.5 * up_s * ddq) / (0.5 * up_s + hold_s + 0.5 * down_s)


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, NUMBER, NUMBER, NUMBER)
def _keeps(
    dq: Array,
    ddq: Array,
    acceleration: Array,
    jerk: Array,
    up_s: float,
    hold_s: float,
    down_s: float,
) -> bool:
    """Return whether a stop with phases of common times keeps the bounds (n,) of all freedoms.

    An acceleration that is beyond its bound at the start is its bound.
    """
    for i in range(len(dq)):
        held = _held(dq[i], ddq[i], up_s, hold_s, down_s)
        if (
            not abs(held) <= max(acceleration[i], abs(ddq[i])) * _SLACK
            or abs(held - ddq[i]) > jerk[i] * up_s * _SLACK
            or abs(held) > jerk[i] * down_s * _SLACK
        ):
            return False
    return True


def stopping_in_proportion(
    dq: Array, ddq: Array, acceleration: Array, jerk: Array, own: Array
) -> Array:
    """Return the phases (2, 4, n) of a stop on which all freedoms share the times of the phases.

    So each one's velocity is the same combination of its velocity and its acceleration at the
    start; where these are in proportion, the stop is a straight line. The `own` stops (2, 4, n) of
    the slowest freedoms are the shapes that are tried, stretched until all keep their bounds; the
    one that lasts least is taken. Raises `ValueError` where a state is not finite, or nothing keeps
    the bounds.
    """
    phases = np.zeros((2, 4, len(dq)))
    _stop(dq, ddq, acceleration, jerk, own, phases)
    return phases


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, ARRAY3, STACK)
def _stop(
    dq: Array, ddq: Array, acceleration: Array, jerk: Array, own: Array, phases: Array
) -> None:
    """Write the phases (2, 4, n) of a stop on which all freedoms share their times."""
    n, stands = len(dq), True
    lasts = np.empty(n)
    for i in range(n):
        stands = stands and dq[i] == 0.0 and ddq[i] == 0.0
        lasts[i] = 0.0
        for phase in range(own.shape[1]):
            lasts[i] += own[0, phase, i]
    if stands:
        return
    best_s, best_up_s, best_hold_s, best_down_s = math.inf, 0.0, 0.0, 0.0
    for _ in range(min(n, _SHAPES)):
        k = 0
        for i in range(1, n):
            if lasts[i] > lasts[k]:
                k = i
        total_s = lasts[k]
        if total_s < _INSTANT:
            break
        lasts[k] = 0.0
        # Other freedoms need both ramps, even if this one does not.
        up_s = max(own[0, 0, k] + own[0, 1, k], _LEAST_RAMP * total_s)
        hold_s, down_s = own[0, 2, k], max(own[0, 3, k], _LEAST_RAMP * total_s)
        short, long = 1.0, 1.0
        while not _keeps(dq, ddq, acceleration, jerk, long * up_s, long * hold_s, long * down_s):
            short, long = long, 2.0 * long
            if long > _LONGEST:
                break
        if long > _LONGEST:
            continue
        for _ in range(_BISECTIONS if long > 1.0 else 0):
            x = 0.5 * (short + long)
            if _keeps(dq, ddq, acceleration, jerk, x * up_s, x * hold_s, x * down_s):
                long = x
            else:
                short = x
        if long * (up_s + hold_s + down_s) < best_s:
            best_s = long * (up_s + hold_s + down_s)
            best_up_s, best_hold_s, best_down_s = long * up_s, long * hold_s, long * down_s
    if not math.isfinite(best_s):
        raise ValueError("no stop in proportion")
    for i in range(n):
        held = _held(dq[i], ddq[i], best_up_s, best_hold_s, best_down_s)
        phases[0, 1, i], phases[0, 2, i], phases[0, 3, i] = best_up_s, best_hold_s, best_down_s
        phases[1, 1, i] = (held - ddq[i]) / best_up_s
        phases[1, 3, i] = -held / best_down_s
