"""Stability of following a hand: delays of the loop, and the stiffest hand that it bears."""

import cmath
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


def stiffest_hand(
    cell: Cell, share: float = 1.0, payload: float | None = None, turning: float = 0.0
) -> float:
    """Return the stiffness of a hand at which following would begin to swing [N/m].

    With `G(s) = share / (M s² + B s) + turning / (I s² + B_a s)`, the loop is
    `1 + k G e^(−s d) / (1 + s τ)`, τ the low-pass under the payload [kg] and d the rest of the
    delay. It swings where its phase is −π. `turning` is the share of the moment that is followed,
    times the square of the lever from the MRF to the hand [m²].
    """
    f, T = cell.config.sources.following, cell.config.timing.period_s
    late = delays(cell, payload)
    tau = late.pop("payload") * T
    d = sum(late.values()) * T
    share = max(share, 1e-9)

    def gives(w: float) -> complex:
        s = 1j * w
        moves = share / (f.mass * s + f.damping) + turning / (f.inertia * s + f.angular_damping)
        return moves / s

    low, high = 0.0, 0.5 * math.pi / d
    for _ in range(100):
        w = 0.5 * (low + high)
        late_enough = w * d + math.atan(w * tau) - cmath.phase(gives(w)) >= math.pi
        low, high = (low, w) if late_enough else (w, high)
    w = 0.5 * (low + high)
    return math.hypot(1.0, w * tau) / abs(gives(w))
