"""The nearest joint rates that keep every barrier: a small quadratic programme (DAQP).

Self-motion is spent first, then the tool slows along its path, and only then does it leave the
path: the unknowns are the joint rates and the share s of the asked tool motion, and leaving the
path (J dq ≠ s ẋ) costs far more than going slower (s < 1), which costs far more than self-motion.
An arm that only slowed would creep to a stop beside whatever stands across its path. So s does not
fall below `SLIDE`: what is still too much then is taken off sideways, and since the least of it
is, it is what approaches that goes. The rest slides on, along the barrier; where nothing is left
of the motion but what approaches, the arm stands.

Slowing keeps a tool on its path while a gap may still close. Where it may not, a slower tool leaves
the path by as much on the same way, and only takes longer. So of a gap that may close at the part ρ
of what it is asked to, s is not below 1 − ρ either: a tool that comes to a barrier slows, and is
back at what was asked for once it slides. How fast a gap is to be widened counts as left, too: what
mends it may take the time that this needs.

Barriers are hard, where standing keeps them all; where a joint is to be led back into its limits,
those of the joint rates are, and the others as well as can be. That a gap is widened has a price:
as well as it can be, and never by closing another faster than the room of that one allows.

The solver is not trusted. Opposed or nearly dependent barriers make it find no solution where
standing is one, or one that breaks barriers by its tolerance. So what it finds is looked at; if it
fails, it is asked once more with soft barriers; and then the nearest rates are taken that keep
every barrier to rounding (`least_distance.py`). What is left in the end is to stand, or to do no
more than leads joints back.
"""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import daqp
import numpy as np
from numpy.typing import NDArray

from ..compiled import ARRAY3, INDEX, MATRIX, NUMBER, VECTOR, compiled, inner_kernel
from ..scene import Index
from ..spatial import Array
from ..wheels import DrivenWheels
from .least_distance import KEPT, settled, violation
from .together import PayloadLink, keep

LEAVE_PATH = 1000.0
"""Cost of tool motion off the path, per (m/s)²."""
SLOW_DOWN = 3.0
"""Cost of going slower than asked, per (m/s)²."""
SLIDE = 0.5
"""Slowed to this share of what is asked, the tool goes no slower but leaves the path [1]; to more
where less of its approach is left."""
ATTITUDE = 3.0
"""Rotations count so much more here than in the resolution of tool rates: a tool that is pushed at
something is not to tilt for the little way that this gains it [1]."""
SELF_MOTION = 0.05
"""Cost of joint rates other than asked, per part of V squared."""

WIDEN = 1e4
"""Cost of not widening a gap as told, per (m/s)²; it is never worth closing one without room."""
WIDEN_BESIDE = 10.0
"""The same where the tool is to stay: self-motion is worth it, leaving the place is not."""
UNBOUNDED = 1e30
UNASKED = 1e-9
"""A tool motion below this is none [m/s]."""

_SOFT = 8
"""DAQP's sign of a soft constraint."""
_SOLVED = (1, 2)
"""DAQP's signs of an optimum, of hard and of soft constraints."""


_BY_TOLERANCE = 2e-6
"""Barriers of unit slope are broken by less than this where the solver did its work [m/s]."""
_SLOWED = 0.999
"""Rates that keep this share were not slowed but for rounding [1]."""

Fallback = Literal["", "barriers_softened", "barriers_slow", "barriers_stand"]
"""Ways out where the solver failed: none needed; barriers were soft to it, and then kept by the
nearest rates that do; those were slowed towards standing; the arm stands, or just leads back."""


class NearestRates(NamedTuple):
    """Joint rates inside all bounds."""

    dq: Array
    share: Array
    """Size of each tool's motion that is left, on the path or sliding, as a share of the asked one
    (t,), 0 to 1."""
    pace: Array
    """Share of its asked speed at which each path itself may go on (t,): that of the motion whose
    projection this is, `SLIDE` at least."""
    fallback: Fallback = ""
    """The way out that was taken where the solver failed."""


class BarrierError(Exception):
    """Something to be resolved is not a finite number: carries what."""


