"""Stability of following a hand: delays of the loop, and the stiffest hand that it bears."""

import math

from ...config.load import Cell
from ..control.mechanism.contact_wrench import INERTIA_PERIODS, MEAN_PERIODS
from ..control.task.sources.following import smoothing_s
from .force_loop import BUS_PERIODS, filter_periods

AHEAD_PERIODS = 1.0
"""The reference is integrated to the end of the period, the others' rates act in it [periods]."""

HELD_PERIODS = 0.5
"""A speed or a torque is held for a period, a position is interpolated [periods]."""


def delays(cell: Cell, payload: float | None = None) -> dict[str, float]:
    """Return by how much each part makes the tool later than the hand's force asks [periods].

    Under a payload [kg], by default the cell's own. Raises `ValueError` for a cell without a
    force/torque sensor.
    """
    sensor, period = cell.config.mechanism.force_torque, cell.config.timing.period_s
    if sensor is None:
        raise ValueError(f"cell {cell.config.name}: no force/torque sensor, so no hand is felt")
    mode, following = cell.config.mechanism.operation_mode, cell.config.sources.following
    mass = sensor.payload.mass if payload is None else payload
    return {
        "sensor": MEAN_PERIODS,
        "inertia": INERTIA_PERIODS if sensor.inertia else 0.0,
        "filter": filter_periods(sensor.filter_hz, period),
        "payload": smoothing_s(following.payload_smoothing_s, mass, following.mass) / period,
        "bus": BUS_PERIODS - AHEAD_PERIODS,
        "drive": {
            "csp": 0.0,
            "csv": HELD_PERIODS,
            "cst": HELD_PERIODS + cell.config.torque.lag_s / period,
        }[mode],
    }


def stiffest_hand(cell: Cell, share: float = 1.0, payload: float | None = None) -> float:
    """Return the stiffness of a hand at which following would begin to swing [N/m].

    The loop is `M s² + B s + share · k e^(−s d) / (1 + s τ)`, τ the low-pass under the payload [kg]
    and d the rest of the delay. It swings at the frequency ω where `ω tan φ = B / M`, with
    `φ = ω d + atan(ω τ)`, and `k = B ω √(1 + ω² τ²) / sin φ`.
    """
    following, T = cell.config.sources.following, cell.config.timing.period_s
    late = delays(cell, payload)
    tau = late.pop("payload") * T
    d = sum(late.values()) * T
    wanted = following.damping / following.mass
    low, high = 0.0, 0.5 * math.pi / d
    for _ in range(100):
        w = 0.5 * (low + high)
        phase = w * d + math.atan(w * tau)
        late_enough = phase >= 0.5 * math.pi or w * math.tan(phase) >= wanted
        low, high = (low, w) if late_enough else (w, high)
    w = 0.5 * (low + high)
    phase = w * d + math.atan(w * tau)
    return following.damping * w * math.hypot(1.0, w * tau) / (math.sin(phase) * max(share, 1e-9))


def following_refusal(cell: Cell, axis: int, share: float) -> str | None:
    """Return why a share of the hand's force or moment may not be followed, or None."""
    if not 0.0 <= share <= 1.0:
        return f"gain[{axis}] = {share:g}: a share of what is measured, between 0 and 1"
    if axis < 3 and share > 0.0:
        hand, most = cell.config.sources.following.stiffest_hand, stiffest_hand(cell, share)
        if hand >= most:
            return f"gain[{axis}] = {share:g}: a hand of {hand:g} N/m, stable below {most:.3g}"
    return None
