"""The nearest joint rates that keep every barrier: a small quadratic programme (DAQP).

Self-motion is spent first, then the tool slows along its path, and only then does it leave the
path: the unknowns are the joint rates and the share s of the asked tool motion, and leaving the
path (J dq ≠ s ẋ) costs far more than going slower (s < 1), which costs far more than self-motion.
An arm that only slowed would creep to a stop beside whatever stands across its path. So s does not
fall below `SLIDE`: what is still too much then is taken off sideways, and since the least of it
is, it is what approaches that goes. The rest slides on, along the barrier; where nothing is left
of the motion but what approaches, the arm stands.
Barriers are hard, where standing keeps them all; where a joint is to be led back into its limits,
those of the joint rates are, and the others as well as can be. That a gap which is inside its bound
is widened has a price: as well as it can be, and never by closing another.
"""

import math
from typing import NamedTuple

import daqp
import numpy as np

from ..frames import Array

LEAVE_PATH = 1000.0
"""Cost of tool motion off the path, per (m/s)²."""
SLOW_DOWN = 3.0
"""Cost of going slower than asked, per (m/s)²."""
SLIDE = 0.5
"""Slowed to this share of what is asked, the tool goes no slower but leaves the path [1]."""
ATTITUDE = 3.0
"""Rotations count so much more here than in the resolution of tool rates: a tool that is pushed at
something is not to tilt for the little way that this gains it [1]."""
SELF_MOTION = 0.05
"""Cost of joint rates other than asked, per part of V squared."""

WIDEN = 1e4
"""Cost of not widening a gap as told, per (m/s)²; it is never worth closing another."""
UNBOUNDED = 1e30
UNASKED = 1e-9
"""A tool motion below this is none [m/s]."""

_SOFT = 8
"""DAQP's sign of a soft constraint."""


class Nearest(NamedTuple):
    """Joint rates inside all bounds."""

    dq: Array
    share: float
    """Size of the tool motion that is left, on the path or sliding, as a share of the asked one,
    0 to 1."""
    pace: float
    """Share of its asked speed at which the path itself may go on: that of the motion whose
    projection this is, `SLIDE` at least."""


class BarrierError(Exception):
    """The programme has no solution: carries the solver's flag and the bounds."""


def nearest(
    dq: Array,
    J: Array,
    low: Array,
    high: Array,
    velocity: Array,
    characteristic_length: float,
    rows: tuple[Array, Array] | None = None,
) -> Nearest:
    """Return the rates nearest to dq (n,) with low ≤ dq ≤ high (n,) [rad/s].

    J (6, n) is the task's Jacobian and `velocity` (n,) the joint speed bounds; `rows` are A (m, n)
    and b (m,) of further barriers A dq ≥ b; those with b > 0 are to be widened.
    """
    n = len(dq)
    weight = np.array([1.0, 1.0, 1.0] + [ATTITUDE * characteristic_length] * 3)
    Jw = J * weight[:, None]
    x = Jw @ dq
    slopes, least = rows if rows is not None else (np.zeros((0, n)), np.zeros(0))
    widened = least > 0.0
    m, k = len(least), int(widened.sum())
    size = n + 1 + k
    H = np.zeros((size, size))
    # ‖J dq' − s ẋ‖² and ‖(dq' − s dq)/V‖², in the unknowns (dq', s).
    H[:n, :n] = LEAVE_PATH * (Jw.T @ Jw)
    cross = LEAVE_PATH * (Jw.T @ x)
    inverse2 = SELF_MOTION / velocity**2
    H[np.arange(n), np.arange(n)] += inverse2
    cross += inverse2 * dq
    H[:n, n] = -cross
    H[n, :n] = -cross
    asked2 = float(x @ x)
    slow = SLOW_DOWN * asked2 + SELF_MOTION * float((dq / velocity) @ (dq / velocity)) + 1e-9
    H[n, n] = LEAVE_PATH * asked2 + float(inverse2 @ (dq * dq)) + slow
    # What widening falls short by, one more unknown for each gap that is to be widened.
    H[np.arange(n + 1, size), np.arange(n + 1, size)] = WIDEN
    f = np.zeros(size)
    f[n] = -slow
    A = np.zeros((m + k, size))
    A[:m, :n] = slopes
    A[m:, :n] = slopes[widened]
    A[m:, n + 1 :] = np.eye(k)
    lower = np.concatenate([low, [SLIDE], np.zeros(k), np.minimum(least, 0.0), least[widened]])
    upper = np.full(len(lower), UNBOUNDED)
    upper[:n], upper[n] = high, 1.0
    sense = np.zeros(len(lower), dtype=np.int32)
    if (low > 0.0).any() or (high < 0.0).any():
        sense[size : size + m] = _SOFT
    solution, _, flag, _ = daqp.solve(H, f, A, upper, lower, sense)
    if flag not in (1, 2):
        raise BarrierError(f"solver flag {flag}, bounds {low} to {high}")
    found, pace = np.clip(solution[:n], low, high), float(solution[n])
    left, asked = Jw @ found, math.sqrt(asked2)
    share = pace if asked < UNASKED else min(pace, math.sqrt(float(left @ left)) / asked)
    return Nearest(found, share, pace)
