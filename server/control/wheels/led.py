"""Wheels that are driven, in a programme of barriers: one unknown, how far along their arc.

So a base is slowed on its arc, never turned off it, and never rolls because a joint of its arm is
at a bound.
"""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from ..scene import Index
from ..spatial import Array


class Led(NamedTuple):
    """The m unknowns of n joints: each joint is one, and each pair of driven wheels is one."""

    whole: Array
    """Rates of the joints per unknown (n, m)."""
    kept: Index
    """Joints that the unknowns are named after (m,): of a pair the left wheel."""
    asked: Array
    """Rates that are asked for (m,)."""
    low: Array
    high: Array

    @classmethod
    def of(cls, dq: Array, low: Array, high: Array, wheels: Sequence[int]) -> Self:
        """Return those of rates dq (n,) within bounds (n,); `wheels` are the left ones' places.

        Between standing and what is asked, a pair keeps its proportion.
        """
        n = len(dq)
        kept = np.array([j for j in range(n) if j - 1 not in wheels], dtype=np.int64)
        whole = np.zeros((n, len(kept)))
        whole[kept, np.arange(len(kept))] = 1.0
        asked, least, most = dq[kept], low[kept], high[kept]
        for i in wheels:
            at, pair = int(np.flatnonzero(kept == i)[0]), dq[i : i + 2]
            size = float(np.abs(pair).max())
            along = pair / size if size > 0.0 else np.zeros(2)
            whole[i : i + 2, at] = along
            asked[at], least[at], most[at] = size, 0.0, size
            for turn, down, up in zip(along, low[i : i + 2], high[i : i + 2], strict=True):
                if turn != 0.0:
                    most[at] = min(most[at], max(0.0, (up if turn > 0.0 else down) / turn))
        return cls(whole, kept, asked, least, most)
