"""Protocol of redundancy objectives: joint rates at a gain of 1, for what one tick shows them.

An objective is one file in `objectives/`, one row in `table.py` and one field of the cell file's
`[redundancy]`. It knows its mechanism, and neither sources nor barriers nor other objectives.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, NamedTuple

from ...joints import Joints
from ...spatial import Array
from ..kinematics import Mechanism


class View(NamedTuple):
    """Inputs of the objectives in one tick."""

    q: Array
    """Commanded posture (n,) [rad]."""
    J: Array
    """Jacobian (6, n) of the tool there."""
    dq_task: Array
    """Joint rates (n,) of the task [rad/s]."""
    null: Array
    """Orthonormal rows (n − rank, n) that span the spare motions."""
    posture: Array
    """Joint angles (n,) that the posture objective pulls to [rad]."""
    outside: Mapping[str, Array]
    """Joint rates (n,) that obstacles ask for at a gain of 1, by the objective's name."""


class Objective(ABC):
    """Asks for joint rates; their part in the null space is what spare joints do."""

    WHOLE: ClassVar[bool] = False
    """Its rates are taken as they are, and their twist off that of the source of its name."""

    def __init__(self, joints: Joints, mechanism: Mechanism) -> None:  # noqa: B027 (most need no more)
        """Build it for one mechanism."""

    @abstractmethod
    def rate(self, view: View) -> Array:
        """Return joint rates (n,) [rad/s] at a gain of 1."""
