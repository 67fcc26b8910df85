"""The quickest jerk-limited ways to a velocity, in closed form; to rest, alone and together."""

import math
from typing import NamedTuple

import numpy as np

from ..compiled import (
    ARRAY3,
    FLAG,
    INDEX,
    NUMBER,
    ROW,
    STACK,
    TABLE,
    VECTOR,
    compiled,
    inner_kernel,
)
from ..scene import Index
from ..spatial import Array, Motion

# --- The quickest jerk-limited ways to a velocity, in closed form: the tick takes several of them
#
# One freedom's acceleration ramps by the full jerk to a plateau, stays there, and ramps to
# zero. For a given duration the change of velocity grows with the plateau, so that each change
# has one; and every duration from the shortest on will do, since a velocity can be kept once it
# is reached. So freedoms that are to arrive together all take the longest of their shortest
# durations; one that a gentler ramp to zero brings there in time takes that, and waits. An
# acceleration beyond its bound is first ramped down to it.
#
# A way is its phases, one after the other: how long each lasts and its jerk, `(2, k, n)` for n
# freedoms [s, 1/s³].

_INSTANT = 1e-12
"""Durations below this are rounding [s]."""


@inner_kernel
def _shortest(change: float, a: float, bound: float, jerk: float) -> float:
    """Return the least duration [s] of a change of velocity from an acceleration 0 ≤ a ≤ bound."""
    sense = 1.0 if change >= a * a / (2.0 * jerk) else -1.0  # beside what ramping to zero gives
    peak = math.sqrt(max(0.5 * a * a + sense * jerk * change, 0.0))
    if peak <= bound:
        return (2.0 * peak - sense * a) / jerk
    held_s = (sense * change - (2.0 * bound * bound - a * a) / (2.0 * jerk)) / bound
    return (2.0 * bound - sense * a) / jerk + held_s


@inner_kernel
def _plateau(change: float, a: float, jerk: float, duration: float) -> float:
    """Return the acceleration that is held, so that the change takes a duration [s]; a ≥ 0."""
    stopping, reach = a * a / (2.0 * jerk), jerk * duration
    if change >= a * duration - stopping:  # above a: up, and down to zero
        b, c = reach + a, jerk * (change + stopping)
    elif change >= stopping:  # between zero and a: down, and down to zero
        return min(a, (change - stopping) / max(duration - a / jerk, _INSTANT))
    else:  # below zero: down, and up to zero
        b, c = reach - a, jerk * (stopping - change)
    root = math.sqrt(max(b * b - 4.0 * c, 0.0))
    size = 2.0 * c / (b + root) if b + root > 0.0 else 0.0
    return size if change >= stopping else -size


@inner_kernel
def _plan(
    dq: Array,
    ddq: Array,
    target: Array,
    acceleration: Array,
    jerk: Array,
    together: bool,
    phases: Array,
) -> None:
    """Write the phases (2, 4, n) of the quickest way to velocities (n,), all `together` or not.

    They are zeros before. Raises `ValueError` where a change of velocity is not finite.
    """
    n = len(dq)
    change, shortest = np.empty(n), np.empty(n)
    longest = 0.0
    for i in range(n):
        # Mirrored, so that each begins with an acceleration that is not negative.
        mirror, a, j = math.copysign(1.0, ddq[i]), abs(ddq[i]), jerk[i]
        start = min(a, acceleration[i])
        braked_s = (a - start) / j
        phases[0, 0, i], phases[1, 0, i] = braked_s, -mirror * j
        change[i] = mirror * (target[i] - dq[i]) - 0.5 * (a + start) * braked_s
        if not math.isfinite(change[i]):
            raise ValueError("not finite")
        shortest[i] = _shortest(change[i], start, acceleration[i], j)
        longest = max(longest, braked_s + shortest[i])
    for i in range(n):
        mirror, j = math.copysign(1.0, ddq[i]), jerk[i]
        start = min(abs(ddq[i]), acceleration[i])
        lasts = longest - phases[0, 0, i] if together else shortest[i]
        if j * change[i] >= 0.5 * start * start > 0.0 and 2.0 * change[i] <= start * lasts:
            ramp_s = 2.0 * change[i] / start
            phases[0, 3, i], phases[1, 3, i] = ramp_s, -mirror * start / ramp_s
            continue
        held = _plateau(change[i], start, j, lasts)
        up_s, down_s = abs(held - start) / j, abs(held) / j
        phases[0, 1, i], phases[1, 1, i] = up_s, mirror * math.copysign(j, held - start)
        phases[0, 2, i] = max(lasts - up_s - down_s, 0.0)
        phases[0, 3, i], phases[1, 3, i] = down_s, -mirror * math.copysign(j, held)


