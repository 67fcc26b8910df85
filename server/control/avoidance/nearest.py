"""The nearest joint rates that keep every barrier: a small quadratic programme (DAQP).

Self-motion is spent first, then the tool slows along its path, and only then does it leave the
path: the unknowns are the joint rates and the share s of the asked tool motion, and leaving the
path (J dq ≠ s ẋ) costs far more than going slower (s < 1), which costs far more than self-motion.
An arm that only slowed would creep to a stop beside whatever stands across its path. So s does not
fall below `SLIDE`: what is still too much then is taken off sideways, and since the least of it
is, it is what approaches that goes. The rest slides on, along the barrier; where nothing is left
of the motion but what approaches, the arm stands.
Bounds of joint rates are hard; other barriers are soft, at a price that only what cannot be had at
all makes worth paying: an arm that is inside a bound is led back as well as it can be.
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
SELF_MOTION = 0.01
"""Cost of joint rates other than asked, per part of V squared."""

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
    and b (m,) of further barriers A dq ≥ b.
    """
    n = len(dq)
    weight = np.array([1.0, 1.0, 1.0] + [ATTITUDE * characteristic_length] * 3)
    Jw = J * weight[:, None]
    x = Jw @ dq
    H = np.zeros((n + 1, n + 1))
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
    f = np.zeros(n + 1)
    f[n] = -slow
    upper = np.append(high, 1.0)
    lower = np.append(low, SLIDE)
    m = 0 if rows is None else len(rows[1])
    A = np.zeros((m, n + 1))
    sense = np.zeros(n + 1 + m, dtype=np.int32)
    if rows is not None and m:
        A[:, :n] = rows[0]
        lower = np.concatenate([lower, rows[1]])
        upper = np.concatenate([upper, np.full(m, 1e30)])
        sense[n + 1 :] = _SOFT
    solution, _, flag, _ = daqp.solve(H, f, A, upper, lower, sense)
    if flag not in (1, 2):
        raise BarrierError(f"solver flag {flag}, bounds {low} to {high}")
    found, pace = np.clip(solution[:n], low, high), float(solution[n])
    left, size = Jw @ found, math.sqrt(asked2)
    share = pace if size < UNASKED else min(pace, math.sqrt(float(left @ left)) / size)
    return Nearest(found, share, pace)
