"""A target that moves: the tag goes straight, and the daemon hears of it."""

import pytest
from telerobot.protocols.codec import decode_as
from telerobot.protocols.messages.perception import ObstacleNews
from telerobot.protocols.topics import OBSTACLE
from telerobot.tools.scripts.generators import NEWS_EVERY_S, TargetMotion
from telerobot.tools.scripts.script import MovingTarget

STEP = MovingTarget(tag="duck", sight_line="view", start=(0, 0, 0), to=(0.3, 0.4, 0), speed=0.25)


def test_it_goes_straight_at_its_speed_and_stops_where_it_was_sent():
    target = TargetMotion(STEP, 10.0)
    place, arrived = target.place(11.0)
    assert place == pytest.approx((0.15, 0.2, 0.0))
    assert not arrived
    assert target.place(12.5) == ((0.3, 0.4, 0.0), True)


def test_tag_and_news_agree_and_end_with_the_last_place():
    target, sent, moved = TargetMotion(STEP, 0.0), [], []

    def put(topic, data, proof):
        assert proof == b"", "what a sensor tells needs no lease"
        sent.append((topic, data))

    for tick in range(300):
        target.run(0.01 * tick, tick, put, moved.append)
    news = [decode_as(ObstacleNews, data, OBSTACLE.max_bytes) for topic, data in sent]
    assert all(topic == OBSTACLE.by("script") for topic, _ in sent)
    assert [n.to for n in news] == [fault.vector for fault in moved]
    assert {n.name for n in news} == {"view"}
    assert news[-1].to == (0.3, 0.4, 0.0)
    assert len(news) == pytest.approx(2.0 / NEWS_EVERY_S, abs=2)
    assert [n.tick for n in news] == sorted(n.tick for n in news)
