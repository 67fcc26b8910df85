"""The quickest jerk-limited ways to a velocity, in closed form: the tick takes several of them.

One freedom's acceleration ramps by the full jerk to a plateau, stays there, and ramps to zero. For
a given duration the change of velocity grows with the plateau, so that each change has one; and
every duration from the shortest on will do, since a velocity can be kept once it is reached. So
freedoms that are to arrive together all take the longest of their shortest durations; one that a
gentler ramp to zero brings there in time takes that, and waits. An acceleration beyond its bound is
first ramped down to it.
"""

import math

import numpy as np

from .compiled import FLAG, NUMBER, VECTOR, compiled
from .frames import Array

_INSTANT = 1e-12
"""Keeps a ramp of no length from dividing by zero [s]."""


@compiled(NUMBER, NUMBER, NUMBER, NUMBER)
def _shortest(change: float, a: float, bound: float, jerk: float) -> float:
    """Return the least duration [s] of a change of velocity from an acceleration 0 ≤ a ≤ bound."""
    sense = 1.0 if change >= a * a / (2.0 * jerk) else -1.0  # beside what ramping to zero gives
    peak = math.sqrt(max(0.5 * a * a + sense * jerk * change, 0.0))
    if peak <= bound:
        return (2.0 * peak - sense * a) / jerk
    held_s = (sense * change - (2.0 * bound * bound - a * a) / (2.0 * jerk)) / bound
    return (2.0 * bound - sense * a) / jerk + held_s


@compiled(NUMBER, NUMBER, NUMBER, NUMBER)
def _plateau(change: float, a: float, jerk: float, duration: float) -> float:
    """Return the acceleration that is held, so that the change takes a duration [s]; a ≥ 0."""
    stopping, reach = a * a / (2.0 * jerk), jerk * duration
    if change >= a * duration - stopping:  # above a: up, and down to zero
        b, c = reach + a, jerk * (change + stopping)
    elif change >= stopping:  # between zero and a: down, and down to zero
        return (change - stopping) / (duration - a / jerk)
    else:  # below zero: down, and up to zero
        b, c = reach - a, jerk * (stopping - change)
    root = math.sqrt(max(b * b - 4.0 * c, 0.0))
    size = 2.0 * c / (b + root) if b + root > 0.0 else 0.0
    return size if change >= stopping else -size


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, NUMBER, FLAG)
def stepped(
    q: Array,
    dq: Array,
    ddq: Array,
    target: Array,
    acceleration: Array,
    jerk: Array,
    period_s: float,
    together: bool,
) -> Array:
    """Return position, velocity and acceleration (3, n) one period on the way to velocities (n,).

    `acceleration` and `jerk` (n,) bound the way. Freedoms arrive `together`, or each as soon as it
    can. Raises `ValueError` where the result would not be finite.
    """
    n = len(q)
    out = np.empty((3, n))
    # Mirrored, so that each begins with an acceleration that is not negative.
    mirror, change, braked_s, duration = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    longest = 0.0
    for i in range(n):
        mirror[i] = -1.0 if ddq[i] < 0.0 else 1.0
        a, j = abs(ddq[i]), jerk[i]
        braked_s[i] = max(a - acceleration[i], 0.0) / j
        start = a - j * braked_s[i]
        change[i] = mirror[i] * (target[i] - dq[i]) - 0.5 * (a + start) * braked_s[i]
        duration[i] = _shortest(change[i], start, acceleration[i], j)
        longest = max(longest, braked_s[i] + duration[i])
    for i in range(n):
        j = jerk[i]
        a, v, x = abs(ddq[i]), mirror[i] * dq[i], mirror[i] * q[i]
        start = a - j * braked_s[i]
        lasts = longest - braked_s[i] if together else duration[i]
        if j * change[i] >= 0.5 * start * start > 0.0 and 2.0 * change[i] <= start * lasts:
            held, down_s = start, 2.0 * change[i] / start
            up_s, lasts = 0.0, down_s
        else:
            held = _plateau(change[i], start, j, lasts)
            up_s, down_s = abs(held - start) / j, abs(held) / j
        left = period_s
        for phase in range(4):
            if phase == 0:
                seconds, by = braked_s[i], -j
            elif phase == 1:
                seconds, by = up_s, math.copysign(j, held - start)
            elif phase == 2:
                seconds, by = max(lasts - up_s - down_s, 0.0), 0.0
            else:
                seconds, by = down_s, -held / max(down_s, _INSTANT)
            t = min(seconds, left)
            x += t * (v + t * (0.5 * a + t * by / 6.0))
            v += t * (a + 0.5 * t * by)
            a += t * by
            left -= t
        if left > 0.0:  # arrived
            x += left * v
            v, a = mirror[i] * target[i], 0.0
        out[0, i], out[1, i], out[2, i] = mirror[i] * x, mirror[i] * v, mirror[i] * a
        if not math.isfinite(x + v + a):
            raise ValueError("not finite")
    return out
