"""What an operator's session takes for the daemon's word, over loopback."""

import socket

import pytest
import zenoh
from telerobot.drivers.network.session import Session
from telerobot.drivers.network.sessions import client_config, router_config
from telerobot.protocols import topics as t

TRIES = 100_000


@pytest.fixture
def network():
    """Return a daemon's session, an operator's and a stranger's."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    with zenoh.open(router_config(endpoint, "pa10")) as daemon:
        operator = Session("pa10", endpoint)
        with zenoh.open(client_config(endpoint)) as stranger:
            yield daemon, operator, stranger
        operator.close()


def heard_until(inbox, last, send):
    """Return what an inbox holds until a payload has come, which is sent again and again."""
    heard = []
    for _ in range(TRIES):
        send()
        heard += inbox.take()
        if last in heard:
            return heard
    raise AssertionError(f"{last} was not heard; only {set(heard)}")


def test_telemetry_is_the_daemons_alone_whatever_a_stranger_puts(network):
    daemon, operator, stranger = network
    inbox = operator.subscribe(t.EVENT, 256)
    meet = operator.subscribe(t.RIG_TRUTH, 256)  # on which a stranger may put
    key, open_key = t.EVENT.full_key("pa10"), t.RIG_TRUTH.full_key("pa10")
    heard_until(inbox, b"true", lambda: daemon.put(key, b"true"))
    for forged in (key, "telerobot/pa10/*/event", "telerobot/**", "**"):
        stranger.put(forged, b"forged")
    heard_until(meet, b"after", lambda: stranger.put(open_key, b"after"))
    assert b"forged" not in set(inbox.take())


def test_what_is_longer_than_telemetry_can_be_is_not_taken(network):
    daemon, operator, _ = network
    inbox = operator.subscribe(t.STATE, 256)
    key = t.STATE.full_key("pa10")
    heard_until(inbox, b"true", lambda: daemon.put(key, b"true"))
    daemon.put(key, bytes(t.STATE.max_bytes + 1))
    heard = heard_until(inbox, b"after", lambda: daemon.put(key, b"after"))
    assert {len(payload) for payload in heard} <= {len(b"true"), len(b"after")}