@inner_kernel
def _go_along(
    q: Array, dq: Array, ddq: Array, target: Array, phases: Array, t: float, out: Array
) -> None:
    """Write position, velocity and acceleration (3, n) a time t after those of a start (n,)."""
    for i in range(len(q)):
        x, v, a, left = q[i], dq[i], ddq[i], t
        for phase in range(phases.shape[1]):
            s, j = min(phases[0, phase, i], left), phases[1, phase, i]
            x += s * (v + s * (0.5 * a + s * j / 6.0))
            v += s * (a + 0.5 * s * j)
            a += s * j
            left -= s
        if left > 0.0:  # arrived
            v, a = target[i], 0.0
            x += left * v
        out[0, i], out[1, i], out[2, i] = x, v, a
        if not math.isfinite(x + v + a):
            raise ValueError("not finite")


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
    out = np.empty((3, len(q)))
    _step(q, dq, ddq, target, acceleration, jerk, period_s, together, np.array([len(q)]), out)
    return out


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, NUMBER, FLAG, INDEX, TABLE)
def _step(
    q: Array,
    dq: Array,
    ddq: Array,
    target: Array,
    acceleration: Array,
    jerk: Array,
    period_s: float,
    together: bool,
    ends: Index,
    out: Array,
) -> None:
    """Write what `stepped` returns; freedoms before each of the `ends` arrive on their own."""
    n, start = len(q), 0
    phases = np.zeros((2, 4, n))
    for end in ends:
        own = np.zeros((2, 4, end - start))
        _plan(
            dq[start:end],
            ddq[start:end],
            target[start:end],
            acceleration[start:end],
            jerk[start:end],
            together,
            own,
        )
        for phase in range(4):
            for i in range(start, end):
                phases[0, phase, i] = own[0, phase, i - start]
                phases[1, phase, i] = own[1, phase, i - start]
        start = end
    _go_along(q, dq, ddq, target, phases, period_s, out)


@compiled(VECTOR, VECTOR, VECTOR, ARRAY3, ROW, ROW)
def _reach(q: Array, dq: Array, ddq: Array, phases: Array, low: Array, high: Array) -> float:
    duration, turns = 0.0, np.empty(2)
    for i in range(len(q)):
        x, v, a, total = q[i], dq[i], ddq[i], 0.0
        low[i] = high[i] = x
        for phase in range(phases.shape[1]):
            seconds, j = phases[0, phase, i], phases[1, phase, i]
            # Where the velocity passes through zero, both roots in a form that loses no digits.
            turns[0] = turns[1] = seconds
            root2 = a * a - 2.0 * j * v
            if root2 >= 0.0:
                sum_ = -(a + math.copysign(math.sqrt(root2), a))
                if sum_ != 0.0:
                    turns[0] = 2.0 * v / sum_
                if j != 0.0:
                    turns[1] = sum_ / j
            for k in range(3):
                s = seconds if k == 2 else min(max(turns[k], 0.0), seconds)
                at = x + s * (v + s * (0.5 * a + s * j / 6.0))
                low[i], high[i] = min(low[i], at), max(high[i], at)
            x, v, a = at, v + seconds * (a + 0.5 * seconds * j), a + seconds * j
            total += seconds
        duration = max(duration, total)
    return duration


@compiled(
    VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, NUMBER, FLAG, INDEX, TABLE, STACK, ROW,
    ROW,
)  # fmt: skip
def step_and_stop(
    q: Array,
    dq: Array,
    ddq: Array,
    target: Array,
    stepping: Array,
    acceleration: Array,
    jerk: Array,
    period_s: float,
    together: bool,
    ends: Index,
    moved: Array,
    phases: Array,
    low: Array,
    high: Array,
) -> float:
    """Write what `stepped` returns, the phases (2, 4, n) of the quickest stop, and its reach.

    The step takes the accelerations `stepping` at most. The phases are zeros before. Returns how
    long the stop lasts [s].
    """
    n = len(q)
    _step(q, dq, ddq, target, stepping, jerk, period_s, together, ends, moved)
    _plan(moved[1], moved[2], np.zeros(n), acceleration, jerk, False, phases)
    return _reach(moved[0], moved[1], moved[2], phases, low, high)


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, NUMBER, TABLE)
def shape(
    dq: Array,
    ddq: Array,
    target: Array,
    acceleration: Array,
    jerk: Array,
    period_s: float,
    out: Array,
) -> bool:
    """Write velocity and acceleration (2, n) one period on the way to velocities (n,), together.

    Nothing is written, and False returned, where all stands and is told to. Raises `ValueError`
    where the result would not be finite.
    """
    n, stands = len(dq), True
    for i in range(n):
        stands = stands and dq[i] == 0.0 and ddq[i] == 0.0 and target[i] == 0.0
    if stands:
        return False
    moved, phases = np.empty((3, n)), np.zeros((2, 4, n))
    _plan(dq, ddq, target, acceleration, jerk, True, phases)
    _go_along(np.zeros(n), dq, ddq, target, phases, period_s, moved)
    for i in range(n):
        out[0, i], out[1, i] = moved[1, i], moved[2, i]
    return True


