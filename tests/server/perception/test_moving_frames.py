import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.protocols.messages.perception import FrameNews
from telerobot.server.control.spatial import Pose, pose_error, rotation_exp
from telerobot.server.events import Events
from telerobot.server.perception.moving_frames import FrameTracker
from telerobot.server.refusals import Refused, Why

T = 0.01


@pytest.fixture
def cell():
    return load_cell("pa10_platform")


@pytest.fixture
def events():
    return Events()


@pytest.fixture
def watch(cell, events):
    return FrameTracker.from_cell(cell, events)


def news(name, tick, pose, **more):
    x, y, z, *rpy = pose.to_xyz_rpy()
    return FrameNews(name=name, tick=tick, xyz=(x, y, z), rpy=tuple(rpy), **more)


def turning(seconds):
    way = seconds * np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.1])
    return Pose(rotation_exp(way[3:]), way[:3])


def names(events):
    return [(e.name, e.values.get("reason")) for e in events.take()]


def test_a_carrier_seen_from_a_base_that_moves_is_placed_where_base_was_then(watch):
    T_base_carrier = Pose(np.eye(3), np.array([0.7, -0.2, 0.3]))
    for tick in range(1, 200):
        if tick > 4:
            then = tick - 4
            watch.take(news("base", then, turning(then * T)), tick)
            watch.take(news("carrier", then, T_base_carrier, seen_from="base"), tick)
        moved = watch.step(tick, moving=False)
    expected = turning(200 * T) @ T_base_carrier
    np.testing.assert_allclose(pose_error(moved.carrier.T, expected), 0.0, atol=2e-4)
    measured = pose_error(moved.T_world_base_measured, turning(199 * T))
    np.testing.assert_allclose(measured, 0.0, atol=1e-5)


def test_news_is_told_of_when_it_is_doubted_lost_and_found_again(watch, events):
    home = Pose(np.eye(3), np.array([0.6, -0.3, 0.45]))
    far = Pose(np.eye(3), np.array([1.6, -0.3, 0.45]))
    watch.take(news("carrier", 1, home), 2)
    assert names(events) == [("frame_found", None)]
    for tick in range(3, 6):
        watch.take(news("carrier", tick, far), tick)
    assert names(events) == [("frame_rejected", "jump")]
    for tick in range(6, 40):
        watch.step(tick, moving=True)
    assert names(events) == [("frame_lost", "jump")]
    assert watch.age("carrier", 40) is None
    watch.take(news("carrier", 40, far), 41)
    assert names(events) == [("frame_found", None)]
    before = watch.moved.carrier.T
    after = watch.step(41, moving=True).carrier
    assert np.abs(pose_error(after.T, before)).max() < 1e-3


def test_news_told_twice_before_a_silence_is_not_why_the_frame_was_lost(watch, events):
    home = Pose(np.eye(3), np.array([0.6, -0.3, 0.45]))
    for tick in (1, 2, 2):
        watch.take(news("carrier", tick, home), 3)
    assert names(events) == [("frame_found", None), ("frame_rejected", "out_of_order")]
    for tick in range(3, 40):
        watch.step(tick, moving=True)
    assert names(events) == [("frame_lost", "no_news")]


def test_news_of_the_future_and_of_what_does_not_move_is_refused_by_name(watch, cell, events):
    with pytest.raises(Refused) as caught:
        watch.take(news("base", 11, Pose.identity()), 10)
    assert caught.value.reason == Why.FUTURE_PICTURE
    fixed = altered(cell, {"frames.base": None})
    with pytest.raises(Refused) as caught:
        FrameTracker.from_cell(fixed, events).take(news("base", 9, Pose.identity()), 10)
    assert caught.value.reason == Why.UNKNOWN_FRAME
    assert "carrier" in caught.value.detail


def test_news_that_is_older_than_its_timeout_is_not_believed(watch, events):
    watch.take(news("base", 10, Pose.identity()), 100)
    assert names(events) == [("frame_rejected", "late")]
    assert watch.age("base", 100) is None


@pytest.mark.parametrize("liar", [0, 4], ids=["as fresh", "as late"])
def test_two_senders_that_contradict_each_other_are_both_not_believed(watch, events, liar):
    """One says that Base stands, the other that it drives away, as slowly as it may."""
    still = Pose.identity()
    for tick in range(5, 295):
        if tick % 2:
            watch.take(news("base", tick - 4, still), tick)
        away = min(0.25 * (tick - 5) * T, 0.4)
        if tick < 205:
            there = Pose(np.eye(3), np.array([0.0, 0.0, away]))
            watch.take(news("base", tick - liar, there), tick)
        moved = watch.step(tick, moving=True)
        if watch.disputed == "base":
            assert watch.age("base", tick) is None
    told = [event for event in events.take() if event.name == "frame_disputed"]
    assert len(told) == 1
    assert told[0].tick <= 5 + 30, "before it is 75 mm away"
    assert watch.disputed == "base", "for a second after one of them was silent"
    assert np.abs(moved.base.T.p).max() < 0.12
    for tick in range(295, 500):
        watch.take(news("base", tick - 4, still), tick)
        moved = watch.step(tick, moving=True)
    assert watch.disputed is None
    assert names(events) == [("frame_found", None)]
    assert np.abs(moved.base.T.p).max() < 1e-3


def test_two_sensors_that_agree_are_no_dispute(watch, events):
    """The slower one's news is late, and says nothing else."""
    for tick in range(5, 200):
        for late in (2, 4):
            watch.take(news("base", tick - late, turning((tick - late) * T)), tick)
        watch.step(tick, moving=True)
    assert watch.disputed is None
    assert set(names(events)) == {("frame_found", None), ("frame_rejected", "out_of_order")}
