"""Video for pages: made while somebody looks, the same for all, never late to one who is slow."""

import json
import socket
import struct
import time

import pytest
import zenoh
from telerobot.drivers.network.session import Session
from telerobot.drivers.network.sessions import router_config
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.protocols.messages.perception import MOST_PIECES, VideoPiece
from telerobot.protocols.topics import Role
from telerobot.tools.operator.web.pages import ALIVE_S, Page
from telerobot.tools.operator.web.streams import (
    LATE_S,
    CameraVideo,
    DaemonClock,
    VideoFrame,
    Videos,
    Watch,
)

PATIENCE_S = 20.0
PERIOD_S = 0.05


class Inbox:
    """Gives payloads once."""

    def __init__(self, *payloads):
        self.payloads = list(payloads)

    def take(self):
        while self.payloads:
            yield self.payloads.pop(0)

    def close(self):
        pass


def pieces(frame, key=False, count=1, camera="wrist", tick=7):
    return [
        VideoPiece(
            camera=camera, tick=tick, frame=frame, key=key, piece=i, pieces=count,
            data=b"%d.%d " % (frame, i),
        )
        for i in range(count)
    ]  # fmt: skip


def told(*messages):
    """Return the frames that come of messages, as (number, key, H.264)."""
    payloads = [m if isinstance(m, bytes) else encode(m) for m in messages]
    frames = list(CameraVideo(Inbox(*payloads)).take())
    return [(frame.number, frame.key, frame.message[12 + len("wrist") :]) for frame in frames]


def frame(number, key=False):
    return VideoFrame(number, key, b"%d" % number)


def test_a_frame_is_put_together_from_its_pieces_and_told_with_its_camera_and_tick():
    payloads = [encode(piece) for piece in pieces(3, key=True, count=3, tick=1234)]
    (whole,) = CameraVideo(Inbox(*payloads)).take()
    key, length, _, number, tick = struct.unpack_from("<BBHII", whole.message)
    assert (key, length, number, tick) == (1, 5, 3, 1234)
    assert whole.message[12:] == b"wrist3.0 3.1 3.2 "


def test_a_frame_that_lacks_a_piece_is_lost_and_so_are_those_that_need_it():
    lost = pieces(2, count=3)
    del lost[1]
    shown = told(*pieces(1, key=True), *lost, *pieces(3), *pieces(4, key=True, count=2), *pieces(5))
    assert [(number, key) for number, key, _ in shown] == [(1, True), (4, True), (5, False)]


def test_junk_and_what_does_not_fit_are_passed_over():
    mixed = [pieces(2, count=3)[2], *pieces(2, count=2)[1:], pieces(8, count=2)[0]]
    shown = told(b"junk", *mixed, *pieces(9, key=True), b"", *pieces(10))
    assert [number for number, _, _ in shown] == [9, 10]


def test_a_piece_beyond_the_last_is_no_message():
    with pytest.raises(ValueError, match="piece 2 of 2"):
        VideoPiece(camera="wrist", tick=1, frame=1, key=True, piece=2, pieces=2, data=b"x")


def watched(seconds, receives, watch, first=0):
    """Return the frames that a watcher is sent, a key frame every 20th; `receives(number, s)`."""
    sent = []
    for k in range(first, first + round(seconds / PERIOD_S)):
        now_s = k * PERIOD_S
        watch.offer(frame(k, key=k % 20 == 0), now_s)
        while watch.waiting:
            sent.append(int(watch.next(now_s)))
            if receives(sent[-1], now_s):
                watch.received(sent[-1])
    return sent


def test_who_receives_all_is_sent_all():
    assert watched(5.0, lambda _number, _now_s: True, Watch()) == list(range(100))


def test_who_receives_nothing_is_sent_no_more_until_caught_up_and_then_begins_with_a_key_frame():
    watch = Watch()
    sent = watched(5.0, lambda _number, _now_s: False, watch)
    assert len(sent) <= LATE_S / PERIOD_S + 2
    watch.received(sent[-1])
    again = watched(3.0, lambda _number, _now_s: True, watch, first=105)
    assert again[0] == 120
    assert again == list(range(120, 165))


def test_what_waits_for_a_slow_socket_gives_way_to_a_key_frame():
    watch = Watch()
    for k in range(35):
        watch.offer(frame(k, key=k in (0, 30)), 0.0)
    assert [int(watch.next(0.0)) for _ in range(len(watch.waiting))] == [30, 31, 32, 33, 34]


