"""The generalised-momentum observer: which torque acts on the joints beside what is known.

De Luca, Albu-Schäffer, Haddadin, Hirzinger 2006: `r = K (p − ∫ (τ + Cᵀ dq − g + r) dt)` with
`p = M dq` follows the unknown torque as a first-order filter of bandwidth K does, without
accelerations. What is not known is friction, errors of the model, and a collision.
"""

from typing import NamedTuple

import numpy as np

from .frames import Array


class MomentumState(NamedTuple):
    """What the observer remembers."""

    expected: Array
    """Momentum (n,) that what is known, and the residual, would have made [N·m·s]."""
    residual: Array
    """Torque (n,) beside what is known [N·m]."""


def begin(momentum: Array) -> MomentumState:
    """Return the state that suspects nothing, at a momentum (n,) [N·m·s]."""
    return MomentumState(momentum, np.zeros_like(momentum))


def observe(
    state: MomentumState, momentum: Array, known: Array, bandwidth: float, period_s: float
) -> MomentumState:
    """Return the state one period later.

    `momentum` (n,) is `M dq` now; `known` (n,) is `τ + Cᵀ dq − g` with every torque that is known,
    over the period that has passed [N·m]; `bandwidth` is K [1/s]. Integrated so that it is stable
    at any bandwidth (backward in r).
    """
    expected = state.expected + period_s * known
    residual = bandwidth * (momentum - expected) / (1.0 + bandwidth * period_s)
    return MomentumState(expected + period_s * residual, residual)


def corrected(momentum: Array, residual: Array, bandwidth: float) -> MomentumState:
    """Return the state that goes on from another residual (n,), at a momentum (n,)."""
    if bandwidth <= 0.0:
        return MomentumState(momentum, np.zeros_like(momentum))
    return MomentumState(momentum - residual / bandwidth, residual)
