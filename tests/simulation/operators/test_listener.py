"""A peer that hears all commands and requests, and sends what it likes of them, gains nothing."""

import msgpack
import pytest
from telerobot.protocols import topics as t
from telerobot.server.operators.link import MemoryLink
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import STICK

FAST = [0.2, 0.2, 0.2, 0.0, 0.0, 0.5]


class Listener:
    """Hears what operators put and ask; sends it again, and altered, a tick later."""

    def __init__(self, monkeypatch):
        self.heard = []
        put, ask = MemoryLink.put, MemoryLink.ask

        def heard_put(link, topic, payload, proof=b""):
            self.heard.append((put, topic, payload, proof))
            put(link, topic, payload, proof)

        def heard_ask(link, topic, payload, answer, proof=b""):
            self.heard.append((ask, topic, payload, proof))
            ask(link, topic, payload, answer, proof)

        monkeypatch.setattr(MemoryLink, "put", heard_put)
        monkeypatch.setattr(MemoryLink, "ask", heard_ask)
        self.attacks = self.since = 0

    def attack(self, simulation):
        """Send what was heard in this tick once more, in three ways, and the oldest of all."""
        news, self.since = self.heard[self.since :], len(self.heard)
        for send, topic, payload, proof in (*news, *self.heard[:1]):
            if topic is t.LEASE:
                continue  # anyone may ask for a lease that is free, with a key of its own
            fields = msgpack.unpackb(payload)
            if "twist" in fields:
                fields["twist"] = FAST
            altered = msgpack.packb(fields)
            later = (int.from_bytes(proof[8:16], "big") + 1000).to_bytes(8, "big")
            for said, attached in (
                (payload, proof),
                (altered, proof),
                (altered, proof[:8] + later + proof[16:]),
            ):
                answer = (lambda reply: None,) if topic in t.REQUESTS else ()
                send(simulation.link, topic, said, *answer, attached)
                self.attacks += 1


def play(cell, steps, listener=None, seconds=2.5):
    script = Script.model_validate({"duration_s": seconds, "step": steps})
    simulation = Simulation(cell, script)
    if listener is not None:
        simulation.on_tick = listener.attack
    return simulation, simulation.run()


def test_replayed_altered_and_renumbered_commands_move_nothing(pa10, monkeypatch):
    steps = [
        {"at_s": 0.3, "cmd/joystick": STICK},
        {"at_s": 1.0, "operator/speed": {"factor": 0.5}},
        {"at_s": 1.2, "operator/mode": {"action": "hold"}},
        {"at_s": 1.7, "operator/mode": {"action": "resume"}},
        {"at_s": 1.9, "cmd/joystick": STICK},
    ]
    _, alone = play(pa10, steps)
    listener = Listener(monkeypatch)
    simulation, heard = play(pa10, steps, listener)
    assert listener.attacks > 500
    assert heard.summary["command_hash"] == alone.summary["command_hash"]
    assert {e.values["reason"] for e in simulation.events if e.name == "command_refused"} <= {
        "out_of_order",
        "wrong_proof",
    }


def test_a_silent_operators_lease_is_not_kept_alive_by_what_it_once_said(pa10, monkeypatch):
    steps = [{"at_s": 0.3, "cmd/joystick": STICK}, {"at_s": 1.0, "link": {"cut": True}}]
    listener = Listener(monkeypatch)
    simulation, result = play(pa10, steps, listener)
    assert [e.name for e in simulation.events if e.name == "lease_expired"] == ["lease_expired"]
    assert result.states[-1].lease_holder is None
    assert result.summary["mode"] == "hold"


@pytest.mark.parametrize("seq", [10**6, 2**63 - 1, 2**64 - 1])
def test_the_holder_is_not_locked_out_by_numbers_that_it_never_sent(pa10, seq):
    steps = [{"at_s": 0.3, "cmd/joystick": STICK}]
    _, alone = play(pa10, steps, seconds=1.0)
    script = Script.model_validate({"duration_s": 1.0, "step": steps})
    simulation = Simulation(pa10, script)
    forged = (1).to_bytes(8, "big") + seq.to_bytes(8, "big") + bytes(16)

    def lock_out(simulation):
        for topic in t.COMMANDS:
            simulation.link.put(topic, b"", forged)

    simulation.on_tick = lock_out
    assert simulation.run().summary["command_hash"] == alone.summary["command_hash"]
