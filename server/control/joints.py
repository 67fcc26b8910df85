"""The joints of one cell: their names and the bounds of what they may be commanded."""

from typing import NamedTuple

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

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.names)