class Viewer:
    """A page in virtual time."""

    def __init__(self, role=Role.OBSERVER):
        self.now_s = 10.0
        self.page = Page(
            "bob", role, "pa10", lambda *_: None, lambda *_: None, clock=lambda: self.now_s,
            cameras=frozenset({"wrist", "beside"}),
        )  # fmt: skip

    def beat(self, video):
        self.page.take(json.dumps({"type": "beat", "n": 1, "held": {}, "video": video}))

    def complaints(self):
        while not self.page.outbox.empty():
            message = json.loads(self.page.outbox.get_nowait())
            if message["type"] == "complaint":
                yield message["detail"]


def test_an_observer_may_look_and_looks_as_long_as_its_page_is_alive():
    viewer = Viewer()
    viewer.beat({"wrist": 0})
    assert set(viewer.page.watches) == {"wrist"}
    viewer.now_s += 0.9 * ALIVE_S
    viewer.page.run(viewer.now_s)
    assert set(viewer.page.watches) == {"wrist"}
    viewer.now_s += 0.2 * ALIVE_S
    viewer.page.run(viewer.now_s)
    assert viewer.page.watches == {}


def test_a_camera_that_the_cell_has_not_is_not_listened_for():
    viewer = Viewer()
    viewer.beat({"ceiling": 0, "../wrist": 0, "**": 0})
    assert viewer.page.watches == {}
    assert list(viewer.complaints()) == []


@pytest.mark.parametrize("video", ["wrist", ["wrist"], {"wrist": "all"}, {"wrist": None}])
def test_what_is_no_table_of_cameras_is_complained_of(video):
    viewer = Viewer()
    viewer.beat(video)
    (complaint,) = viewer.complaints()
    assert complaint.startswith("video: give")
    assert viewer.page.watches == {}


def test_on_a_slow_link_no_camera_keeps_another_waiting():
    viewer = Viewer()
    viewer.beat({"wrist": 0, "beside": 0})
    viewer.page.tell_video("wrist", [VideoFrame(k, k == 0, b"wrist") for k in range(4)])
    viewer.page.tell_video("beside", [VideoFrame(k, k == 0, b"beside") for k in range(2)])
    sent = []
    for _ in range(4):
        viewer.now_s += 0.01
        sent.append(viewer.page.next_frame())
    assert sent == [b"wrist", b"beside", b"wrist", b"beside"]


def test_ticks_of_the_daemon_are_told_on_the_consoles_clock(make_state):
    clock = DaemonClock(0.01)
    for tick, late_s in ((100, 0.030), (101, 0.002), (102, 0.050), (104, 0.004)):
        state = make_state(tick).model_copy(update={"time_s": 500.0 + 0.01 * tick})
        clock.on_state(state, 20.0 + 0.01 * tick + late_s)
    # Of all that came, that of tick 101 came quickest.
    assert clock.zero_s + 0.01 * 104 == pytest.approx(20.0 + 1.04 + 0.002, abs=1e-4)
    again = make_state(3).model_copy(update={"time_s": 0.03})
    clock.on_state(again, 90.0)
    assert clock.zero_s == pytest.approx(90.0 - 0.03), "the daemon was started again"


@pytest.fixture
def network():
    """Return a camera's session and a console's videos."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with zenoh.open(router_config(endpoint, "pa10")):
        sensor, operator = Session("pa10", endpoint), Session("pa10", endpoint)
        yield sensor, Videos(operator)
        sensor.close()
        operator.close()


def until(done):
    deadline_s = time.monotonic() + PATIENCE_S
    while not done():
        assert time.monotonic() < deadline_s


def test_a_camera_is_heard_while_it_is_looked_at_and_no_other(network):
    sensor, videos = network
    wrist, beside = t.VIDEO.by("wrist"), t.VIDEO.by("beside")

    def heard(watched):
        list(videos.turn(watched))
        return sensor.heard(wrist), sensor.heard(beside)

    until(lambda: heard({"wrist"}) == (True, False))
    until(lambda: heard({"wrist", "beside"}) == (True, True))
    until(lambda: heard(set()) == (False, False))


def test_every_frame_of_the_largest_comes_through_the_daemons_router_whole(network):
    sensor, videos = network
    wrist = t.VIDEO.by("wrist")
    until(lambda: list(videos.turn({"wrist"})) or sensor.heard(wrist))
    for number in range(300):
        for piece in pieces(number, key=True, count=MOST_PIECES):
            sensor.put(wrist, encode(piece.model_copy(update={"data": bytes(7600)})))
        got = []
        until(lambda got=got: got.extend(videos.turn({"wrist"})) or got)
        assert [frame.number for _, frame in got] == [number]
        assert len(got[0][1].message) == 12 + len("wrist") + MOST_PIECES * 7600
