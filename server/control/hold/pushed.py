"""What pushes an arm that holds: unseen contact by its joints' torques, and what a sensor sees."""

import math
from typing import NamedTuple

import numpy as np

from ..spatial import Array

RELEASE = 0.7
"""A joint is pushed no longer below this part of its bound [1]."""

NEW = 0.5
"""Contact that the sensor sees came with the touch where more than this part of it is new [1]."""


class Pushed(NamedTuple):
    """Unseen contact as the watch over the drives' torques estimates it (n,) [N·m]."""

    external: Array
    """Torques that nothing explains."""
    excused: Array
    """What of that friction and inertia may be."""
    bound: Array
    """What means contact beyond that."""
    touched: bool = False
    """The arm was stopped for it, and is to give way."""
    lasting: bool = False
    """It has not been released since."""
    free: Array | None = None
    """`external` before it was touched; None where that is not known."""
    wrench: Array | None = None
    """What the force/torque sensor sees push the tool (6,), at the MRF in World axes [N, N·m]."""
    free_wrench: Array | None = None
    """The same before it was touched; None where that is not known."""


def released(pushed: Pushed) -> bool:
    """Return whether nothing pushes any more."""
    return not beyond(pushed.external, pushed).any()


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
    seen = pushed.wrench @ J
    return seen, seen - pushed.free_wrench @ J if pushed.free_wrench is not None else 0.0 * seen


def relieves(dq: Array, seen: Array, new: Array, pushed: Pushed) -> bool:
    """Return whether rates dq (n,) give way to contact that the sensor saw with the touch."""
    return float(new @ dq) > max(magnitude(dq * pushed.bound), NEW * float(seen @ dq))


def magnitude(x: Array) -> float:
    """Return the length of a vector (n,)."""
    return math.sqrt(float(x @ x))