def stopping(dq: Array, ddq: Array, acceleration: Array, jerk: Array) -> Array:
    """Return the phases (2, 4, n) of the quickest stop of each freedom."""
    phases = np.zeros((2, 4, len(dq)))
    _stop(dq, ddq, acceleration, jerk, phases)
    return phases


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, STACK)
def _stop(dq: Array, ddq: Array, acceleration: Array, jerk: Array, phases: Array) -> None:
    _plan(dq, ddq, np.zeros(len(dq)), acceleration, jerk, False, phases)


def reach(q: Array, dq: Array, ddq: Array, phases: Array) -> tuple[Array, Array, float]:
    """Return the least and the greatest position (n,) along a way, and how long it lasts [s]."""
    low, high = np.empty(len(q)), np.empty(len(q))
    return low, high, _reach(q, dq, ddq, phases, low, high)


@compiled(VECTOR, VECTOR, VECTOR, ARRAY3, NUMBER)
def stop_at(q: Array, dq: Array, ddq: Array, phases: Array, t: float) -> Array:
    """Return position, velocity and acceleration (3, n) a time t after a stop began."""
    out = np.empty((3, len(q)))
    _go_along(q, dq, ddq, np.zeros(len(q)), phases, t, out)
    return out


def stop_postures(q: Array, dq: Array, ddq: Array, phases: Array, times: Array) -> Array:
    """Return the positions (s, n) at times (s,) after a stop began."""
    out = np.empty((len(times), len(q)))
    _postures(q, dq, ddq, phases, times, out)
    return out


@compiled(VECTOR, VECTOR, VECTOR, ARRAY3, VECTOR, TABLE)
def _postures(q: Array, dq: Array, ddq: Array, phases: Array, times: Array, out: Array) -> None:
    """Write the positions (s, n) at times (s,) after a stop began."""
    rest, at = np.zeros(len(q)), np.empty((3, len(q)))
    for k in range(len(times)):
        _go_along(q, dq, ddq, rest, phases, times[k], at)
        for i in range(len(q)):
            out[k, i] = at[0, i]


# --- Stops of freedoms that mean something only together, as of two arms on one payload -----------
#
# A stop is its phases, as in `profile.py`.

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


@inner_kernel
def _held(dq: float, ddq: float, up_s: float, hold_s: float, down_s: float) -> float:
    """Return the acceleration that is held on a stop: ramp to it, hold it, ramp to zero."""
    return -(dq + 0.5 * up_s * ddq) / (0.5 * up_s + hold_s + 0.5 * down_s)


@inner_kernel
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
    _stop_together(dq, ddq, acceleration, jerk, own, phases)
    return phases


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, ARRAY3, STACK)
def _stop_together(
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


# --- A stop: the verified way to rest that every command has --------------------------------------


class Stop(NamedTuple):
    """A jerk-limited way to rest."""

    start: Motion
    """Where it began."""
    phases: Array
    """How long each part of it lasts, and its jerk (2, k, n) [s, 1/s³]."""
    low: Array
    """Least position of each joint along the whole stop (n,)."""
    high: Array
    """Greatest position of each joint along the whole stop (n,)."""
    duration_s: float
    elapsed_s: float = 0.0

    def advanced(self, by_s: float) -> "Stop":
        """Return the same, further along."""
        return self._replace(elapsed_s=self.elapsed_s + by_s)

    @property
    def to_go_s(self) -> float:
        """Time until the end [s]."""
        return max(0.0, self.duration_s - self.elapsed_s)

    @property
    def finished(self) -> bool:
        """True once the end is reached."""
        return self.elapsed_s >= self.duration_s

    @staticmethod
    def along(start: Motion, phases: Array) -> "Stop":
        """Return the stop from `start` that goes through phases (2, k, n)."""
        low, high, duration_s = reach(*start, phases)
        return Stop(start, phases, low, high, duration_s)

    @staticmethod
    def at_rest(q: Array) -> "Stop":
        """Return the stop of what stands at q (n,)."""
        return Stop.along(Motion.at_rest(q), np.zeros((2, 1, len(q))))

    def of(self, part: slice) -> "Stop":
        """Return that of some freedoms."""
        start, phases = self.start.of(part), self.phases[:, :, part]
        return Stop(start, phases, self.low[part], self.high[part], self.duration_s, self.elapsed_s)

    def at(self, ahead_s: float = 0.0) -> Motion:
        """Return the motion `ahead_s` after now."""
        return Motion(*stop_at(*self.start, self.phases, self.elapsed_s + ahead_s))

    def postures(self, ahead_s: Array) -> Array:
        """Return the positions (s, n) at times (s,) after now."""
        return stop_postures(*self.start, self.phases, self.elapsed_s + ahead_s)


# --- Ramps of a quick stop by which joints that mean something together come to rest together -----


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
