"""Ramps of a quick stop of joints that mean something only together, by their places in a cell."""

from collections.abc import Sequence

import numpy as np

from ..control.spatial import Array
from ..control.stop.quick_stop import ramps_in_proportion
from .unit import Unit

REFERENCE_LAG = 2
"""A drive follows the command of so many periods ago [1]."""
LEAST_SPREAD = 0.01
"""A drive's speed is known to this at best [rad/s]."""


def ramps_together(units: Sequence[Unit], spread: Array) -> dict[int, float]:
    """Return the ramps by which all joints of some arms come to rest together [rad/s²].

    By the joints' places in the cell; none before the first tick. `spread` (n,) as in
    `ramps_in_proportion`.
    """
    told = [(unit, unit.output) for unit in units if unit.output is not None]
    if len(told) < len(units):
        return {}
    dq = np.concatenate([output.dq for _, output in told])
    drives = [d for unit in units for d in unit.cell.config.mechanism.drives]
    ramps = ramps_in_proportion(dq, np.array([d.quick_stop_deceleration for d in drives]), spread)
    places = [i for unit in units for i in range(unit.joints.start, unit.joints.stop)]
    return dict(zip(places, ramps.tolist(), strict=True))


def bounded_spread(units: Sequence[Unit]) -> Array:
    """Return how far speeds (n,) may be from those last told, by the drives' accelerations."""
    drives = [d for unit in units for d in unit.cell.config.mechanism.drives]
    lag_s = REFERENCE_LAG * units[0].arm.p.period_s
    return lag_s * np.array([d.max_acceleration for d in drives])


def curve_ramps(unit: Unit) -> dict[int, float]:
    """Return the ramps by which an arm stops along its curve, of all its joints; else none.

    Its slow joints matter as much as its fast ones, so that what they may differ by is taken from
    how they accelerate now.
    """
    backbone = unit.cell.config.mechanism.backbone
    if backbone is None or backbone.quick_stop == "each" or unit.memory is None:
        return {}
    lag_s = REFERENCE_LAG * unit.arm.p.period_s
    spread = np.maximum(lag_s * np.abs(unit.memory.motion.ddq), LEAST_SPREAD)
    return ramps_together((unit,), spread)
