"""Junk on the keepalive's key, faster than anybody empties it, crowds out no other peer's.

Each step waits for a message of the same peer on another key: one peer's messages keep their order.
"""

import os

import pytest
import zenoh
from telerobot.drivers.network.authority import write_router
from telerobot.drivers.network.sessions import client_config, router_config
from telerobot.server.operators.link import RING

from .wire import free_endpoint

KEEPALIVE, MARK = "telerobot/pa10/cmd/keepalive", "telerobot/pa10/cmd/cancel"
FLOOD = 20 * RING
TRIES = 100_000


def by_itself(zone, endpoint, _monkeypatch):
    return router_config(endpoint, "pa10")


def certified(zone, endpoint, _monkeypatch):
    return router_config(endpoint, "pa10", zone.identity("daemon-pa10"))


def common(zone, endpoint, monkeypatch):
    (written,) = write_router(zone.folder, endpoint, "hub")
    monkeypatch.chdir(zone.folder)
    return zenoh.Config.from_file(written.name)


@pytest.fixture(params=[by_itself, certified, common], ids=lambda made: made.__name__)
def network(request, zone, monkeypatch):
    """Return what hears keepalives and marks, and the sessions of a flooder and of an operator."""
    endpoint = free_endpoint("tcp" if request.param is by_itself else "tls")
    router = zone.open(request.param(zone, endpoint, monkeypatch))
    identities = [None, None]
    if request.param is not by_itself:
        identities = [zone.identity(name) for name in ("operator-ann", "operator-both")]
    heard = [
        router.declare_subscriber(k, zenoh.handlers.RingChannel(RING)) for k in (KEEPALIVE, MARK)
    ]
    if request.param is common:  # its own session is nobody's, and may hear nothing
        member = zone.open(client_config(endpoint, "pa10", zone.identity("daemon-pa10")))
        heard = [
            member.declare_subscriber(key, zenoh.handlers.RingChannel(RING))
            for key in (KEEPALIVE, MARK)
        ]
    peers = [zone.open(client_config(endpoint, "pa10", who)) for who in identities]
    return (*heard, *peers)


def arrived(marks, peer):
    """Wait until all that a peer put has come through."""
    last = os.urandom(8)
    for _ in range(TRIES):
        sample = marks.try_recv()
        if sample is None:
            peer.put(MARK, last)  # nobody was known yet who listens, or junk pushed it out
        elif sample.payload.to_bytes() == last:
            return
    raise AssertionError("the mark did not come")


@pytest.mark.parametrize("key", [KEEPALIVE, "telerobot/pa10/cmd/*", "telerobot/**"])
def test_no_flood_by_one_peer_pushes_out_anothers_keepalive(network, key):
    keepalives, marks, flooder, operator = network
    arrived(marks, flooder)
    arrived(marks, operator)
    for _ in range(FLOOD):
        flooder.put(key, b"junk")
    operator.put(KEEPALIVE, b"alive")
    arrived(marks, operator)
    for _ in range(FLOOD):
        flooder.put(key, b"junk")
    arrived(marks, flooder)
    came = []
    while (sample := keepalives.try_recv()) is not None:
        came.append(sample.payload.to_bytes())
    assert b"alive" in came
    assert len(came) < RING
