"""What a rig tells of its frames, and of which tick, where only SYNCs and telemetry are heard."""

import can
import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.drivers.bus import Hub, InProcessBus
from telerobot.drivers.rig.rig import Rig
from telerobot.protocols.canopen import can301
from telerobot.protocols.messages.perception import RigMotion
from telerobot.protocols.messages.rig import RigFault
from telerobot.tools.simulation.frame_sensors import FrameSensors, SyncTicks

PERIOD_S = 0.01


def test_a_sync_is_named_by_the_ticks_that_were_heard_beside_others():
    ticks = SyncTicks()
    assert ticks.tick(7) is None
    ticks.heard(3, 103)
    assert ticks.tick(104) == 4


def test_ticks_that_are_heard_late_or_beside_a_late_sync_do_not_count():
    ticks = SyncTicks()
    for tick in range(20):
        late = {5: 1, 6: 2, 11: -1}.get(tick, 0)
        ticks.heard(tick, tick + 40 + late)
    assert ticks.tick(100) == 60
    ticks.forget()
    assert ticks.tick(100) is None


class Line:
    """A rig on a bus with a master of which only SYNC and telemetry are there, ticks from 1."""

    def __init__(self):
        self.cell = load_cell("pa10_platform")
        hub = Hub()
        self.rig = Rig(self.cell, InProcessBus(hub))
        self.bus = InProcessBus(hub)
        self.tick, self.news = 0, []
        self.heard = None
        """The newest tick of the telemetry that was not asked for yet."""
        self.truth = {}
        """The Carrier's true y at each tick [m]."""
        FrameSensors(self.cell, self.rig, self._newest, self.news.append)
        self.rig.inject(RigMotion(target="carrier", twist=(0.0, 0.3, 0.0, 0.0, 0.0, 0.0)))

    def _newest(self):
        heard, self.heard = self.heard, None
        return heard

    def run(self, ticks):
        for _ in range(ticks):
            self.tick += 1
            self.truth[self.tick] = self.rig.frames["carrier"][1]
            self.bus.send(can.Message(arbitration_id=can301.SYNC_ID, is_extended_id=False))
            self.rig.poll()
            self.rig.advance(PERIOD_S)
            self.heard = self.tick

    def told(self, name="carrier"):
        return [news for news in self.news if news.name == name]


@pytest.fixture
def line():
    return Line()


def test_news_is_of_the_tick_in_which_the_frame_was_there(line):
    line.run(300)
    moving = line.told()[-30:]
    assert len(line.told()) > 100
    error = [news.xyz[1] - line.truth[news.tick] for news in moving]
    assert np.abs(error).max() < 1e-3  # a tick more or less is 3 mm
    late = {line.tick - news.tick for news in moving[-1:]}
    assert late <= {4, 5, 6}


def test_a_rig_that_comes_to_a_running_daemon_learns_its_ticks(line):
    line.tick = 5000
    line.run(200)
    news = line.told()[-1]
    assert news.tick > 5000
    assert abs(news.xyz[1] - line.truth[news.tick]) < 1e-3


def test_a_daemon_that_starts_anew_is_told_its_own_ticks_and_none_of_the_old(line):
    line.run(200)
    line.rig.advance(1.0)
    line.tick, line.news[:] = 0, []
    line.run(100)
    assert line.told()
    assert all(news.tick < 100 for news in line.news)
    news = line.told()[-1]
    assert abs(news.xyz[1] - line.truth[news.tick]) < 1e-3


def test_without_telemetry_nothing_is_told(line):
    FrameSensors(line.cell, line.rig, lambda: None, line.news.append)
    line.run(50)
    assert line.news == []


def test_a_silenced_sensor_tells_nothing_of_its_frame_and_the_other_goes_on(line):
    line.rig.inject(RigFault(kind="silence", target="carrier"))
    line.run(50)
    assert line.told() == []
    assert line.told("base")
    line.rig.inject(RigFault(kind="silence", target="carrier", on=False))
    line.run(50)
    assert line.told()


def test_a_frame_that_does_not_move_is_no_target():
    with pytest.raises(ValueError, match="no target 'base'"):
        Rig(load_cell("pa10"), InProcessBus(Hub())).inject(RigFault(kind="silence", target="base"))
