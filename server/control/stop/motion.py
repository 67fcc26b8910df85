"""Position, velocity and acceleration of several degrees of freedom."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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

    def of(self, part: slice | NDArray[np.int64]) -> "Motion":
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


Part = slice | NDArray[np.int64]
"""Some of the freedoms."""


def arriving(
    n: int, parts: Sequence[slice], groups: Sequence[NDArray[np.int64]]
) -> tuple[tuple[Part, bool], ...]:
    """Return which freedoms arrive together, and whether they always do; none for all of n.

    A group takes the place of its parts.
    """
    if len(parts) < 2:
        return ()
    grouped = {int(i) for group in groups for i in group}
    alone = [part for part in parts if not grouped.intersection(range(n)[part])]
    found: tuple[tuple[Part, bool], ...] = tuple((group, True) for group in groups)
    found += tuple((part, False) for part in alone)
    return found if len(found) > 1 else ()
