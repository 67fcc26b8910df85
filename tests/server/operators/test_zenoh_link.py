import socket

import pytest
import zenoh
from telerobot.drivers.device import DeviceError
from telerobot.drivers.network.sessions import client_config
from telerobot.protocols import topics as t
from telerobot.server.operators.link import ZenohLink

TRIES = 100_000


def refusal(endpoint: str) -> str:
    with pytest.raises(DeviceError) as caught:
        ZenohLink("cell", endpoint)
    return str(caught.value)


def test_an_endpoint_that_is_taken_is_said_in_one_line():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        words = refusal(endpoint)
    assert words.startswith(f"zenoh.listen: value '{endpoint}': ")
    assert "in use" in words
    assert ".rs:" not in words
    assert "\n" not in words


def test_a_protocol_that_zenoh_does_not_know_is_said():
    assert "nosuch" in refusal("nosuch/127.0.0.1:7447")


@pytest.fixture
def network():
    """Return a daemon's link and the session of a peer."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    link = ZenohLink("cell", endpoint)
    with zenoh.open(client_config(endpoint)) as peer:
        yield link, peer
    link.close()


def asked(link, peer, topic, payload):
    """Ask on a topic until the request comes in; return it and the replies' channel."""
    for _ in range(TRIES):
        replies = peer.get(topic.full_key("cell"), payload=payload, attachment=b"proof")
        while not over(replies):
            parcel = oldest(link, topic)
            if parcel is not None:
                return parcel, replies
    raise AssertionError("the request did not come in")


def oldest(link, topic):
    """Return the oldest message that waits on a topic, None without one that is to be read."""
    source = link.source(topic)
    came = source.poll()
    return None if came is None else source.read(came)


def over(replies):
    """Return whether a request ended without an answer: nobody was known yet who gives one."""
    try:
        return replies.try_recv() is not None
    except zenoh.ZError:
        return True


def test_a_request_comes_with_what_is_attached_and_its_answer_goes_back(network):
    parcel, replies = asked(*network, t.TARE, b"please")
    assert (bytes(parcel.payload), bytes(parcel.attached)) == (b"please", b"proof")
    parcel.answer(b"yes")
    assert replies.recv().ok.payload.to_bytes() == b"yes"


def test_a_request_that_is_let_go_ends_for_who_asked(network):
    parcel, replies = asked(*network, t.TARE, b"junk")
    parcel.answer(None)
    assert list(replies) == []


def test_who_asks_on_all_keys_at_once_is_heard_on_none_and_gets_no_answer(network):
    link, peer = network
    asked(link, peer, t.TARE, b"the queryables are known")
    replies = peer.get("telerobot/cell/operator/*", payload=b"x")
    last, after = asked(link, peer, t.SPEED, b"after")
    last.answer(b"yes")
    after.recv()
    seen = [oldest(link, topic) for topic in t.REQUESTS for _ in range(10)]
    assert not [parcel for parcel in seen if parcel is not None and bytes(parcel.payload) == b"x"]
    assert list(replies) == []


@pytest.mark.parametrize(
    ("key", "sender"),
    [("", ""), ("/lidar", "lidar"), ("/*", ""), ("/a/b", ""), ("/UPPER", "")],
)
def test_news_of_obstacles_comes_with_the_name_of_who_put_it(network, key, sender):
    link, peer = network
    for _ in range(TRIES):
        peer.put(f"telerobot/cell/sensor/obstacle{key}", b"news")
        if (raw := oldest(link, t.OBSTACLE)) is not None:
            break
    assert raw.sender == sender
    assert bytes(raw.payload) == b"news"


def test_whether_somebody_listens_is_known_as_they_come_and_go(network):
    link, peer = network

    def becomes(heard):
        """Return whether the link comes to know it within forty questions of the peer."""
        for _ in range(40):
            if link.heard(t.STATE) is heard:
                return True
            parcel, replies = asked(link, peer, t.TARE, b"")
            parcel.answer(b"yes")
            list(replies)
        return False

    assert not link.heard(t.STATE)
    for _ in range(2):
        subscriber = peer.declare_subscriber(t.STATE.full_key("cell"))
        assert becomes(True)
        assert not link.heard(t.REFLECTION)
        subscriber.undeclare()
        assert becomes(False)
