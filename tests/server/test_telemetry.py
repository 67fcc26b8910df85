"""What a daemon tells over Zenoh, to a session of its own on this machine."""

import socket
from collections import Counter

import pytest
import zenoh
from telerobot.drivers.network.sessions import client_config
from telerobot.protocols import codec
from telerobot.protocols import topics as t
from telerobot.protocols.codec import decode
from telerobot.protocols.messages.telemetry import Description
from telerobot.server.operators import link as links
from telerobot.server.operators.link import MemoryLink, ZenohLink
from telerobot.server.recorder import BlackBox
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation import simulation as simulated

TRIES = 2000


class Network(MemoryLink):
    """Tells over Zenoh what a simulated daemon tells, and counts it, in messages."""

    def __init__(self, link: ZenohLink) -> None:
        super().__init__()
        self._link, self.sent = link, Counter()

    def publish(self, topic, message):
        self.sent[topic] += 1
        self._link.publish(topic, message)

    def heard(self, topic):
        return self._link.heard(topic)


@pytest.fixture
def daemon(pa10, monkeypatch, tmp_path):
    """Return a simulated daemon with a black box, its network, and a session that dials it."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    link = ZenohLink("pa10", endpoint)
    network = Network(link)
    monkeypatch.setattr(simulated, "MemoryLink", lambda: network)
    script = Script.model_validate({"duration_s": 1.0, "step": []})
    box = BlackBox(tmp_path, "pa10", "", {})
    simulation = simulated.Simulation(pa10.cell, script, box=box)
    simulation.cycle.publish_ticks()
    simulation.cycle.boot()
    with zenoh.open(client_config(endpoint)) as peer:
        yield simulation, network, peer
    simulation.close()
    link.close()


def test_nothing_but_events_is_told_while_nobody_listens_and_the_box_has_every_tick(daemon):
    simulation, network, _ = daemon
    for _ in range(50):
        simulation.step()
    assert set(network.sent) == {t.EVENT}
    assert len(simulation.cycle.flight.log.rows) == 50


@pytest.fixture
def seldom(monkeypatch):
    """Let no description be due in this test but the one to who begins to listen."""
    every = t.Topic.every
    monkeypatch.setattr(
        t.Topic, "every", lambda topic, T: 100_000 if topic is t.DESCRIPTION else every(topic, T)
    )


def test_who_begins_to_listen_to_all_keys_has_state_and_description_at_once(seldom, daemon):
    simulation, network, peer = daemon
    told = {t.STATE, t.DESCRIPTION, t.TICK}
    simulation.step()
    every = peer.declare_subscriber("telerobot/pa10/**", zenoh.handlers.RingChannel(100))
    for _ in range(TRIES):
        simulation.step()
        if told <= network.sent.keys():
            break
    assert network.sent[t.DESCRIPTION] == 1
    found = {}
    while not told <= found.keys():
        sample = every.recv()
        topic = next(x for x in t.TOPICS if x.full_key("pa10") == str(sample.key_expr))
        found[topic] = decode(topic, sample.payload.to_bytes())
    first = found[t.STATE].tick
    assert first <= simulation.cycle.tick
    for _ in range(TRIES):
        simulation.step()
        sample = every.try_recv()
        if sample is not None and str(sample.key_expr) == t.STATE.full_key("pa10"):
            newest = decode(t.STATE, sample.payload.to_bytes()).tick
            if newest > first:
                break
    assert newest > first
    assert found[t.DESCRIPTION].cell == "pa10"


def test_a_description_goes_seldom_to_who_listens_and_to_nobody_who_left(daemon, monkeypatch):
    simulation, network, peer = daemon
    encoded = Counter()

    def encode(message):
        encoded[type(message)] += 1
        return codec.encode(message)

    monkeypatch.setattr(links, "encode", encode)
    listener = peer.declare_subscriber(t.DESCRIPTION.full_key("pa10"))
    for _ in range(TRIES):
        simulation.step()
        if network.sent[t.DESCRIPTION]:
            break
    network.sent.clear()
    for _ in range(100):
        simulation.step()
    assert network.sent[t.DESCRIPTION] == 5
    assert encoded[Description] == 1
    listener.undeclare()
    for _ in range(TRIES):
        network.sent.clear()
        for _ in range(20):
            simulation.step()
        if not network.sent[t.DESCRIPTION]:
            break
    assert not network.sent[t.DESCRIPTION]
    assert not network.sent[t.STATE]