def nearest(
    dq: Array,
    J: Array,
    low: Array,
    high: Array,
    velocity: Array,
    characteristic_length: float,
    rows: tuple[Array, Array] | None = None,
    tool: Index | None = None,
    links: Sequence[PayloadLink] = (),
    wheels: Sequence[int] = (),
    widen: Sequence[float] | None = None,
    kept: Array | None = None,
) -> NearestRates:
    """Return the rates nearest to dq (n,) with low ≤ dq ≤ high (n,) [rad/s].

    `tool` (n,) tells whose own each joint is, of t tools, all the same one's if None. J (t, 6, n)
    are the tools' Jacobians, or (6, n) where no joint moves another tool than its own: then each
    column is that tool's. `velocity` (n,) are the joint speed bounds; `rows` are
    A (m, n) and b (m,) of further barriers A dq ≥ b. Those of which less is `kept` (m,), 0 at most
    and min(b, 0) if None, are to be widened, at the cost `widen` of each tool (t,). `links` are
    tools on one payload. Of driven `wheels`, by the places of the left ones, each pair keeps its
    proportion. There always are such rates; raises `BarrierError` where an argument is not finite.
    """
    n = len(dq)
    tool = np.zeros(n, dtype=np.int64) if tool is None else tool
    J = J if J.ndim == 3 else of_tools(J, tool)
    slopes, least = rows if rows is not None else (np.zeros((0, n)), np.zeros(0))
    if wheels:
        led = DrivenWheels.of(dq, low, high, wheels)
        found_led = nearest(
            led.asked, J @ led.whole, led.low, led.high, velocity[led.kept], characteristic_length,
            (slopes @ led.whole, least), tool[led.kept], links, (), widen, kept,
        )  # fmt: skip
        return found_led._replace(dq=led.whole @ found_led.dq)
    length = ATTITUDE * characteristic_length
    costs = np.full(tool.max() + 1, WIDEN) if widen is None else np.array(widen)
    hard = np.minimum(least, 0.0) if kept is None else kept
    H, f, A, upper, lower, sense = _programme(
        dq, J, tool, low, high, velocity, slopes, least, hard, costs, length
    )
    for link in links:
        H, f = keep(H, f, J, link.tools, link.give_way, length)
        lower[n + link.tools] = SLIDE  # their one share is no single arm's to hurry
    found, _, flag, _ = daqp.solve(H, f, A, upper, lower, sense)
    wrong = violation(slopes, hard, found[:n])
    if math.isnan(found.sum()) or math.isnan(low.sum() - high.sum()):  # no bound to the solver
        wrong = math.inf
    fallback: Fallback = ""
    if flag not in _SOLVED or wrong > KEPT:
        led_back = bool((low > 0.0).any() or (high < 0.0).any())
        if not led_back or flag not in _SOLVED or wrong == math.inf:
            _check_finite(dq=dq, J=J, low=low, high=high, slopes=slopes, least=least)
            if flag not in _SOLVED or wrong > _BY_TOLERANCE:
                fallback = "barriers_softened"
                sense[len(f) : len(f) + len(least)] = _SOFT
                found, _, flag, _ = daqp.solve(H, f, A, upper, lower, sense)
            if flag not in _SOLVED or not np.isfinite(found).all():
                found[:n], found[n:] = np.clip(0.0, low, high), SLIDE
                fallback = "barriers_stand"
            elif not led_back:
                found[:n], share = settled(found[:n], slopes, hard, low, high, H[:n, :n])
                if share < _SLOWED:
                    fallback = "barriers_slow"
    for link in links:
        found[n + link.tools] = found[n + link.tools[0]]
    return NearestRates(*_granted(found, dq, J, low, high, length), fallback)


def of_tools(J: Array, tool: Index) -> Array:
    """Return the Jacobians (t, 6, n) of tools, given those (6, n) of each joint's own `tool`."""
    found = np.zeros((int(tool.max()) + 1, 6, len(tool)))
    found[tool, :, np.arange(len(tool))] = J.T
    return found


def _check_finite(**arguments: Array) -> None:
    for name, values in arguments.items():
        if not np.isfinite(values).all():
            raise BarrierError(f"{name} is not finite: {values}")


