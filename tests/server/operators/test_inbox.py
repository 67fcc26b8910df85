"""Junk in any amount costs little, and takes nothing from the lease's holder.

Work is counted, and time is virtual: it passes by what each piece of work is said to cost.
"""

import os
import random

import msgpack
import pytest
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.protocols.messages import messages as m
from telerobot.protocols.messages import requests
from telerobot.protocols.messages.perception import FrameNews
from telerobot.protocols.proof import prove
from telerobot.server.operators.admission import Admission, Instant
from telerobot.server.operators.inbox import ANSWERED, PART, Inbox
from telerobot.server.operators.link import RING, MemoryLink, room
from telerobot.server.operators.link import RawMessage as Asked
from telerobot.server.refusals import Why

CELL, SECRET, PERIOD_S = "cell", b"s" * 32, 0.01
NEEDS_PROOF = [x for x in (*t.COMMANDS, *t.REQUESTS) if x.needs_proof]


class Clock:
    """Time that passes only by work."""

    def __init__(self):
        self.time_s = 100.0

    def __call__(self):
        return self.time_s


class Parcel(bytes):
    """A payload whose copying is counted and takes time."""

    copied = 0
    clock = None
    cost_s = 0.0

    def __bytes__(self):
        type(self).copied += len(self)
        if self.clock is not None:
            self.clock.time_s += self.cost_s
        return bytes.__getitem__(self, slice(None))


class Huge:
    """A payload of 100 MB that nobody may copy."""

    def __len__(self):
        return 100_000_000

    def __bytes__(self):
        raise AssertionError("copied")


class Network:
    """The reception with a lease's holder and others before it."""

    def __init__(self, parcel):
        self.clock, self.link = Clock(), MemoryLink()
        self.admission = Admission(CELL, PERIOD_S, 0.5, 0.5)
        self.inbox = Inbox(self.link, self.admission, self.clock, PERIOD_S)
        self.parcel, self.tick, self.seq, self.answers = parcel, 0, 0, []
        self.admission.grant("ann", SECRET, self.now)

    @property
    def now(self):
        return Instant(self.clock.time_s, self.tick, 0)

    def send(self, topic, payload, proof=b""):
        if topic in t.REQUESTS:
            self.link.ask(topic, payload, self.answers.append, proof)
        else:
            self.link.put(topic, payload, proof)

    def hold(self, topic, **fields):
        """Send as the lease's holder; return the proof, by which it is known again."""
        self.seq += 1
        payload = encode(topic.message.model_construct(seen_tick=self.tick, **fields))
        key, epoch = topic.full_key(CELL), self.admission.lease.epoch
        proof = prove(SECRET, key, epoch, self.seq, payload)
        self.send(topic, self.parcel(payload), proof)
        return payload, proof

    def sort(self):
        self.admission.renew(self.now)
        self.inbox.sort(self.now)

    def turn(self):
        """Take in what has come in one tick; return the letters."""
        self.tick += 1
        self.sort()
        messages = [
            *self.inbox.requests(),
            *self.inbox.commands(),
            *self.inbox.sensors(),
        ]
        self.refusals = self.inbox.refusals()
        return messages

    def of(self, topic):
        return [queued for queued in self.turn() if queued.topic is topic]


@pytest.fixture
def network():
    class Counted(Parcel):
        copied = 0

    made = Network(Counted)
    Counted.clock = made.clock
    return made


def junk_of(kind, rng, heard):
    """Return a payload and a proof such as a stranger may make, who heard some messages."""
    if kind == "random":
        return rng.randbytes(rng.randrange(300)), rng.randbytes(rng.choice([0, 16, 32, 33]))
    if kind == "forged":
        seq = rng.choice([1, 10**5, 2**63 - 1]) + rng.randrange(1000)
        numbers = (1).to_bytes(8, "big") + seq.to_bytes(8, "big")
        return encode(m.Keepalive(seen_tick=0)), numbers + rng.randbytes(16)
    if kind == "replayed":
        return rng.choice(heard)
    payload, proof = rng.choice(heard)  # renumbered
    later = (int.from_bytes(proof[8:16], "big") + rng.randrange(1, 2000)).to_bytes(8, "big")
    return payload, proof[:8] + later + proof[16:]


@pytest.mark.parametrize("topic", [t.MODE, t.LEASE, t.JOYSTICK], ids=lambda x: x.key)
def test_what_raises_as_it_is_read_is_refused_and_the_next_is_taken(network, monkeypatch, topic):
    def fail(*_):
        raise KeyError("left out")

    with monkeypatch.context() as broken:
        broken.setattr(Admission, "prove" if topic.needs_proof else "admit", fail)
        assert network.send(topic, b"\xc1", b"p" * 32) is None
        assert network.turn() == []
    (refusal,) = network.refusals
    assert refusal.refused.reason is Why.HANDLER_RAISED
    assert len(refusal.answers) == (topic in t.REQUESTS)
    mine, _ = network.hold(t.MODE, action="hold")
    assert [queued.payload for queued in network.of(t.MODE)] == [mine]


