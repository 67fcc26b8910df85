import math
from hashlib import sha256

import pytest
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.protocols.messages import requests
from telerobot.tools.client.protocol_client import NoLease, ProtocolClient, RoundTrip

PUSH = (0.02, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.fixture
def client(daemon):
    return ProtocolClient("ann", "cell", daemon.put, daemon.ask)


@pytest.fixture
def holder(client):
    client.acquire(lambda reply: None)
    return client


def run(client, since_s, until_s):
    for ms in range(round(1000 * since_s), round(1000 * until_s)):
        client.run(ms / 1000)


def test_without_the_lease_nothing_is_sent_and_commands_say_so(client, daemon):
    run(client, 0.0, 1.0)
    with pytest.raises(NoLease, match="ann holds no lease"):
        client.command(t.JOYSTICK, twist=PUSH)
    with pytest.raises(NoLease):
        client.request(t.MODE, lambda reply: None, action="enable")
    assert daemon.heard == []


def test_the_lease_brings_a_secret_that_every_command_proves_and_none_carries(daemon):
    payloads = []
    client = ProtocolClient(
        "ann",
        "cell",
        lambda *sent: payloads.append(sent[1] + sent[2]) or daemon.put(*sent),
        lambda *sent: payloads.append(sent[1] + sent[3]) or daemon.ask(*sent),
    )
    client.acquire(lambda reply: None)
    client.command(t.CANCEL)
    client.request(t.MODE, lambda reply: None, action="hold")
    assert client.secret == daemon.secret
    assert [topic for topic, _ in daemon.proofs] == [t.CANCEL, t.MODE]  # judged by the daemon
    assert not any(client.secret in payload for payload in payloads)


def test_a_reply_without_a_usable_key_brings_no_lease(daemon):
    for key in (None, bytes(32)):
        reply = encode(requests.Reply(ok=True, key=key, epoch=1))
        heard = []

        def ask(topic, payload, answer, proof, reply=reply):
            answer(reply)

        client = ProtocolClient("ann", "cell", daemon.put, ask)
        client.acquire(heard.append)
        assert [r.reason for r in heard] == ["wrong_key"]
        assert client.secret is None


def test_a_refused_lease_is_told_and_not_held(client, daemon):
    daemon.refusals["operator/lease"] = "lease_taken"
    replies = []
    client.acquire(replies.append)
    assert [reply.reason for reply in replies] == ["lease_taken"]
    assert client.secret is None


def test_a_lease_is_kept_alive_ten_times_a_second(holder, daemon):
    run(holder, 0.0, 2.0)
    assert len(daemon.of(t.KEEPALIVE)) == 20


def test_a_stream_is_sent_a_hundred_times_a_second_with_its_newest_content(holder, daemon):
    holder.stream(t.JOYSTICK, twist=PUSH)
    run(holder, 0.0, 1.0)
    holder.stream(t.JOYSTICK, twist=(0.0,) * 6)
    run(holder, 1.0, 1.5)
    twists = [message.twist for message in daemon.of(t.JOYSTICK)]
    assert twists == [PUSH] * 100 + [(0.0,) * 6] * 50
    holder.end_stream(t.JOYSTICK)
    run(holder, 1.5, 2.0)
    assert len(daemon.of(t.JOYSTICK)) == 150


def test_a_stream_that_is_no_message_is_refused_at_once_and_the_one_before_goes_on(holder, daemon):
    holder.stream(t.JOYSTICK, twist=PUSH)
    for twist in ((0.0,) * 5, (math.nan,) * 6, ("fast",) * 6):
        with pytest.raises(ValueError, match="twist"):
            holder.stream(t.JOYSTICK, twist=twist)
    holder.run(0.0)
    assert [message.twist for message in daemon.of(t.JOYSTICK)] == [PUSH]


def test_after_a_pause_a_stream_goes_on_without_a_burst(holder, daemon):
    holder.stream(t.JOYSTICK, twist=PUSH)
    holder.run(0.0)
    holder.run(5.0)
    assert len(daemon.of(t.JOYSTICK)) == 2


def test_sequence_numbers_grow_and_tell_the_picture_they_are_based_on(holder, daemon, make_state):
    holder.command(t.CANCEL)
    holder.on_state(make_state(tick=7))
    holder.command(t.CANCEL)
    first, second = daemon.of(t.CANCEL)
    before, after = daemon.numbers(t.CANCEL)
    assert after > before
    assert (first.seen_tick, second.seen_tick) == (0, 7)


def test_anyone_may_ask_for_a_protective_stop(client, daemon):
    replies = []
    client.protective_stop(replies.append)
    assert replies[0].ok
    assert [stop.operator for stop in daemon.of(t.PROTECTIVE_STOP)] == ["ann"]


def test_each_protective_stop_has_a_seal_of_its_own_that_its_asker_opens(client, daemon):
    for _ in range(2):
        client.protective_stop(lambda reply: None)
    client.clear_protective_stop(lambda reply: None)
    client.clear_protective_stop(lambda reply: None)
    seals = [stop.seal for stop in daemon.of(t.PROTECTIVE_STOP)]
    opened = [sha256(clear.opens).digest() for clear in daemon.of(t.PROTECTIVE_CLEAR)]
    assert len(set(seals)) == 2
    assert opened == seals[::-1]


def test_who_holds_the_lease_clears_by_proof_and_shows_nothing(holder, daemon):
    holder.protective_stop(lambda reply: None)
    holder.clear_protective_stop(lambda reply: None)
    (clear,) = daemon.of(t.PROTECTIVE_CLEAR)
    assert clear.opens is None
    assert len(daemon.numbers(t.PROTECTIVE_CLEAR)) == 1


def test_giving_the_lease_back_ends_every_stream(holder, daemon):
    holder.stream(t.JOYSTICK, twist=PUSH)
    holder.release(lambda reply: None)
    holder.acquire(lambda reply: None)
    run(holder, 0.0, 1.0)
    assert len(daemon.of(t.RELEASE)) == 1
    assert daemon.of(t.JOYSTICK) == []


def test_a_mute_client_sends_nothing(holder, daemon):
    heard = len(daemon.heard)
    holder.mute = True
    holder.stream(t.JOYSTICK, twist=PUSH)
    run(holder, 0.0, 1.0)
    holder.command(t.CANCEL)
    holder.request(t.MODE, lambda reply: None, action="hold")
    assert len(daemon.heard) == heard


def test_a_round_trip_lasts_until_the_echo_of_what_was_sent():
    trip = RoundTrip()
    trip.sent("cmd/joystick", 1, 10.000)
    trip.sent("cmd/joystick", 2, 10.010)
    trip.echoed({}, 10.015)
    assert trip.seconds is None
    trip.echoed({"cmd/joystick": 1}, 10.022)
    assert trip.seconds == pytest.approx(0.022)
    trip.echoed({"cmd/joystick": 1}, 10.5)
    assert trip.seconds == pytest.approx(0.022), "an echo that is repeated measures nothing"
    trip.echoed({"cmd/joystick": 2, "cmd/jog": 9}, 10.6)
    assert trip.seconds == pytest.approx(0.590)


def test_a_command_that_was_passed_over_measures_nothing():
    trip = RoundTrip()
    trip.sent("cmd/joystick", 1, 1.0)
    trip.sent("cmd/joystick", 2, 2.0)
    trip.echoed({"cmd/joystick": 2}, 2.5)
    assert trip.seconds == pytest.approx(0.5)
