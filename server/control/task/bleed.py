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
    """(6,) in World axes; attitude is held but where a moment is bled off."""


def bleed(
    bleeding: bool,
    wrench: Array | None,
    asked: Array,
    away: Array,
    threshold: float,
    leash: float,
    threshold_moment: float = math.inf,
) -> Bled:
    """Return whether contact is bled off now, and how.

    `wrench` (6,) is what the arm exerts, None when stale; `asked` (6,) what force control asks for,
    and `away` (3,) how far the Wrist is from where HOLD began [m], both in World axes. Moments are
    bled off beyond their threshold [N·m] where it is given.
    """
    if wrench is None:
        return Bled(False, np.zeros(6))
    part = BLED_OFF if bleeding else 1.0
    pushes = math.sqrt(float(wrench[:3] @ wrench[:3])) > threshold * part
    turns = math.sqrt(float(wrench[3:] @ wrench[3:])) > threshold_moment * part
    if not (pushes or turns):
        return Bled(False, np.zeros(6))
    twist = asked.copy()
    room = max(0.0, leash - math.sqrt(float(away @ away)))
    share = min(1.0, room / (0.2 * leash + 1e-12))
    if float(asked[:3] @ away) > 0.0:
        twist[:3] *= share
    # Turning about a grasp takes the Wrist along, whichever way.
    twist[3:] *= share if turns else 0.0
    return Bled(True, twist)


def relief(wrench: Array | None, asked: Array, threshold: float) -> Array | None:
    """Return the twist (6,) by which joints that are commanded themselves give way to contact.

    In World axes, forces only; None where contact is below the part of the threshold at which it
    counts as bled off: noise and inertia move no joint. `wrench` (6,) is what the arm exerts,
    `asked` (6,) accommodation of all of it.
    """
    size = 0.0 if wrench is None else math.sqrt(float(wrench[:3] @ wrench[:3]))
    if size <= BLED_OFF * threshold:
        return None
    twist = (1.0 - BLED_OFF * threshold / size) * asked
    twist[3:] = 0.0
    return twist


def joint_share(force: float, threshold: float) -> float:
    """Return the share (0 to 1) of joint rates that lead into contact of a force [N]."""
    return min(1.0, max(0.0, (threshold - force) / ((1.0 - BLED_OFF) * threshold)))
