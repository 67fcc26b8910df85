"""How late the arm follows a hand, and how stiff a hand may hold it."""

import math

from ..config.load import Cell
from .control.sources.force import INERTIA_PERIODS
from .stability import BUS_PERIODS, filter_periods

AHEAD_PERIODS = 1.0
"""The reference is integrated to the end of the period, the others' rates act in it [periods]."""

HELD_PERIODS = 0.5
"""A speed or a torque is held for a period, a position is interpolated [periods]."""


def delays(cell: Cell) -> dict[str, float]:
    """Return by how much each part makes the tool later than the hand's force asks [periods].

    Raises `ValueError` for a cell without a force/torque sensor.
    """
    sensor, period = cell.config.mechanism.force_torque, cell.config.timing.period_s
    if sensor is None:
        raise ValueError(f"cell {cell.config.name}: no force/torque sensor, so no hand is felt")
    mode = cell.config.mechanism.operation_mode
    return {
        "sensor": 0.5 / (sensor.rate_hz * period),
        "inertia": INERTIA_PERIODS if sensor.inertia else 0.0,
        "filter": filter_periods(sensor.filter_hz, period),
        "bus": BUS_PERIODS - AHEAD_PERIODS,
        "drive": {
            "csp": 0.0,
            "csv": HELD_PERIODS,
            "cst": HELD_PERIODS + cell.config.torque.lag_s / period,
        }[mode],
    }


def stiffest_hand(cell: Cell, share: float = 1.0) -> float:
    """Return the stiffness of a hand at which following would begin to swing [N/m].

    The loop is `M s² + B s + share · k e^(−s d)`, d the whole delay. It swings at the frequency ω
    where `ω tan(ω d) = B / M`, with `k = B ω / sin(ω d)`.
    """
    following = cell.config.sources.following
    d = sum(delays(cell).values()) * cell.config.timing.period_s
    wanted = following.damping / following.mass
    low, high = 0.0, 0.5 * math.pi / d
    for _ in range(100):
        w = 0.5 * (low + high)
        low, high = (w, high) if w * math.tan(w * d) < wanted else (low, w)
    w = 0.5 * (low + high)
    return following.damping * w / (math.sin(w * d) * max(share, 1e-9))


def following_refusal(cell: Cell, axis: int, share: float) -> str | None:
    """Return why a share of the hand's force or moment may not be followed, or None."""
    if not 0.0 <= share <= 1.0:
        return f"gain[{axis}] = {share:g}: a share of what is measured, between 0 and 1"
    if axis < 3 and share > 0.0:
        hand, most = cell.config.sources.following.stiffest_hand, stiffest_hand(cell, share)
        if hand >= most:
            return f"gain[{axis}] = {share:g}: a hand of {hand:g} N/m, stable below {most:.3g}"
    return None
