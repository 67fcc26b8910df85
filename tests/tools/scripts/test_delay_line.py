import pytest
from telerobot.tools.scripts.player import DelayLine
from telerobot.tools.scripts.script import LinkConditions


class Ride:
    """A line and what has come out of it, by the millisecond."""

    def __init__(self, seed=1, **conditions):
        self.line = DelayLine(seed, LinkConditions(**conditions))
        self.ms = 0
        self.out = []

    def send(self, count, stream, every_ms=10):
        for i in range(count):
            self.line.carry(lambda i=i: self.out.append((i, self.ms)), self.ms / 1000, stream)
            self.wait(every_ms)
        return self

    def wait(self, ms):
        for _ in range(ms):
            self.ms += 1
            self.line.run(self.ms / 1000)
        return self

    @property
    def numbers(self):
        return [i for i, _ in self.out]

    @property
    def delays_ms(self):
        return [ms - 10 * i for i, ms in self.out]


@pytest.mark.parametrize("stream", ["state", None])
def test_an_empty_line_without_delay_delivers_at_once(stream):
    assert Ride().send(3, stream).delays_ms == [0, 0, 0]


@pytest.mark.parametrize("stream", ["state", None])
def test_everything_is_late_by_the_delay(stream):
    ride = Ride(delay_s=0.05).send(20, stream).wait(100)
    assert ride.numbers == list(range(20))
    assert set(ride.delays_ms) == {50}


def test_jitter_varies_the_delay_to_either_side_and_no_more():
    ride = Ride(delay_s=0.1, jitter=0.2).send(500, "state", every_ms=50).wait(200)
    delays = [ms - 50 * i for i, ms in ride.out]
    assert len(delays) == 500
    assert 80 <= min(delays) < 85
    assert 115 < max(delays) <= 121


def test_of_a_stream_the_newest_wins_and_what_it_overtook_is_gone():
    ride = Ride(delay_s=0.1, jitter=0.5).send(500, "state").wait(200)
    assert ride.numbers == sorted(set(ride.numbers))
    assert 100 < len(ride.numbers) < 450


def test_streams_overtake_only_themselves():
    line = DelayLine(1, LinkConditions(delay_s=0.1))
    out = []
    line.carry(lambda: out.append("a"), 0.0, "one")
    line.set(LinkConditions(delay_s=0.01))
    line.carry(lambda: out.append("b"), 0.0, "other")
    line.run(1.0)
    assert out == ["b", "a"]


def test_losses_are_as_many_as_said():
    ride = Ride(loss=0.05).send(2000, "state", every_ms=1)
    assert len(ride.out) == pytest.approx(0.95 * 2000, rel=0.02)


def test_what_is_reliable_arrives_in_order_and_all_of_it_later_where_it_was_lost():
    ride = Ride(delay_s=0.02, jitter=0.5, loss=0.2).send(300, None).wait(1000)
    assert ride.numbers == list(range(300))
    assert max(ride.delays_ms) > 50


def test_a_cut_line_carries_nothing_but_what_is_under_way():
    ride = Ride(delay_s=0.05).send(3, "state")
    ride.line.set(LinkConditions(cut=True))
    ride.send(3, "state").wait(100)
    assert ride.numbers == [0, 1, 2]


def test_the_same_seed_carries_alike_and_another_does_not():
    def played(seed):
        return Ride(seed, delay_s=0.05, jitter=0.4, loss=0.1).send(200, "state").wait(200).out

    assert played(3) == played(3)
    assert played(3) != played(4)
