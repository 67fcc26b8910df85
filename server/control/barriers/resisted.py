"""An arm that is held up: it slows as a whole before a joint falls behind out of its window.

A joint that meets something, or is pushed back by what another one presses the arm into, falls
behind its command at a rate ė, whatever its own command does. While it does, the whole arm slows
until ė ≤ √(b² + 2a'd) − b, where d is what is left of the joint's following window, less the way
until its news has come and gone, and a' and b are those of joint limits: from there the command can
still stop. A joint beyond its leash is held up already: there no joint goes faster than that, but
on a way on which it comes back. So a tool that is pressed at something unseen ends in rest, not in
a following error; and the way back, against the motion that pressed it there, is always open.
"""

import math
from typing import NamedTuple

from ..compiled import NUMBER, ROW, VECTOR, compiled
from ..spatial import Array

USED = 0.9
"""Part of the following window that may be used up [1]."""

RETREAT = 0.1
"""So fast the way back may be gone however far a joint is behind [rad/s]."""

FASTER = 3.0
"""While a joint that is held up gets closer, others may go so much faster than it does [1]."""

LATENCY = 3.0
"""Periods until what a command does is seen and answered [1]."""

_STANDS = 1e-7
"""A way of a tick below this is none [rad]."""


class Resistance(NamedTuple):
    """Memory of a resistance that holds an arm up."""

    error: Array
    """Lead of the command over the joints in the last tick (n,) [rad]."""
    pressed: Array
    """The way of a tick (n,) [rad] on which a joint fell behind last; zero: none did."""


class Resisted(NamedTuple):
    """The part of joint rates that a resistance leaves."""

    share: float
    """0 to 1."""
    joint: int
    """That decides; −1 for none."""
    memory: Resistance


@compiled(
    VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, NUMBER,
    ROW,
)  # fmt: skip
def slow(
    dq: Array, now: Array, way: Array, error: Array, before: Array, pressed: Array, leash: Array,
    window: Array, velocity: Array, a: Array, b: Array, period_s: float, against: Array,
) -> tuple[float, int]:  # fmt: skip
    """Return the share of rates dq (n,) [rad/s] that is left, and who decides.

    `pressed` anew is written to `against` (n,), zeros before.

    Joints are told to go at `now` (n,), and went the `way` (n,) [rad] in the tick whose effect is
    seen; command − joint is `error` (n,) [rad], and was `before` a period ago. `leash` and `window`
    (n,) [rad] are its bounds, `velocity` (n,) those of speeds, `a` and `b` (n,) the braking that is
    counted on.
    """
    n = len(dq)
    asked = moving = gone = farthest = falling = 0.0
    for j in range(n):
        behind = 2.0 * abs(error[j]) / leash[j] - 1.0
        asked, moving = max(asked, abs(dq[j])), max(moving, abs(now[j]))
        gone, farthest = max(gone, abs(way[j])), max(farthest, behind)
        if behind > 0.0:
            falling = max(falling, abs(error[j]) - abs(before[j]))
    along = 0.0
    for j in range(n):
        if farthest > 0.0:
            against[j] = way[j] if falling > 0.0 and gone > _STANDS else pressed[j]
        along += against[j] * dq[j]
    most, which = asked, -1
    for j in range(n):
        behind = abs(error[j])
        growth = (behind - abs(before[j])) / period_s
        left = USED * window[j] - behind - LATENCY * period_s * max(0.0, growth)
        allowed = math.sqrt(b[j] ** 2 + 2.0 * a[j] * max(0.0, left)) - b[j]
        bound = most
        if growth > allowed:
            bound = allowed / growth * moving
        beyond = min(1.0, 2.0 * behind / leash[j] - 1.0)
        if beyond > 0.0:
            free = (1.0 - beyond) * velocity[j] + FASTER * max(0.0, -growth)
            bound = min(bound, allowed + free)
            if along <= 0.0:
                bound = max(bound, RETREAT)
        if bound < most:
            most, which = bound, j
    return most / max(asked, 1e-12) if which >= 0 else 1.0, which
