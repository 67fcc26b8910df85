from itertools import pairwise

import pytest
from telerobot.server.cycle import Cycle
from telerobot.server.loop import next_deadline, run
from telerobot.server.mode import Mode
from telerobot.server.process import VirtualClock

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

    mode, following_error, compute_s = Mode.READY, None, 0.0
    pressed = False

    def __init__(self, clock):
        self.plant, self.clock, self.tick, self.told = _Plant(), clock, 0, []

    def gather(self):
        self.plant.answered()

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


class _Bus:
    """A plant of one drive whose answer to the third SYNC takes almost a period, others 1 ms."""

    def __init__(self, clock):
        self._clock, self._syncs, self._underway, self.buses = clock, 0, [], self
        self.newest, self.fresh = None, False

    def sync(self):
        self._syncs += 1
        delay_s = 0.0085 if self._syncs == 3 else 0.001
        self._underway.append((self._clock.time_s + delay_s, self._syncs))
        self.fresh = False

    def receive(self, now_s):
        for arrival in [a for a in self._underway if a[0] <= now_s]:
            self._underway.remove(arrival)
            self.newest, self.fresh = arrival[1], True

    def answered(self):
        self.receive(self._clock.time_s)
        return self.fresh

    def wait(self, timeout_s):
        self._clock.time_s += min(timeout_s, 1e-4)


class _Listening(_Stalling):
    """A cycle that notes which SYNC its samples are of."""

    gather = Cycle.gather

    def __init__(self, clock):
        super().__init__(clock)
        self.plant, self.used = _Bus(clock), []

    def begin(self):
        super().begin()
        self.plant.buses.sync()

    def finish(self):
        self.used.append(self.plant.newest)


def test_an_answer_that_comes_late_once_does_not_make_all_samples_a_period_old():
    clock = _Clock()
    cycle = _Listening(clock)
    run(cycle, clock, 0.01, lambda cycle: cycle.tick < 8)
    assert cycle.used == [1, 2, 2, 4, 5, 6, 7, 8]


class _Pressed(_Stalling):
    """A cycle under a flood from its second tick to its fourth, that notes when it may listen."""

    def __init__(self, clock):
        super().__init__(clock)
        self.heard = []

    @property
    def pressed(self):
        return 2 <= self.tick < 5

    def finish(self):
        self.clock.time_s += 0.001

    def listen(self):
        self.heard.append(round(self.clock.time_s, 4))


def test_under_a_flood_the_network_is_listened_to_between_two_ticks():
    clock = _Clock()
    cycle = _Pressed(clock)
    run(cycle, clock, 0.01, lambda cycle: cycle.tick < 7)
    assert cycle.heard == [0.025, 0.035, 0.045]
    assert cycle.told == [0] * 7


class _Answering(_Stalling):
    """Seven drives answer each SYNC one after the other, the last `late_s` after it, in random."""

    def __init__(self, clock, rng, ticks):
        super().__init__(clock)
        self.plant, self.buses = self, self
        self._rng, self._ticks, self.looks = rng, ticks, []
        self.unanswered = range(0)
        """Ticks whose last answer never comes."""

    def gather(self):
        pass

    def begin(self):
        self.tick += 1
        self.looks.append(0)
        last = self.clock.time_s + self._rng.uniform(0.8e-3, 1.2e-3)
        self._come = [last - 1e-4 * i for i in range(7)]
        if self.tick in self.unanswered:
            self._come[0] = float("inf")

    def answered(self):
        self.looks[-1] += 1
        return all(at <= self.clock.time_s for at in self._come)

    def wait(self, timeout_s):
        left = [at - self.clock.time_s for at in self._come if at > self.clock.time_s]
        self.clock.time_s += min(timeout_s, *left)

    def finish(self):
        self.finished_s = self.clock.time_s

    def missed(self, _periods):
        pass


def test_the_loop_wakes_once_for_all_answers_and_no_later_than_needed(rng):
    clock = _Clock()
    cycle = _Answering(clock, rng, 2000)
    statistics = run(cycle, clock, T, lambda c: c.tick < 2000)
    assert sum(cycle.looks[:5]) > 30  # not learnt yet: woken for each
    settled = cycle.looks[1000:]
    assert 0.85 < settled.count(1) / len(settled) < 0.95
    assert max(list(statistics.busy)[1000:]) < 1.25e-3


def test_answers_that_stay_away_teach_the_loop_nothing(rng):
    clock = _Clock()
    cycle = _Answering(clock, rng, 2000)
    cycle.unanswered = range(1000, 1500)
    statistics = run(cycle, clock, T, lambda c: c.tick < 1510)
    busy = list(statistics.busy)
    assert min(busy[1000:1490]) == pytest.approx(0.3 * T, abs=1e-5)  # given up in time
    assert max(busy[1500:]) < 1.25e-3


@pytest.mark.parametrize(("period_s", "before_s"), [(0.01, 1e-3), (0.001, 2e-4)])
def test_the_bus_is_emptied_just_before_each_sync(period_s, before_s):
    clock = _Clock()
    cycle = _Stalling(clock)
    gathered, begun = [], []
    cycle.gather = lambda: gathered.append(clock.time_s)
    cycle.begin = lambda: begun.append(clock.time_s)
    cycle.finish = lambda: setattr(cycle, "tick", cycle.tick + 1)
    run(cycle, clock, period_s, lambda c: c.tick < 5)
    apart = [b - a for a, b in zip(gathered, begun, strict=True)]
    assert apart == pytest.approx([before_s] * 5)
