"""The generalised-momentum observer, and the state of the arm that it foresees.

De Luca, Albu-Schäffer, Haddadin, Hirzinger 2006: `r = K (p − ∫ (τ + Cᵀ dq − g + r) dt)` with
`p = M dq` follows the unknown torque as a first-order filter of bandwidth K does, without
accelerations. What is not known is friction, errors of the model, and a collision.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import FLAG, MATRIX, NUMBER, VECTOR, compiled, inner_kernel
from ..spatial import Array


class MomentumState(NamedTuple):
    """Memory of the observer."""

    expected: Array
    """Momentum (n,) that what is known, and the residual, would have made [N·m·s]."""
    residual: Array
    """Torque (n,) beside what is known [N·m]."""


class Foreseen(NamedTuple):
    """An arm at the next SYNC, and the torques that it will want beside its model's."""

    inverse: Array
    """M⁻¹ (n, n), of now [1/(kg·m²)]."""
    q: Array
    """Joints (n,) [rad]."""
    dq: Array
    """Their rates (n,) [rad/s]."""
    expected: Array
    """The observer's momentum (n,), of now [N·m·s]."""
    residual: Array
    """The observer's torque (n,), of now [N·m]."""
    answer: Array
    """Torque that answers that and the measured force (n,) [N·m]."""
    rubbing: Array
    """Torque that overcomes friction (n,) [N·m]."""
    beyond: NDArray[np.bool_]
    """Joints (n,) of which more was found than is answered."""


def begin(momentum: Array) -> MomentumState:
    """Return the state that suspects nothing, at a momentum (n,) [N·m·s]."""
    return MomentumState(momentum, np.zeros_like(momentum))


@inner_kernel
def observed(
    expected: Array, momentum: Array, known: Array, bandwidth: float, period_s: float
) -> Array:
    """Return the residual (n,) [N·m] one period after a momentum (n,) was `expected` [N·m·s].

    `momentum` (n,) is `M dq` now; `known` (n,) is `τ + Cᵀ dq − g` with every torque that is known,
    over the period that has passed [N·m]; `bandwidth` is K [1/s]. Integrated so that it is stable
    at any bandwidth (backward in r).
    """
    out, rate = np.empty(len(momentum)), bandwidth / (1.0 + bandwidth * period_s)
    for i in range(len(out)):
        out[i] = rate * (momentum[i] - (expected[i] + period_s * known[i]))
    return out


@inner_kernel
def to_expect(momentum: Array, residual: Array, bandwidth: float) -> Array:
    """Return the momentum (n,) to be expected of an observer that goes on from a residual (n,)."""
    out = np.empty(len(momentum))
    for i in range(len(out)):
        out[i] = momentum[i] - (residual[i] / bandwidth if bandwidth > 0.0 else 0.0)
    return out


@inner_kernel
def _heading(q: Array, q_command: Array, dq_command: Array, lead: float, speed: float) -> Array:
    """Return which way each joint is to go, and how surely: −1 to 1 (n,).

    `speed` [rad/s] is what most of friction is full at, `lead` [1/s] turns an error into a speed.
    """
    out = np.empty(len(q))
    for i in range(len(q)):
        out[i] = math.tanh((dq_command[i] + lead * (q_command[i] - q[i])) / speed)
    return out


@inner_kernel
def _inverted(M: Array) -> Array:
    """Return the inverse of a symmetric positive definite matrix (n, n), by Gauss and Jordan."""
    n = len(M)
    out = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            out[i, j] = M[i, j]
    for k in range(n):
        pivot = 1.0 / out[k, k]
        out[k, k] = 1.0
        for j in range(n):
            out[k, j] *= pivot
        for i in range(n):
            if i != k:
                part = out[i, k]
                out[i, k] = 0.0
                for j in range(n):
                    out[i, j] -= part * out[k, j]
    return out


@inner_kernel
def _times(A: Array, x: Array) -> Array:
    out = np.zeros(A.shape[0])
    for i in range(A.shape[0]):
        for j in range(A.shape[1]):
            out[i] += A[i, j] * x[j]
    return out


