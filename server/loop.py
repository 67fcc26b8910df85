"""The loop on absolute deadlines: late ticks are skipped and counted, never made up in a burst."""

import gc
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .cycle import Cycle
from .mode import Mode
from .process import MonotonicClock

COLLECT_PART = 0.3
"""Part of a period in which the drives' answers are waited for [1]."""

ALL_THERE = 0.9
"""Part of all ticks that find every answer there when the loop wakes for them [1]."""

STEP_S = 2e-5
"""Step by which the instant to wake at follows when answers come [s]."""

GATHER_S, GATHER_PART = 1e-3, 0.2
"""So long before a deadline the bus is emptied [s], at most this part of a period [1].

It must not make SYNC late: with 0.4 ms one SYNC in a hundred was, on a quiet machine."""

LISTEN_PART = 0.5
"""Under a flood, messages are sorted once more, so long before a deadline [periods]."""

SKIP_PART = 0.5
"""A tick later than this part of a period is skipped, not squeezed in [1]."""

TIDY_EVERY = 100
"""Ticks between two quick garbage collections, in a period's slack [1]."""

TIDY_AT = 2
"""They come in the second tick after one of these: states and descriptions go before [1]."""

KEPT = 100_000
"""Ticks whose timing is kept, the newest: a daemon runs for months [1]."""


def _newest() -> deque[float]:
    return deque(maxlen=KEPT)


@dataclass
class LoopStatistics:
    """Timing of a run of the loop, in seconds, over the newest ticks."""

    ticks: int = 0
    skipped: int = 0
    lateness: deque[float] = field(default_factory=_newest)
    """How late each SYNC was sent after its deadline."""
    compute: deque[float] = field(default_factory=_newest)
    """The control computation of each tick."""
    busy: deque[float] = field(default_factory=_newest)
    """From each deadline to the end of the work."""
    worst_error: float = 0.0
    """Largest following error of any joint while drives were on [rad]."""

    def figures(self) -> dict[str, float]:
        """Return counts, and percentiles in microseconds."""
        figures: dict[str, float] = {
            "ticks": self.ticks,
            "overruns": self.skipped,
            "worst_following_error_rad": self.worst_error,
        }
        for name in ("lateness", "compute", "busy"):
            values = 1e6 * np.array([*getattr(self, name)] or [0.0])
            for label, part in (("p50", 50), ("p99", 99), ("p99.9", 99.9), ("max", 100)):
                figures[f"{name}_us_{label}"] = round(float(np.percentile(values, part)), 1)
        return figures

    def line(self) -> str:
        """Return one line for people."""
        f = self.figures()
        return (
            f"{self.ticks} ticks, {self.skipped} overruns, SYNC late p50 "
            f"{f['lateness_us_p50']:.0f} µs, p99 {f['lateness_us_p99']:.0f} µs, max "
            f"{f['lateness_us_max']:.0f} µs, control p50 {f['compute_us_p50']:.0f} µs, p99 "
            f"{f['compute_us_p99']:.0f} µs, worst tracking error "
            f"{1e3 * self.worst_error:.2f} mrad"
        )


def run(
    cycle: Cycle, clock: MonotonicClock, period_s: float, go_on: Callable[[Cycle], bool]
) -> LoopStatistics:
    """Run cycles until `go_on` says no; return what it was like."""
    statistics = LoopStatistics()
    gather_s = min(GATHER_S, GATHER_PART * period_s)
    deadline, usual_s = clock.now() + period_s, 0.0
    while go_on(cycle):
        if cycle.pressed:
            clock.sleep_until(deadline - LISTEN_PART * period_s)
            cycle.listen()
        clock.sleep_until(deadline - gather_s)
        cycle.gather()
        clock.sleep_until(deadline)
        late = clock.now() - deadline
        cycle.begin()
        usual_s = _collect(cycle, clock, deadline + late, usual_s, COLLECT_PART * period_s)
        cycle.finish()
        end = clock.now()
        _note(statistics, cycle, late, end - deadline)
        if cycle.tick % TIDY_EVERY == TIDY_AT:
            gc.collect(2 if cycle.mode in (Mode.BOOT, Mode.READY) else 0)
        deadline, skipped = next_deadline(deadline, clock.now(), period_s)
        statistics.skipped += skipped
        cycle.missed(skipped)
    return statistics


def next_deadline(deadline_s: float, now_s: float, period_s: float) -> tuple[float, int]:
    """Return the next deadline that can still be kept, and how many were passed over.

    One that has just gone by is kept, a little late; one that is half a period gone is skipped.
    """
    following = deadline_s + period_s
    late = now_s - following
    if late <= SKIP_PART * period_s:
        return following, 0
    skipped = int(late / period_s - SKIP_PART) + 1
    return following + skipped * period_s, skipped


def _collect(
    cycle: Cycle, clock: MonotonicClock, sent_s: float, usual_s: float, most_s: float
) -> float:
    """Take in the drives' answers to the SYNC of `sent_s`, until all are there or time is up.

    The loop wakes `usual_s` after it for all of them: to wake for each costs more than to take it
    in. Returns when to wake for the next ones, at most `most_s` [s]: a little sooner where all were
    there, else later, which finds the quantile `ALL_THERE` (Robbins and Monro, 1951).
    """
    clock.sleep_until(sent_s + usual_s)
    waited = False
    while not cycle.plant.answered():
        left = sent_s + most_s - clock.now()
        if left <= 0.0:
            return usual_s
        cycle.plant.buses.wait(left)
        waited = True
    step_s = ALL_THERE * STEP_S if waited else (ALL_THERE - 1.0) * STEP_S
    return min(max(usual_s + step_s, 0.0), most_s)


def _note(statistics: LoopStatistics, cycle: Cycle, late: float, busy: float) -> None:
    statistics.ticks += 1
    statistics.lateness.append(late)
    statistics.busy.append(busy)
    statistics.compute.append(cycle.compute_s)
    error = cycle.following_error
    if cycle.mode.energised and error is not None:
        statistics.worst_error = max(statistics.worst_error, float(abs(error).max()))
