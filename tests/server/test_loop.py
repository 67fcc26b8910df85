from itertools import pairwise

import pytest
from telerobot.server.clock import VirtualClock
from telerobot.server.loop import next_deadline, run
from telerobot.server.mode import Mode

T = 0.01


def test_in_time_deadlines_follow_each_other_by_exactly_a_period():
    assert next_deadline(1.0, 1.002, T) == (1.0 + T, 0)


@pytest.mark.parametrize(
    ("late", "periods", "skipped"),
    [
        (0.0, 1, 0),  # the next one is due this very moment
        (0.4, 1, 0),  # just gone by: kept, a little late
        (0.6, 2, 1),
        (1.4, 2, 1),
        (1.6, 3, 2),
        (99.4, 100, 99),
    ],
)
def test_a_deadline_long_gone_by_is_skipped_and_counted(late, periods, skipped):
    deadline, count = next_deadline(1.0, 1.0 + (1 + late) * T, T)
    assert deadline == pytest.approx(1.0 + periods * T, abs=1e-12)
    assert count == skipped


def test_after_a_stall_no_tick_follows_another_in_less_than_half_a_period(rng):
    """Never a burst, and every deadline is either served or counted."""
    deadline = start = 1.0
    served, skipped, ticks = 0, 0, []
    now = deadline
    for _ in range(2000):
        now = max(now, deadline)
        ticks.append(now)
        work = rng.choice([0.2, 0.9, 1.3, 7.7], p=[0.9, 0.06, 0.03, 0.01]) * T
        now += work
        served += 1
        deadline, more = next_deadline(deadline, now, T)
        skipped += more
    gaps = [b - a for a, b in pairwise(ticks)]
    assert min(gaps) >= 0.5 * T - 1e-9
    assert skipped > 0
    assert round((deadline - start) / T) == served + skipped


class _Clock(VirtualClock):
    """Virtual time that a sleep moves on."""

    def sleep_until(self, deadline_s):
        self.time_s = max(self.time_s, deadline_s)


class _Plant:
    """Drives that answer at once."""

    def answered(self):
        return True


class _Stalling:
    """A cycle whose third tick takes almost five periods, on a clock that it moves."""

    mode, output, compute_s = Mode.READY, None, 0.0

    def __init__(self, clock):
        self.plant, self.clock, self.tick, self.told = _Plant(), clock, 0, []

    def begin(self):
        self.tick += 1

    def finish(self):
        self.clock.time_s += 0.047 if self.tick == 3 else 0.001

    def missed(self, periods):
        self.told.append(periods)


def test_the_cycle_is_told_how_many_deadlines_a_stall_has_cost():
    clock = _Clock()
    cycle = _Stalling(clock)
    statistics = run(cycle, clock, 0.01, lambda cycle: cycle.tick < 5)
    assert cycle.told == [0, 0, 4, 0, 0]
    assert (statistics.ticks, statistics.skipped) == (5, 4)