@inner_kernel
def _within(x: Array, most: Array) -> Array:
    """Return x (n,), each part at most `most` (n,) in size; what is not a number stays."""
    out = np.empty(len(x))
    for i in range(len(x)):
        out[i] = x[i]
        if x[i] > most[i]:
            out[i] = most[i]
        elif x[i] < -most[i]:
            out[i] = -most[i]
    return out


@compiled(
    MATRIX, MATRIX, VECTOR, MATRIX, VECTOR, VECTOR,
    VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR,
    VECTOR, VECTOR, VECTOR, VECTOR,
    NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, NUMBER, FLAG,
)  # fmt: skip
def predict(
    M: Array, C: Array, g: Array, J: Array, wrench: Array, left_out: Array,
    q: Array, rate: Array, rate_foreseen: Array, acting: Array, acted: Array,
    expected: Array, residual: Array,
    q_command: Array, dq_command: Array, friction: Array, authority: Array,
    period_s: float, trust: float, bandwidth: float, lead: float, speed: float,
    compensation: float, settled: bool,
) -> Foreseen:  # fmt: skip
    """Return where the arm will be at the next SYNC.

    M, C, g are the terms of the dynamics, and `Jᵀ wrench` what is felt at the joints of what
    pushes the tool; `left_out` (6,) was measured beside it, and may be there or not. q (n,) was
    sampled now, `rate` (n,) is the mean one of the period before, and `rate_foreseen` (n,) what
    that of now was foreseen as. A torque `acted` (n,) over that period, another one is `acting`
    (n,) until the next SYNC; `expected` and `residual` (n,) are the observer's of one period ago.
    While `settled`, nothing is suspected.

    A `compensation` of what is felt is answered, and of what is found as much as is inside
    `authority` (n,), counted from anywhere between nothing and all that was measured: what the
    motors do not feel of that is taken back. `friction` (n,) is Coulomb's; `lead` and `speed` say,
    of the command, which way it will act.
    """
    n, T, inverse = len(q), period_s, _inverted(M)
    felt, drag, turning = _times(J.T, wrench), _times(C, rate), _times(C.T, rate)
    push, dq, known = np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        push[i] = acted[i] + (felt[i] + residual[i] - (drag[i] + g[i]))
        known[i] = acted[i] + (turning[i] - g[i]) + felt[i]
    # The rate now: the encoders' own, half a period old, carried on by what acted since.
    gained = _times(inverse, push)
    for i in range(n):
        dq[i] = rate[i] + 0.5 * T * gained[i]
        dq[i] = rate_foreseen[i] + trust * (dq[i] - rate_foreseen[i])
    momentum, found = _times(M, dq), np.zeros(n)
    if not settled and bandwidth > 0.0:
        found = observed(expected, momentum, known, bandwidth, T)
        # Without what friction alone may hold of a standing joint: learnt at rest, it would be in
        # the way when the joint sets off, as friction turns round then. The fourth power: a joint
        # that creeps is not standing, and what is learnt there counts.
        heading, holds = _heading(q, q_command, dq_command, lead, speed), np.empty(n)
        for i in range(n):
            holds[i] = friction[i] * (1.0 - abs(heading[i])) ** 4
        held = _within(found, holds)
        for i in range(n):
            found[i] -= held[i]
    for i in range(n):
        push[i] = acting[i] + felt[i] + found[i] - (drag[i] + g[i])
    ddq, q_next, dq_next = _times(inverse, push), np.empty(n), np.empty(n)
    for i in range(n):
        q_next[i] = q[i] + T * (dq[i] + 0.5 * T * ddq[i])
        dq_next[i] = dq[i] + T * ddq[i]
    doubted, answer, beyond = _times(J.T, left_out), np.empty(n), np.zeros(n, dtype=np.bool_)
    for i in range(n):
        low = min(0.0, -felt[i], doubted[i]) - authority[i]
        high = max(0.0, -felt[i], doubted[i]) + authority[i]
        beyond[i] = found[i] < low or found[i] > high
        answer[i] = min(max(found[i], low), high)
    rubbing = _heading(q_next, q_command, dq_command, lead, speed)
    for i in range(n):
        answer[i] = -answer[i] - compensation * felt[i]
        rubbing[i] *= friction[i]
    expect = to_expect(momentum, found, bandwidth)
    return Foreseen(inverse, q_next, dq_next, expect, found, answer, rubbing, beyond)
