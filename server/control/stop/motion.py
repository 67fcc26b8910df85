"""Position, velocity and acceleration of several degrees of freedom."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..compiled import NUMBER, VECTOR, compiled
from ..spatial import Array


class Motion(NamedTuple):
    """Position, velocity and acceleration of n degrees of freedom."""

    q: Array
    dq: Array
    ddq: Array

    @staticmethod
    def at_rest(q: Array) -> "Motion":
        """Return rest at q (n,)."""
        return Motion(q.copy(), np.zeros_like(q), np.zeros_like(q))

    @staticmethod
    def of_all(each: "Sequence[Motion]") -> "Motion":
        """Return several as one, their freedoms one after the other."""
        return each[0] if len(each) == 1 else Motion(*map(np.concatenate, zip(*each, strict=True)))

    def of(self, part: slice) -> "Motion":
        """Return that of some freedoms."""
        return Motion(self.q[part], self.dq[part], self.ddq[part])

    def stands(self, below: float = 0.0) -> bool:
        """Return whether no speed and no acceleration is as large as `below`, or any at all."""
        return _stands(self.dq, self.ddq, below)


@compiled(VECTOR, VECTOR, NUMBER)
def _stands(dq: Array, ddq: Array, below: float) -> bool:
    for i in range(len(dq)):
        for size in (abs(dq[i]), abs(ddq[i])):
            if not (size == 0.0 or size < below):  # nor what is not a number
                return False
    return True