@pytest.mark.parametrize("kind", ["random", "forged", "replayed", "renumbered"])
@pytest.mark.parametrize("topic", [t.KEEPALIVE, t.JOYSTICK, t.MODE], ids=lambda x: x.key)
def test_no_junk_pushes_out_what_the_holder_sent(network, kind, topic):
    """10,000 a second on one key: 100 between two ticks, and all of the holder's arrive."""
    rng = random.Random(7)
    fields = {t.JOYSTICK: {"twist": (0.0,) * 6}, t.MODE: {"action": "hold"}}.get(topic, {})
    heard = [network.hold(topic, **fields)]
    assert len(network.of(topic)) == 1
    for _ in range(50):
        mine = network.hold(topic, **fields)
        for _ in range(100):
            network.send(topic, *junk_of(kind, rng, heard))
        assert [queued.payload for queued in network.of(topic)] == [mine[0]]
        heard.append(mine)


def test_junk_that_crowds_out_every_keepalive_does_not_end_the_lease_of_who_steers(network):
    """Twice a ring of junk after each keepalive, for two leases' time, and a stick at 100 Hz."""
    rng = random.Random(7)
    for tick in range(100):
        network.tick, network.clock.time_s = tick, 100.0 + tick * PERIOD_S
        network.hold(t.KEEPALIVE)
        network.hold(t.JOYSTICK, twist=(0.0,) * 6)
        for _ in range(2 * RING):
            network.send(t.KEEPALIVE, *junk_of("forged", rng, ()))
        network.inbox.sort(network.now)
        for queued in network.inbox.commands():
            assert queued.topic is t.JOYSTICK
            network.admission.admit(queued.topic, queued.payload, queued.proof, network.now)
    assert network.admission.lease.alive(network.now.time_s)


def test_what_waits_in_the_mailbox_is_not_pushed_out_by_junk_that_comes_after_it(network):
    """Between two ticks the rings are emptied more than once: that is as often as junk likes."""
    network.hold(t.KEEPALIVE)
    for _ in range(20):
        network.sort()
        for _ in range(RING):
            network.send(t.KEEPALIVE, os.urandom(40), os.urandom(32))
    assert len(network.of(t.KEEPALIVE)) == 1


def test_a_payload_that_is_too_long_is_never_copied(network):
    for topic in (*t.COMMANDS, *t.SENSORS, *t.REQUESTS):
        network.send(topic, Huge(), os.urandom(32))
        network.send(topic, Huge())
    assert network.turn() == []
    assert {str(refusal.refused.reason) for refusal in network.refusals} == {"too_large"}
    assert len(network.refusals) == len(t.COMMANDS) + len(t.SENSORS) + len(t.REQUESTS)


def test_a_proof_that_is_too_long_is_never_copied(network):
    network.send(t.KEEPALIVE, encode(m.Keepalive(seen_tick=0)), Huge())
    assert network.turn() == []
    assert [refusal.refused.reason for refusal in network.refusals] == [Why.WRONG_PROOF]


def test_nothing_is_decoded_that_needs_a_proof_and_has_none(network, monkeypatch):
    decoded = []
    monkeypatch.setattr(
        "telerobot.server.operators.admission.decode_as",
        lambda kind, _payload, _most: decoded.append(kind),
    )
    rng = random.Random(3)
    for topic in NEEDS_PROOF:
        for kind in ("random", "forged"):
            for _ in range(50):
                network.send(topic, *junk_of(kind, rng, ()))
    assert network.turn() == []
    assert decoded == []


def test_the_bytes_looked_at_in_a_tick_are_bounded_by_what_messages_can_be(network):
    for topic in (*t.COMMANDS, *t.SENSORS, *t.REQUESTS):
        for size in range(0, 16_000, 100):
            network.send(topic, network.parcel(size))
    network.turn()
    rings = sum(room(x) * x.max_bytes for x in (*t.COMMANDS, *t.SENSORS, *t.REQUESTS))
    assert 0 < network.parcel.copied < rings
    network.parcel.copied = 0
    network.turn()
    assert network.parcel.copied == 0


