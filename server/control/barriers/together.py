"""Tools that hold one payload: they keep one share of what is asked, and do not pull it apart.

Relative motion at the shared MRF, less what force control asks for, has a heavy cost in the
programme. An equality would have no solution where joints may not move and force control asks for
relative motion.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..compiled import ARRAY3, INDEX, MATRIX, NUMBER, VECTOR, compiled, inner_kernel
from ..scene import Index
from ..spatial import Array

PULL_APART = 1e6
"""Cost of relative motion of tools on one payload, per (m/s)²."""

AGREED = 1e-6
"""Tools whose relative motion is below this keep together [m/s]."""


class PayloadLink(NamedTuple):
    """Tools on one payload."""

    tools: Index
    """Which of all (k,)."""
    give_way: Array
    """The twist (k, 6) of the MRF that force control asks each one for beside the common one."""


def least_of(groups: Sequence[Index], values: list[float]) -> list[float]:
    """Return values, one for each tool, with the least of each group's for all of them.

    Groups are of tools on one payload, or of arms that share joints.
    """
    if not groups:
        return values
    found = list(values)
    for group in groups:
        least = min(values[t] for t in group)
        for t in group:
            found[t] = least
    return found


def in_step(
    dq: Array,
    counts: Sequence[int],
    done: Sequence[float],
    shares: list[float],
    groups: Sequence[Index],
    links: Sequence[PayloadLink],
) -> tuple[Array, list[float], list[PayloadLink]]:
    """Return rates dq (n,) of which the arms of a group are slowed as the slowest of them.

    Each has so many joints as `counts` tells, was slowed to a share `done` of what was asked, and
    is to be to one of `shares`. And the shares, and links that ask for so much less.
    """
    least = least_of(groups, shares)
    slower = [new / max(old, 1e-12) for new, old in zip(least, done, strict=True)]
    found = [link._replace(give_way=least[link.tools[0]] * link.give_way) for link in links]
    return np.repeat(slower, counts) * dq, least, found


def pulled_apart(J: Array, dq: Array, length: float, links: Sequence[PayloadLink]) -> bool:
    """Return whether rates dq (n,) pull a payload apart, as where one arm is singular.

    J (t, 6, n) are the tools' Jacobians.
    """
    return any(apart(J, link.tools, link.give_way, dq, length) > AGREED for link in links)


@inner_kernel
def _rows(J: Array, tools: Index, give_way: Array, length: float) -> tuple[Array, Array]:
    """Return A (6k, n) and b (6k,): A dq − b is how the tools' motions differ from their mean.

    Less what force control asks for; rotations weighed by `length` [m/rad]. J (t, 6, n) are the
    Jacobians of all tools.
    """
    k, n = len(tools), J.shape[2]
    A, b = np.zeros((6 * k, n)), np.zeros(6 * k)
    for r in range(6):
        weight = 1.0 if r < 3 else length
        mean = 0.0
        for m in range(k):
            mean += give_way[m, r] / k
        for m in range(k):
            b[6 * m + r] = weight * (give_way[m, r] - mean)
            for j in range(n):
                for other in range(k):
                    part = (1.0 if other == m else 0.0) - 1.0 / k
                    A[6 * m + r, j] += weight * part * J[tools[other], r, j]
    return A, b


@compiled(ARRAY3, INDEX, MATRIX, VECTOR, NUMBER)
def apart(J: Array, tools: Index, give_way: Array, dq: Array, length: float) -> float:
    """Return the greatest relative rate of tools on one payload at rates dq (n,) [m/s]."""
    A, b = _rows(J, tools, give_way, length)
    most = 0.0
    for i in range(len(b)):
        rate = -b[i]
        for j in range(len(dq)):
            rate += A[i, j] * dq[j]
        most = max(most, abs(rate))
    return most


@compiled(MATRIX, VECTOR, ARRAY3, INDEX, MATRIX, NUMBER)
def keep(
    H: Array, f: Array, J: Array, tools: Index, give_way: Array, length: float
) -> tuple[Array, Array]:
    """Return a programme's H and f with the cost of pulling a payload apart, and one share.

    Its unknowns are the joint rates (n,), then one share for each tool; the first of `tools` (k,)
    keeps theirs, those of the others are idle.
    """
    n, H, f = J.shape[2], H.copy(), f.copy()
    A, b = _rows(J, tools, give_way, length)
    for i in range(len(b)):
        for j in range(n):
            weighed = PULL_APART * A[i, j]
            if weighed == 0.0:
                continue
            f[j] -= weighed * b[i]
            for other in range(n):
                H[j, other] += weighed * A[i, other]
    first = n + tools[0]
    for m in range(1, len(tools)):
        own = n + tools[m]
        H[first, first] += H[own, own]
        f[first] += f[own]
        for j in range(n):
            H[first, j] += H[own, j]
            H[j, first] += H[j, own]
            H[own, j] = H[j, own] = 0.0
        H[own, own], f[own] = 1.0, -1.0
    return H, f
