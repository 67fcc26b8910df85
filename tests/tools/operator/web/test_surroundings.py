"""What sensors tell reaches the pages; over loopback, through a daemon's own router."""

import base64
import json
import socket
import struct
import time
from typing import NamedTuple

import pytest
import zenoh
from telerobot.drivers.network.session import Session
from telerobot.drivers.network.sessions import router_config
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.protocols.messages.perception import (
    CameraPicture,
    ContourNews,
    ObstacleNews,
    ScanPoints,
)
from telerobot.tools.operator.web.streams import WorldNews

PATIENCE_S = 20.0
CONTOUR = ContourNews(
    tick=7, rows=2, columns=2, cell=0.05, phase="refused", reason="no_posture", most_speed=0.0,
    nearest_mm=struct.pack("<4H", 65535, 1200, 0, 65535),
)  # fmt: skip
CRATE = ObstacleNews(name="crate", tick=7, shape="sphere", xyz=(1.0, 0.0, 0.0), radius=0.1)
SCAN = ScanPoints(tick=7, points_mm=struct.pack("<6i", 1000, -2000, 3, 0, 70000, -1))
PICTURE = CameraPicture(camera="eye", tick=7, jpeg=b"JPEG")


class Tellers(NamedTuple):
    """Who tells: a sensor, and the daemon, of telemetry."""

    sensor: Session
    daemon: zenoh.Session

    def put(self, topic, payload):
        if topic.flow is t.Flow.TELEMETRY:
            self.daemon.put(topic.full_key("pa10"), payload)
        else:
            self.sensor.put(topic, payload)

    def heard(self, topic):
        return self.sensor.heard(topic)


@pytest.fixture
def network():
    """Return a sensor's session with the daemon's, and an operator's surroundings."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with zenoh.open(router_config(endpoint, "pa10")) as daemon:
        sensor, operator = Session("pa10", endpoint), Session("pa10", endpoint)
        yield Tellers(sensor, daemon), WorldNews(operator)
        sensor.close()
        operator.close()


def told(network, topic, message, looked_at=True):
    """Return what pages are told first of a message, which is put again and again."""
    sensor, surroundings = network
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        sensor.put(topic, encode(message))
        for each in surroundings.turn(time.monotonic(), looked_at):
            return each.kind, json.loads(each.text)
    raise AssertionError("nothing is told")


def test_an_obstacle_that_the_daemon_holds_is_shown_and_each_news_counts(network):
    kind, message = told(network, t.HELD, CRATE)
    assert (kind, message["type"]) == ("", "obstacle")
    assert (message["obstacle"]["name"], message["obstacle"]["radius"]) == ("crate", 0.1)


def test_what_anybody_puts_on_the_sensors_key_is_not_shown_unless_the_daemon_took_it(network):
    sensor, surroundings = network
    moved = CRATE.model_copy(update={"xyz": (5.0, 0.0, 0.0)})
    told(network, t.HELD, CRATE)
    deadline_s, kinds = time.monotonic() + PATIENCE_S, []
    while "contour" not in kinds and time.monotonic() < deadline_s:
        # Again and again, as nobody tells when the daemon knows who wants contours.
        for topic, news in (
            (t.OBSTACLE, moved), (t.OBSTACLE.by("thief"), moved), (t.CONTOUR, CONTOUR),
        ):  # fmt: skip
            sensor.put(topic, encode(news))
        shown = list(surroundings.turn(time.monotonic(), True))
        kinds += [each.kind for each in shown]
        assert not any('"xyz":[5.0' in each.text for each in shown)
    assert "contour" in kinds


def test_a_contour_is_shown_with_its_distances_and_what_it_means_in_words(network):
    kind, message = told(network, t.CONTOUR, CONTOUR)
    contour = message["contour"]
    assert kind == "contour"
    assert contour["nearest_mm"] == [None, 1200, 0, None]
    assert (contour["rows"], contour["columns"], contour["most_speed"]) == (2, 2, 0.0)
    assert contour["words"].startswith("There is no way through. No posture")


@pytest.mark.parametrize(
    ("topic", "sent", "kind", "field", "shown"),
    [
        (t.PICTURE, PICTURE, "picture eye", "jpeg", b"JPEG"),
        (t.SCAN, SCAN, "scan", "points_mm", SCAN.points_mm),
    ],
    ids=["picture", "scan"],
)
def test_what_is_for_eyes_is_asked_for_while_somebody_looks_and_no_longer(
    network, topic, sent, kind, field, shown
):
    sensor, surroundings = network
    found, message = told(network, topic, sent)
    assert found == kind
    assert base64.b64decode(message[message["type"]][field]) == shown
    deadline_s = time.monotonic() + PATIENCE_S
    while not sensor.heard(topic) and time.monotonic() < deadline_s:  # news of its own
        list(surroundings.turn(time.monotonic(), True))
    assert sensor.heard(topic)
    while sensor.heard(topic) and time.monotonic() < deadline_s:
        assert list(surroundings.turn(time.monotonic(), False)) == []
    assert not sensor.heard(topic)


def test_junk_is_passed_over(network):
    sensor, surroundings = network
    sensor.put(t.CONTOUR, b"junk")
    assert told(network, t.HELD, CRATE)[1]["type"] == "obstacle"
    assert {each.kind for each in surroundings.turn(time.monotonic(), True)} <= {""}
