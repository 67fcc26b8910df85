"""Which part of the measured wrench the torque law answers, where sensor and motors may disagree.

While brakes hold the arm, the bias of a sensor reads like a load. To answer a bias swings the tool
as soon as they open; not to answer a load lets it sink. So when the drives are first switched on,
what may be a weight is answered, and what cannot be is left out: the momentum observer, which goes
by the motors alone, finds what of it is there. What was found stays known while drives are off.

A bias that is told later changes the reading and no load, whether it is right or wrong: it is left
out as well. So is what a sensor reads that was silent for a while: the observer has found that.
"""

import math
from typing import NamedTuple

import numpy as np

from ..compiled import NUMBER, VECTOR, compiled
from ..spatial import GRAVITY, Array

FORCE, MOMENT, ANGLE = 5.0, 0.5, math.radians(6.0)
"""A sensor may be off by so much, and its mounting [N, N·m, rad]."""
LEVER, NEAREST = 0.5, 0.01
"""Least and greatest distance from the sensor of a load that hangs on it [m]."""
LEVEL = 0.1
"""A tool that is nearer to upright does not tell where on it a weight is: sin² of its angle [1]."""


class Believed(NamedTuple):
    """The part of the reading that is left out, and the figures that it was judged by."""

    left_out: Array
    """(6,) at and in the Wrist [N, N·m]."""
    offset: Array | None = None
    """The bias that was taken off the reading (6,), at and in the Wrist; None at first."""
    heard: bool = True
    """The sensor was fresh."""
    driven: bool = False
    """Drives were on in the last tick."""
    judged: bool = False
    """Drives have been on."""


NOTHING_LEFT_OUT = Believed(np.zeros(6))


def believed(
    before: Believed,
    wrench: Array | None,
    offset: Array,
    weight: bool,
    settled: bool,
    standing: bool,
    part: float,
) -> Believed:
    """Return what of a `wrench` (6,) on the arm is left out, at and in the Wrist; None when stale.

    `offset` (6,) is what was taken off the reading as its bias. While the drives are off
    (`settled`) and the joints are `standing`, a wrench that may not be a `weight` is taken over by
    a `part` in each tick.
    """
    first = before.offset is None
    told = np.zeros(6) if before.offset is None else offset - before.offset
    out, judged = before.left_out, before.judged or not settled
    if wrench is None:
        return Believed(out + told, offset, False, not settled, judged)
    if judged:
        found = not before.heard and not settled
        out = wrench if found else out + told
    elif standing or first:
        wanted = np.zeros(6) if weight else wrench
        out = wanted if first or not before.heard else out + part * (wanted - out)
    return Believed(out, offset, True, not settled, judged)


def without_what_is_there(state: Believed, J: Array, residual: Array) -> Believed:
    """Return the state without the share of what is left out that the observer found to be there.

    J (6, n) is the Wrist's Jacobian in its own axes, `residual` (n,) the observer's [N·m].
    """
    torque = state.left_out @ J
    size = float(torque @ torque)
    if size == 0.0:
        return state
    share = min(1.0, max(0.0, float(residual @ torque) / size))
    return state._replace(left_out=(1.0 - share) * state.left_out)


@compiled(VECTOR, VECTOR, VECTOR, NUMBER, NUMBER)
def may_be_weight(
    wrench: Array, down: Array, outboard: Array, carried: float, rated: float
) -> bool:
    """Return whether a wrench (6,) on the arm may be the weight of a load that was told wrong.

    At the Sensor; `down` and `outboard` (3,) are unit vectors in the same axes, the latter along
    the tool, zero where that is not known. `carried` [kg] is told, `rated` [kg] is the most.
    """
    force2, moment2, along, about, lies, tool2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        force2 += wrench[i] ** 2
        moment2 += wrench[3 + i] ** 2
        along += wrench[i] * down[i]
        about += wrench[3 + i] * down[i]
        lies += outboard[i] * down[i]
        tool2 += outboard[i] ** 2
    g = abs(GRAVITY[2])
    force, moment, slack = math.sqrt(force2), math.sqrt(moment2), FORCE
    turned = math.sin(ANGLE)
    if math.sqrt(max(0.0, force2 - along**2)) > slack + turned * force:
        return False
    if not -carried * g - slack <= along <= (rated - carried) * g + slack:
        return False
    if abs(about) > MOMENT + turned * moment:
        return False
    if moment > MOMENT + LEVER * (force + carried * g):
        return False
    # Turned by its weight as by one on the tool's axis: it hangs outboard of the sensor.
    turning = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        turning += wrench[3 + i] * (outboard[j] * down[k] - outboard[k] * down[j])
    level = tool2 - lies**2
    if abs(along) <= slack or level <= LEVEL:
        return True
    return turning / along >= NEAREST * level
