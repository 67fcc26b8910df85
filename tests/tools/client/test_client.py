import numpy as np
import pytest
from telerobot.config.schema.network import ReflectionSection
from telerobot.protocols.messages.messages import Frame, Reflection
from telerobot.tools.client.reflection import ReflectingClient


def news(tick, force=-1.5, **more):
    wrench = (force, 0.0, 0.0, 0.0, 0.0, 0.0)
    return Reflection(
        **{"tick": tick, "wrench": wrench, "slope": 200.0, "entered": 0.0, "protected": True} | more
    )


class Hearing:
    """A client that hears news every 10 ms until it no longer does."""

    def __init__(self, mode="rate"):
        self.client, self.tick = ReflectingClient(ReflectionSection(), 0.0), 0
        self.client.set_mode(mode, Frame.BASE)

    @property
    def now_s(self):
        return 0.01 * self.tick

    def go(self, seconds, heard=True, **more):
        for _ in range(round(100 * seconds)):
            self.tick += 1
            if heard:
                self.client.on_reflection(news(self.tick, **more), self.now_s)
            self.client.run(self.now_s)
        return self


def test_the_force_is_felt_and_the_stick_asks_for_what_it_is_pushed_to():
    client = Hearing().go(5.0).client
    assert client.device.force[0] == pytest.approx(-1.5, abs=0.01)
    fields = client.stick(5.0)
    assert fields["twist"][0] == pytest.approx(1.5 * -1.5 / 300.0, rel=0.01)
    assert fields["expressed_in"] is Frame.BASE


def test_a_round_trip_is_taken_from_what_is_echoed_and_its_worst_is_kept_for_a_while(make_state):
    client = ReflectingClient(ReflectionSection(), 0.0)
    assert client.round_trip_s == 0.5  # what the cell expects, before any is seen
    for seq, rtt_s in enumerate((0.1, 0.3, 0.1, 0.1), start=1):
        client.trip.sent("cmd/joystick", seq, float(seq))
        client.on_state(make_state(last_seq={"cmd/joystick": seq}), seq + rtt_s)
        if seq == 2:
            assert client.round_trip_s == pytest.approx(0.3)
    assert 0.1 < client.round_trip_s < 0.3


def test_the_filter_is_slower_on_a_longer_way_and_off_without_protection():
    hearing = Hearing().go(0.1)
    assert hearing.client.filter_s > 0.9  # 1.5 g (0.5 s + lags), g = 200 * 0.005
    hearing.go(0.01, slope=100.0)
    assert hearing.client.filter_s == 0.0  # g = 0.5: small gain
    hearing.go(0.01, protected=False)
    assert hearing.client.filter_s == 0.0


def test_overtaken_news_is_not_felt():
    hearing = Hearing().go(5.0)
    hearing.client.on_reflection(news(3, force=99.0), hearing.now_s)
    assert hearing.go(0.05, heard=False).client.device.force[0] == pytest.approx(-1.5, abs=0.01)


# In pose mode the port's damping acts as well, on a handle that springs back.
@pytest.mark.parametrize(("mode", "jump"), [("rate", 0.1), ("pose", 1.0)])
def test_in_silence_the_force_fades_and_then_nothing_is_sent(mode, jump):
    hearing = Hearing(mode).go(5.0)
    client = hearing.client
    forces = [abs(hearing.go(0.01, heard=False).client.device.force[0]) for _ in range(80)]
    assert forces[25] == pytest.approx(1.5, abs=0.02)
    assert max(-np.diff(forces)) < jump
    assert forces[-1] == 0.0
    assert client.stick(hearing.now_s) is client.pose(hearing.now_s) is None
    hearing.go(1.0)
    assert client.stick(hearing.now_s) is not None
    assert client.device.force[0] < -1.0


def test_a_lapse_of_real_time_is_not_made_up():
    client = ReflectingClient(ReflectionSection(), 0.0)
    client.device.path.move(np.array([0.03, 0.0, 0.0]), 0.5, 0.0)
    client.run(3600.0)
    assert abs(client.device.p[0]) < 0.001


def test_a_master_whose_hand_is_given_energy_it_never_put_in_damps_it_away():
    """A force that pulls where the hand goes, as a late one does; protected and not."""
    works = []
    for protected in (True, False):
        hearing = Hearing("pose")
        path = hearing.client.device.path
        for i in range(6):
            path.move(np.array([0.03 * (-1) ** i, 0.0, 0.0]), 1.0, hearing.now_s)
            hearing.go(1.0, force=2.0 * (-1) ** i, protected=protected)
        works.append(hearing.client.device.work)
    bound = ReflectionSection().energy_bound
    assert works[0] > -bound
    assert works[1] < -4.0 * bound
