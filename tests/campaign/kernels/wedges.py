"""Part `wedges`: random barriers that standing satisfies always get a feasible answer.

Parallel, opposed, nearly dependent, or just many of them, 2 to 60 for 6 to 8 joints; a thousand
for each seed.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from laboratory.oracle.poses import Array
from telerobot.server.control.barriers.programme import nearest
from telerobot.tools.soak.segments import Draw

from ..part import Part

COUNT = 1000
"""Wedges of one seed [1]."""
KEPT = 1e-9
"""No barrier may be broken by more [m/s]."""
LENGTH = 0.3
"""Characteristic length [m]."""


class Wedge(NamedTuple):
    """The arguments of one programme."""

    dq: Array
    J: Array
    low: Array
    high: Array
    velocity: Array
    A: Array
    b: Array


def wedge(rng: Draw, led_back: bool = False) -> Wedge:
    """Draw 2 to 60 barriers for 6 to 8 joints; with `led_back`, 0 is outside of some bounds."""
    n = int(rng.integers(6, 9))
    velocity = rng.uniform(0.5, 3.0, n)
    low, high = -velocity * rng.uniform(0, 1, n), velocity * rng.uniform(0, 1, n)
    if led_back:
        low[0] = rng.uniform(0.0, high[0])
    J = 0.5 * rng.normal(size=(6, n))
    if rng.random() < 0.2:
        J[5] = (1.0 + 1e-9) * J[4]
    A = _slopes(rng, int(rng.integers(2, 61)), n)
    return Wedge(rng.uniform(-velocity, velocity), J, low, high, velocity, A, _least(rng, len(A)))


def _slopes(rng: Draw, m: int, n: int) -> Array:
    A = rng.uniform(0.05, 1.0) * rng.normal(size=(m, n))
    aside = 10.0 ** rng.uniform(-16, -3)
    match rng.integers(6):
        case 0:  # parallel
            A[:] = A[0] * rng.uniform(0.01, 3.0, (m, 1))
        case 1:  # opposed
            A[1::2] = -A[0::2][: m // 2]
        case 2:  # opposed but for a little
            A[1::2] = -A[0::2][: m // 2] + aside * rng.normal(size=(m // 2, n))
        case 3:  # nearly dependent
            rank = int(rng.integers(1, n))
            A = rng.normal(size=(m, rank)) @ rng.normal(size=(rank, n))
            A += aside * rng.normal(size=(m, n))
        case 4:  # few directions to and fro
            which = rng.integers(0, min(m, 3), m)
            A = A[which] * rng.choice([-1.0, 1.0], (m, 1)) * rng.uniform(0.1, 3.0, (m, 1))
            A += aside * rng.normal(size=(m, n))
    return A


def _least(rng: Draw, m: int) -> Array:
    match rng.integers(4):
        case 0:
            b = np.zeros(m)
        case 1:
            b = -rng.uniform(0, 0.3, m)
        case 2:
            b = -(10.0 ** rng.uniform(-12, -1, m))
        case _:
            b = np.where(rng.random(m) < 0.5, 0.0, -rng.uniform(0, 0.1, m))
    if rng.random() < 0.3:  # some gaps are to be widened
        b = np.where(rng.random(m) < 0.3, rng.uniform(0, 0.02, m), b)
    return b


@dataclass(frozen=True)
class Answers:
    """Result of the programme in the wedges of one seed."""

    seed: int
    worst: float
    """By which an answer broke a barrier, or a bound of the joints [m/s, rad/s]."""
    fallbacks: dict[str, int]
    """Failures of the solver, by fallback."""
    reasons: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        """The seed."""
        return f"wedges of seed {self.seed}"


@dataclass(frozen=True)
class Answered:
    """Summary of all seeds."""

    answers: Sequence[Answers]

    @property
    def kept(self) -> bool:
        """True when every wedge had an answer that keeps it."""
        return not any(a.reasons for a in self.answers)

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        total: Counter[str] = Counter()
        for a in self.answers:
            total.update(a.fallbacks)
        return {
            "wedges": COUNT * len(self.answers),
            "broken_by": max((a.worst for a in self.answers), default=0.0),
            "fallbacks": dict(sorted(total.items())),
            "failing": [reason for a in self.answers for reason in a.reasons],
        }

    def lines(self) -> list[str]:
        """Return the report."""
        f = self.figures()
        return [
            f"{f['wedges']} wedges, barriers broken by {f['broken_by']:.1e} at most",
            f"where the solver failed: {f['fallbacks']}",
            *(reason for a in self.answers for reason in a.reasons),
        ]


def solve(w: Wedge) -> tuple[float, str]:
    """Return by how much the answer breaks the worst bound [m/s, rad/s], and the fallback."""
    found = nearest(w.dq, w.J, w.low, w.high, w.velocity, LENGTH, (w.A, w.b))
    short = np.minimum(w.b, 0.0) - w.A @ found.dq
    out = np.maximum(w.low - found.dq, found.dq - w.high)
    return max(float(short.max()), float(out.max()), 0.0), found.fallback


def play(seed: int) -> Answers:
    """Solve the wedges of one seed."""
    rng = np.random.default_rng(seed)
    fallbacks: Counter[str] = Counter()
    worst, reasons = 0.0, []
    for i in range(COUNT):
        drawn = wedge(rng)
        try:
            broken, fallback = solve(drawn)
        except Exception as error:  # noqa: BLE001  whatever is raised stops an arm: it is counted
            reasons.append(f"seed {seed}, wedge {i}: {type(error).__name__}: {error}")
            continue
        worst = max(worst, broken)
        if fallback:
            fallbacks[fallback] += 1
        if not broken <= KEPT:
            reasons.append(f"seed {seed}, wedge {i}: broken by {broken:.2e}")
    return Answers(seed, worst, dict(fallbacks), reasons)


WEDGES = Part(lambda selection: list(selection.seeds), play, Answered)
