"""In HOLD, force control goes on alone, inside a small leash, until contact is bled off."""

import math
from typing import NamedTuple

import numpy as np

from ..spatial import Array

BLED_OFF = 0.3
"""Bleeding off contact in HOLD ends at this part of its threshold [1]."""


class Bled(NamedTuple):
    """Whether contact is being bled off, and the twist that does it."""

    bleeding: bool
    twist: Array
    """(6,) in World axes; forces only, attitude is held."""


def bleed(
    bleeding: bool, wrench: Array | None, asked: Array, away: Array, threshold: float, leash: float
) -> Bled:
    """Return whether contact is bled off now, and how.

    `wrench` (6,) is what the arm exerts, None when stale; `asked` (6,) what force control asks for,
    and `away` (3,) how far the Wrist is from where HOLD began [m], both in World axes.
    """
    size = 0.0 if wrench is None else math.sqrt(float(wrench[:3] @ wrench[:3]))
    if wrench is None or size <= threshold * (BLED_OFF if bleeding else 1.0):
        return Bled(False, np.zeros(6))
    twist = asked.copy()
    if float(asked[:3] @ away) > 0.0:
        room = max(0.0, leash - math.sqrt(float(away @ away)))
        twist *= min(1.0, room / (0.2 * leash + 1e-12))
    twist[3:] = 0.0
    return Bled(True, twist)
