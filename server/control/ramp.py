"""Gains on their way: no change of a gain, and no switch, is a jump."""

import math
from collections.abc import Mapping

import numpy as np

from .frames import Array

GAIN_TIME_S = 0.15
"""Time constant with which a changed gain takes effect [s]."""


def ramped(
    gains: Mapping[str, Array], target: Mapping[str, Array], period_s: float
) -> dict[str, Array]:
    """Return each source's gains (6,) one period further on their way to the target's."""
    part = -math.expm1(-period_s / GAIN_TIME_S)
    after = {}
    for name, now in gains.items():
        way = target[name] - now
        after[name] = target[name] if np.abs(way).max() < 1e-7 else now + part * way
    return after