@pytest.mark.parametrize("cost_s", [1e-6, 1e-5, 1e-4])
def test_junk_on_every_key_takes_no_more_than_its_budget_and_the_holder_is_heard(network, cost_s):
    network.parcel.cost_s = cost_s
    for tick in range(30):
        mine = network.hold(t.KEEPALIVE)
        for topic in (*t.COMMANDS, *t.SENSORS, *t.REQUESTS):
            for _ in range(20):
                network.send(topic, network.parcel(b"\xc1" * 8), os.urandom(32))
        start_s = network.clock.time_s
        messages = network.turn()
        spent_s = network.clock.time_s - start_s
        assert [x.payload for x in messages if x.topic is t.KEEPALIVE] == [mine[0]], tick
        # the four first topics completely, and what was begun when a budget ended
        assert spent_s <= 4 * 21 * cost_s + 2 * PART * PERIOD_S + 2 * cost_s


def test_under_a_flood_on_all_keys_the_holder_is_heard_on_each(network):
    """What is cut off by the budget in one tick comes first in a later one."""
    network.parcel.cost_s = 1e-4  # ten messages to a budget
    waiting = {t.CANCEL.key, t.FORCE.key, t.SPEED.key, t.TARE.key}
    for _ in range(60):
        for topic in (*t.COMMANDS, *t.REQUESTS):
            for _ in range(10):
                network.send(topic, network.parcel(b"\xc1" * 8), os.urandom(32))
        for topic, fields in (
            (t.CANCEL, {}),
            (t.FORCE, {"wrench": (0.0,) * 6}),
            (t.SPEED, {"factor": 0.5}),
            (t.TARE, {}),
        ):
            network.hold(topic, **fields)
        waiting -= {queued.topic.key for queued in network.turn()}
    assert waiting == set()


def test_no_sensors_flood_starves_another_sensor(network):
    network.parcel.cost_s = 2e-4  # five messages to a budget
    news = FrameNews(name="base", tick=1, xyz=(0, 0, 0), rpy=(0, 0, 0))
    for _ in range(10):
        for _ in range(100):
            network.send(t.OBSTACLE, network.parcel(b"junk"))
        network.send(t.FRAME_NEWS, network.parcel(encode(news)))
        assert len(network.of(t.FRAME_NEWS)) == 1


def test_what_the_holder_sends_beyond_the_budget_waits_and_keeps_its_order(network):
    for _ in range(4):
        network.hold(t.POSITION, xyz=(0, 0, 0), rpy=(0, 0, 0))
        network.hold(t.CANCEL)
    taken = []
    for _ in range(4):
        network.tick += 1
        network.sort()
        for queued in network.inbox.commands():
            taken.append(queued.proof.seq)
            network.clock.time_s += 0.6 * PART * PERIOD_S  # what it costs to act on it
    assert taken == list(range(1, 9))


def test_within_a_tick_requests_are_taken_as_they_were_sent_and_a_stop_wins(network):
    network.send(t.PROTECTIVE_STOP, encode(requests.ProtectiveStop(operator="bystander")))
    network.send(t.LEASE, encode(requests.LeaseRequest(operator="bob", key=b"k" * 32)))
    network.hold(t.SPEED, factor=0.5)
    network.hold(t.MODE, action="resume")
    network.hold(t.RELEASE)
    keys = [queued.topic for queued in network.turn()]
    assert keys == [t.SPEED, t.MODE, t.RELEASE, t.LEASE, t.PROTECTIVE_STOP]


def test_a_stop_is_heard_among_junk_on_its_own_key(network):
    for _ in range(50):
        network.send(t.PROTECTIVE_STOP, b"\xc1")
    network.send(t.PROTECTIVE_STOP, encode(requests.ProtectiveStop(operator="bystander")))
    for _ in range(50):
        network.send(t.PROTECTIVE_STOP, msgpack.packb({"v": 2, "operator": 7}))
    assert len(network.of(t.PROTECTIVE_STOP)) == 1


def test_few_refused_requests_are_answered_and_none_is_kept(network):
    for _ in range(20):
        ended = []
        for topic in t.REQUESTS:
            for _ in range(RING):
                parcel = Asked(b"junk", os.urandom(32), ended.append)
                network.link._ring(topic).append(parcel)
        network.turn()
        answers = [answer for refusal in network.refusals for answer in refusal.answers]
        assert 0 < len(answers) <= ANSWERED
        assert ended == [None] * (len(t.REQUESTS) * RING - len(answers))


def test_a_flood_is_told_in_one_entry_for_each_key_and_looked_at_more_often(network):
    network.hold(t.KEEPALIVE)
    network.turn()
    assert not network.inbox.pressed
    for _ in range(100):
        network.send(t.KEEPALIVE, b"junk")
    network.turn()
    (refusal,) = network.refusals
    assert (refusal.topic, refusal.count) == (t.KEEPALIVE, 100)
    assert refusal.refused.reason == Why.WRONG_PROOF
    assert network.inbox.pressed
    network.turn()
    assert not network.inbox.pressed
