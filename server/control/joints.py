"""The joints of one cell: their names and the bounds of what they may be commanded."""

from collections.abc import Sequence
from itertools import accumulate, chain, pairwise
from typing import NamedTuple

import numpy as np

from .spatial import Array


class Joints(NamedTuple):
    """Joints in the order of the robot description; all bounds are (n,)."""

    names: tuple[str, ...]
    lower: Array
    """Least joint angle that a command may ask for: the URDF's, plus the margin [rad]."""
    upper: Array
    velocity: Array
    """[rad/s]"""
    acceleration: Array
    """[rad/s²]"""
    jerk: Array
    """[rad/s³]"""
    leash: Array
    """How far the command may be ahead of a joint [rad]."""
    following_window: Array
    """How far a drive lets its joint fall behind before it faults [rad]."""
    rated_torque: Array
    """[N·m]"""

    @staticmethod
    def of_all(each: "Sequence[Joints]") -> "Joints":
        """Return the joints of several mechanisms, one after the other."""
        if len(each) == 1:
            return each[0]
        names, *bounds = zip(*each, strict=True)
        return Joints(tuple(chain.from_iterable(names)), *map(np.concatenate, bounds))

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.names)


def parts_of(counts: Sequence[int]) -> tuple[slice, ...]:
    """Return where each of several is among all, one after the other."""
    ends = list(accumulate(counts, initial=0))
    return tuple(slice(a, b) for a, b in pairwise(ends))


def joined(arrays: Sequence[Array], axis: int = 0) -> Array:
    """Return arrays as one; the only one as it is."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays, axis=axis)
