from itertools import pairwise

import pytest
from telerobot.server.loop import next_deadline

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
