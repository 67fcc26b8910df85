"""Forces that push an arm in HOLD: estimated at its joints, or seen by a sensor."""

import math
from typing import NamedTuple

import numpy as np

from ..spatial import Array, sizes

RELEASE = 0.7
"""A joint, or the tool, is pushed no longer below this part of its bound [1]."""

NEW = 0.5
"""Contact that the sensor sees came with the touch where more than this part of it is new [1]."""


class Pushed(NamedTuple):
    """Unseen contact as the watch over the drives' torques estimates it (n,) [N·m]."""

    external: Array
    """Torques that nothing explains."""
    excused: Array
    """The part of that which may be friction and inertia."""
    bound: Array
    """Bound beyond that which means contact."""
    touched: bool = False
    """The arm was stopped for it, and is to give way."""
    lasting: bool = False
    """It has not been released since."""
    free: Array | None = None
    """`external` before it was touched; None where that is not known."""
    wrench: Array | None = None
    """Wrench on the tool by the force/torque sensor (6,), at the MRF in World axes [N, N·m]."""
    steady: Array | None = None
    """The mean of that over the last ticks: the arm's own jerks are not in it."""
    free_wrench: Array | None = None
    """The same before it was touched; None where that is not known."""
    tool_bound: float | None = None
    """Change of that force that means contact of the tool [N]; None: the tool was not touched."""


def released(pushed: Pushed) -> bool:
    """Return whether nothing pushes the joints any more."""
    return not beyond(pushed.external, pushed).any()


def tool_released(pushed: Pushed) -> bool:
    """Return whether the tool is no longer pushed by more than before it was touched.

    The weight of a payload that was told wrong is the same before and after, in World axes; its
    inertia reads like a push whenever the arm begins to give way or ends.
    """
    if pushed.tool_bound is None or pushed.steady is None or pushed.free_wrench is None:
        return True
    return sizes(pushed.steady - pushed.free_wrench)[0] <= RELEASE * pushed.tool_bound


def tool_push(pushed: Pushed, new: Array) -> Array:
    """Return the joint torques (n,) of the tool's contact: `new` as long as it lasts [N·m]."""
    return np.zeros(len(new)) if tool_released(pushed) else new


def beyond(torque: Array, pushed: Pushed) -> Array:
    """Return by how much torques (n,) are beyond what releases each joint (n,) [N·m]."""
    rest = np.abs(torque) - pushed.excused - RELEASE * pushed.bound
    return np.asarray(np.sign(torque) * np.maximum(rest, 0.0))


def leads_into(dq: Array, pushed: Pushed) -> bool:
    """Return whether rates dq (n,) lead into what pushes unseen."""
    return -float(pushed.external @ dq) > magnitude(dq * (pushed.bound + pushed.excused))


def seen_torques(pushed: Pushed, J: Array) -> tuple[Array, Array]:
    """Return the joint torques (n,) of contact that the sensor sees, and what came with the touch.

    What it reads by a payload or a bias that is wrong was there before.
    """
    if pushed.wrench is None:
        return np.zeros(J.shape[1]), np.zeros(J.shape[1])
    now = pushed.wrench @ J
    return now, now - pushed.free_wrench @ J if pushed.free_wrench is not None else 0.0 * now


def relieves(dq: Array, seen: Array, new: Array, pushed: Pushed) -> bool:
    """Return whether rates dq (n,) give way to contact that the sensor saw with the touch."""
    return float(new @ dq) > max(magnitude(dq * pushed.bound), NEW * float(seen @ dq))


def magnitude(x: Array) -> float:
    """Return the Euclidean norm."""
    return math.sqrt(float(x @ x))