@compiled(VECTOR, ARRAY3, INDEX, VECTOR, VECTOR, VECTOR, MATRIX, VECTOR, VECTOR, VECTOR, NUMBER)
def _programme(
    dq: Array, J: Array, tool: Index, low: Array, high: Array, velocity: Array, slopes: Array,
    least: Array, kept: Array, costs: Array, length: float,
) -> tuple[Array, Array, Array, Array, Array, NDArray[np.int32]]:  # fmt: skip
    """Return H, f, A and the bounds above and below of the unknowns, then of the rows of A.

    And DAQP's sense of each bound: barriers are soft where a joint is to be led back.

    ‖J dq' − s ẋ‖² and ‖(dq' − s dq)/V‖² of every tool, in the unknowns (dq', s), with one s for
    each tool, and one more for each gap that is to be widened: what it falls short by, at the
    least of the `costs` (t,) of tools that it concerns. `length` weighs rotations [m/rad].
    """
    n, m, tools = len(dq), len(least), tool.max() + 1
    widened, wide = np.empty(m, dtype=np.int64), 0
    for i in range(m):
        if least[i] > kept[i]:
            widened[wide] = i
            wide += 1
    slack = n + tools
    size, count = slack + wide, m + wide
    H, f, A = np.zeros((size, size)), np.zeros(size), np.zeros((count, size))
    x = np.zeros((tools, 6))
    for t in range(tools):
        for r in range(6):
            for j in range(n):
                x[t, r] += J[t, r, j] * dq[j]
    slow, asked = np.full(tools, 1e-9), np.zeros(tools)
    for j in range(n):
        own = SELF_MOTION / velocity[j] ** 2
        H[j, j] = own
        slow[tool[j]] += own * dq[j] ** 2
        asked[tool[j]] += own * dq[j] ** 2
        for t in range(tools):
            cross = own * dq[j] if t == tool[j] else 0.0
            for r in range(6):
                weighed = LEAVE_PATH * J[t, r, j] * (1.0 if r < 3 else length**2)
                if weighed == 0.0:
                    continue
                cross += weighed * x[t, r]
                for k in range(n):
                    H[j, k] += weighed * J[t, r, k]
            if cross != 0.0:
                H[j, n + t] = H[n + t, j] = -cross
    for t in range(tools):
        for r in range(6):
            x2 = x[t, r] ** 2 * (1.0 if r < 3 else length**2)
            slow[t] += SLOW_DOWN * x2
            asked[t] += LEAVE_PATH * x2
        H[n + t, n + t] = asked[t] + slow[t]
        f[n + t] = -slow[t]
    upper, lower = np.empty(size + count), np.zeros(size + count)
    for i in range(size + count):
        upper[i] = UNBOUNDED
    for j in range(n):
        lower[j], upper[j] = low[j], high[j]
    for t in range(tools):
        lower[n + t], upper[n + t] = SLIDE, 1.0
    for i in range(m):
        lower[size + i], rate = kept[i], 0.0
        for j in range(n):
            A[i, j] = slopes[i, j]
            rate += slopes[i, j] * dq[j]
        if rate < kept[i]:
            least_share = 1.0 - (2.0 * kept[i] - least[i]) / rate
            for j in range(n):
                if slopes[i, j] != 0.0:
                    lower[n + tool[j]] = max(lower[n + tool[j]], least_share)
    for i in range(wide):
        gap = widened[i]
        cost = np.inf
        for j in range(n):
            A[m + i, j] = slopes[gap, j]
            if slopes[gap, j] != 0.0:
                cost = min(cost, costs[tool[j]])
        H[slack + i, slack + i] = cost if cost < np.inf else costs[0]
        A[m + i, slack + i] = 1.0
        lower[size + m + i] = least[gap]
    sense, led_back = np.zeros(size + count, dtype=np.int32), False
    for j in range(n):
        led_back = led_back or low[j] > 0.0 or high[j] < 0.0
    if led_back:
        for i in range(m):
            sense[size + i] = _SOFT
    return H, f, A, upper, lower, sense


@inner_kernel
def _weighed(J: Array, dq: Array, t: int, length: float) -> float:
    """Return the size of one tool's motion, rotations weighed by `length` [m/rad]."""
    size2 = 0.0
    for r in range(6):
        rate = 0.0
        for j in range(len(dq)):
            rate += J[t, r, j] * dq[j]
        size2 += rate**2 * (1.0 if r < 3 else length**2)
    return math.sqrt(size2)


@compiled(VECTOR, VECTOR, ARRAY3, VECTOR, VECTOR, NUMBER)
def _granted(
    solution: Array, dq: Array, J: Array, low: Array, high: Array, length: float
) -> tuple[Array, Array, Array]:
    """Return what `NearestRates` holds, by the unknowns that solve the programme."""
    n, tools = len(dq), len(J)
    found, share, pace = np.empty(n), np.empty(tools), np.empty(tools)
    for j in range(n):
        found[j] = min(max(solution[j], low[j]), high[j])
    for t in range(tools):
        pace[t] = share[t] = solution[n + t]
        asked, left = _weighed(J, dq, t, length), _weighed(J, found, t, length)
        if asked >= UNASKED:
            share[t] = min(pace[t], left / asked)
    return found, share, pace
