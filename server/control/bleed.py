"""In HOLD: let force control go on alone, inside a small leash, until contact is bled off."""

import math
from dataclasses import replace

import numpy as np

from .frames import Array
from .mechanism import Kinematics
from .state import Inputs, Intent, Memory

BLED_OFF = 0.3
"""Bleeding off contact in HOLD ends at this part of its threshold [1]."""


def bleed(
    memory: Memory,
    inputs: Inputs,
    k: Kinematics,
    wrench: Array | None,
    force: Array,
    threshold: float,
    leash: float,
) -> tuple[Memory, Array]:
    """Return the memory, and the part of the force source's twist (6,) that may act.

    `wrench` (6,) is the contact wrench at the MRF, `threshold` [N] where bleeding begins, `leash`
    [m] how far the Wrist may go from where HOLD began.
    """
    if inputs.intent is not Intent.HOLD:
        return replace(memory, hold=None, bleeding=False), np.zeros(6)
    hold = memory.hold if memory.hold is not None else k.T_world_wrist.p
    size = 0.0 if wrench is None else math.sqrt(float(wrench[:3] @ wrench[:3]))
    bleeding = wrench is not None and size > threshold * (BLED_OFF if memory.bleeding else 1.0)
    memory = replace(memory, hold=hold, bleeding=bleeding)
    if not bleeding:
        return memory, np.zeros(6)
    away = k.T_world_wrist.p - hold
    distance = math.sqrt(float(away @ away))
    if float(force[:3] @ away) > 0.0:
        room = max(0.0, leash - distance)
        force = force * min(1.0, room / (0.2 * leash + 1e-12))
    force = force.copy()
    force[3:] = 0.0
    return memory, force
