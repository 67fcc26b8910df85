import pytest
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.protocols.messages import messages as m
from telerobot.protocols.messages import requests
from telerobot.protocols.proof import KeyPair, Proof, prove
from telerobot.server.operators.admission import Admission, Grants, Instant
from telerobot.server.refusals import Refused, Why

ANNS, BOBS = b"a" * 32, b"b" * 32
NOW = Instant(time_s=100.0, tick=1000, enabled_since=900)


@pytest.fixture
def admission():
    """Half a second of command age, at 10 ms; ann holds the lease since just now."""
    admission = Admission("cell", 0.01, 0.5, 0.5)
    admission.grant("ann", ANNS, NOW)
    return admission


def command(topic=t.JOYSTICK, seen_tick=998, seq=5, epoch=1, secret=ANNS, payload=None):
    """Return a payload and its proof."""
    fields = {
        t.JOYSTICK: {"twist": (0.1, 0, 0, 0, 0, 0)},
        t.POSITION: {"xyz": (0, 0, 0), "rpy": (0, 0, 0)},
        t.MODE: {"action": "enable"},
        t.SPEED: {"factor": 0.5},
    }.get(topic, {})
    if payload is None:
        payload = encode(topic.message(seen_tick=seen_tick, **fields))
    return payload, prove(secret, topic.full_key("cell"), epoch, seq, payload)


def admit(admission, sent, now=NOW, topic=t.JOYSTICK):
    payload, attached = sent
    proof = admission.prove(topic, payload, attached, now)
    return admission.admit(topic, payload, proof, now)


def refusal(admission, sent, now=NOW, topic=t.JOYSTICK):
    before = dict(admission.last_seq), admission.age_ticks
    with pytest.raises(Refused) as caught:
        admit(admission, sent, now, topic)
    assert (admission.last_seq, admission.age_ticks) == before
    assert caught.value.detail
    assert ANNS.hex() not in caught.value.detail
    return caught.value.reason


def test_what_the_holder_sends_in_time_is_admitted_and_noted(admission):
    message = admit(admission, command())
    assert isinstance(message, m.JoystickTwist)
    assert message.twist[0] == 0.1
    assert admission.last_seq == {t.JOYSTICK.key: 5}
    assert admission.age_ticks == 2


@pytest.mark.parametrize(
    ("changes", "now", "reason"),
    [
        ({}, Instant(100.5, 1000, 900), Why.NO_LEASE),
        ({"secret": BOBS}, NOW, Why.WRONG_PROOF),
        ({"epoch": 0}, NOW, Why.OLD_EPOCH),
        ({"epoch": 2}, NOW, Why.OLD_EPOCH),
        ({"seen_tick": 949}, NOW, Why.OLD_PICTURE),
        ({"seen_tick": 1001}, NOW, Why.FUTURE_PICTURE),
        ({"seen_tick": 998}, Instant(100.0, 1000, 999), Why.BEFORE_ENABLE),
        ({}, Instant(100.0, 1000, None), Why.NOT_ENABLED),
    ],
)
def test_each_reason_to_refuse(admission, changes, now, reason):
    assert refusal(admission, command(**changes), now) == reason


def test_at_its_very_limits_a_command_is_still_admitted(admission):
    admit(admission, command(seq=0, seen_tick=950))
    assert admission.age_ticks == 50
    admit(admission, command(seq=1, seen_tick=1000))
    admit(admission, command(seq=2), Instant(100.499, 1000, 998))


@pytest.mark.parametrize("seq", [0, 4, 5])
def test_what_comes_twice_or_out_of_order_is_refused(admission, seq):
    admit(admission, command())
    assert refusal(admission, command(seq=seq)) == Why.OUT_OF_ORDER


def test_order_is_kept_for_each_topic_on_its_own(admission):
    admit(admission, command(seq=50))
    admit(admission, command(t.POSITION, seq=1), topic=t.POSITION)
    assert admission.last_seq == {t.JOYSTICK.key: 50, t.POSITION.key: 1}


@pytest.mark.parametrize("topic", [t.KEEPALIVE, t.MODE, t.SPEED])
def test_keepalives_and_requests_need_the_lease_but_no_enabled_arm(admission, topic):
    admit(admission, command(topic), Instant(100.0, 1000, None), topic)
    guess = command(topic, seq=6, secret=BOBS)
    assert refusal(admission, guess, NOW, topic) == Why.WRONG_PROOF


def test_a_link_that_delivers_everything_in_order_and_late_is_noticed(admission):
    for tick in range(1000, 1100):
        admission.renew(Instant(100.0, tick, 900))
        payload = command(seq=tick, seen_tick=tick - 60)
        assert refusal(admission, payload, Instant(100.0, tick, 900)) == Why.OLD_PICTURE


def test_bytes_that_are_no_message_are_refused_by_the_codecs_name(admission):
    assert refusal(admission, command(payload=b"\xc1")) == "not_messagepack"
    assert refusal(admission, command(payload=b"", seq=6)) == "not_messagepack"


def test_nothing_is_decoded_that_is_not_proven(admission):
    """What no decoder could read is refused for its proof, whatever is wrong with that."""
    payload, proof = command(payload=b"\xc1")
    for attached in (b"", proof[:-1], proof + b"x", proof[:-1] + bytes([proof[-1] ^ 1])):
        assert refusal(admission, (payload, attached)) == Why.WRONG_PROOF
    with pytest.raises(Refused) as caught:
        admission.admit(t.JOYSTICK, payload, None, NOW)
    assert caught.value.reason == Why.WRONG_PROOF


def test_no_part_of_a_command_can_be_altered_or_moved_to_another_key(admission):
    payload, proof = command(t.KEEPALIVE, seq=7)
    for i in range(len(proof)):
        changed = bytes([*proof[:i], proof[i] ^ 1, *proof[i + 1 :]])
        assert refusal(admission, (payload, changed), topic=t.KEEPALIVE)
    for i in range(len(payload)):
        changed = bytes([*payload[:i], payload[i] ^ 1, *payload[i + 1 :]])
        assert refusal(admission, (changed, proof), topic=t.KEEPALIVE) == Why.WRONG_PROOF
    for topic in (*t.COMMANDS, *t.REQUESTS):
        if topic is not t.KEEPALIVE:
            assert refusal(admission, (payload, proof), topic=topic) == Why.WRONG_PROOF
    admit(admission, (payload, proof), topic=t.KEEPALIVE)


def test_a_command_that_was_heard_is_of_no_use_even_if_it_was_refused(admission):
    early = command(seen_tick=999)
    assert refusal(admission, early, Instant(100.0, 1000, None)) == Why.NOT_ENABLED
    assert refusal(admission, early, Instant(100.0, 1000, 999)) == Why.OUT_OF_ORDER


def test_no_forged_number_locks_the_holder_out_nor_one_of_its_own(admission):
    admit(admission, command(seq=5))
    forged = command(seq=2**63 - 1, secret=BOBS)
    assert refusal(admission, forged) == Why.OUT_OF_ORDER
    for leap in (2**63 - 1, 2**64 - 1, 6 + 2**20):
        assert refusal(admission, command(seq=leap)) == Why.OUT_OF_ORDER
    admit(admission, command(seq=5 + 2**20))
    admit(admission, command(seq=6 + 2**20))


def test_a_lease_may_begin_with_any_number_but_an_absurd_one(admission):
    for absurd in (2**63 - 1, 2**48 + 1):
        assert refusal(admission, command(seq=absurd)) == Why.OUT_OF_ORDER
    admit(admission, command(seq=2**48))
    # keys have an order of their own, but one measure of a leap
    admit(admission, command(t.KEEPALIVE, seq=2**48 + 1), topic=t.KEEPALIVE)


def test_a_lease_that_begins_with_zero_leaps_as_far_as_any_other(admission):
    admit(admission, command(seq=0))
    assert refusal(admission, command(seq=1 + 2**20)) == Why.OUT_OF_ORDER
    admit(admission, command(seq=2**20))


def test_where_commands_are_to_be_newer_than_a_period_one_period_is_allowed():
    admission = Admission("cell", 0.01, 0.001, 0.5)
    admission.grant("ann", ANNS, NOW)
    admit(admission, command(seq=0, seen_tick=999))
    assert refusal(admission, command(seq=1, seen_tick=998)) == Why.OLD_PICTURE


def test_while_nobody_holds_the_lease_nothing_is_proven():
    """Not even by who knows that nobody's secret is empty."""
    admission = Admission("cell", 0.01, 0.5, 0.5)
    payload, proof = command(secret=b"", epoch=0)
    with pytest.raises(Refused) as caught:
        admission.prove(t.JOYSTICK, payload, proof, NOW)
    assert caught.value.reason == Why.NO_LEASE
    admission.grant("ann", ANNS, NOW)
    payload, proof = command()
    with pytest.raises(Refused) as caught:
        admission.prove(t.JOYSTICK, payload, proof, Instant(100.5, 1050, 900))
    assert caught.value.reason == Why.NO_LEASE


def test_what_was_proven_before_the_lease_changed_hands_within_the_tick_is_of_no_use(admission):
    payload, attached = command(t.KEEPALIVE)
    proof = admission.prove(t.KEEPALIVE, payload, attached, NOW)
    assert admission.holds(proof, NOW)
    admission.end()
    assert not admission.holds(proof, NOW)
    with pytest.raises(Refused) as caught:
        admission.admit(t.KEEPALIVE, payload, proof, NOW)
    assert caught.value.reason == Why.NO_LEASE
    admission.grant("bob", BOBS, NOW)
    assert not admission.holds(proof, NOW)
    with pytest.raises(Refused) as caught:
        admission.admit(t.KEEPALIVE, payload, proof, NOW)
    assert caught.value.reason == Why.OLD_EPOCH


def test_only_a_proof_of_a_lease_that_is_alive_is_the_holders(admission):
    proof = Proof(1, 5, bytes(16))
    assert admission.holds(proof, NOW)
    assert not admission.holds(None, NOW)
    assert not admission.holds(Proof(2, 5, bytes(16)), NOW)
    assert not admission.holds(proof, Instant(100.5, 1050, 900))


@pytest.mark.parametrize("proof", [None, Proof(1, 5, bytes(16))])
def test_what_is_no_command_is_read_with_or_without_a_proof_and_renews_nothing(admission, proof):
    payload = encode(requests.LeaseRequest(operator="bob", key=KeyPair(BOBS).public))
    late = Instant(100.4, 1040, 900)
    message = admission.admit(t.LEASE, payload, proof, late)
    assert isinstance(message, requests.LeaseRequest)
    assert admission.lease.expires_s == pytest.approx(100.5)
    assert admission.last_seq == {}
    assert admission.age_ticks is None


def test_with_its_lease_the_order_of_what_somebody_sent_is_forgotten(admission):
    admit(admission, command(seq=70))
    admission.end()
    assert admission.last_seq == {}
    admission.grant("ann", ANNS, NOW)
    assert admission.age_ticks is None
    admit(admission, command(seq=3, epoch=2))


@pytest.mark.parametrize("topic", [t.KEEPALIVE, t.JOYSTICK, t.SPEED], ids=lambda x: x.key)
def test_whatever_is_proven_and_recent_renews_the_lease(admission, topic):
    late = Instant(100.4, 1040, 900)
    admit(admission, command(topic, seen_tick=1040), late, topic)
    assert admission.lease.alive(100.89)
    assert not admission.lease.alive(100.91)


@pytest.mark.parametrize("seen_tick", [989, 1041])
def test_what_was_late_on_its_way_renews_nothing(admission, seen_tick):
    late = Instant(100.4, 1040, 900)
    assert refusal(admission, command(t.KEEPALIVE, seen_tick=seen_tick), late, t.KEEPALIVE)
    assert not admission.lease.alive(100.5)


def test_while_a_lease_lives_nobody_else_gets_one(admission):
    with pytest.raises(Refused) as caught:
        admission.grant("bob", BOBS, NOW)
    assert caught.value.reason == Why.LEASE_TAKEN
    assert caught.value.detail == "ann holds the lease for 0.50 s more"
    admission.renew(Instant(100.4, 1040, 900))
    with pytest.raises(Refused):
        admission.grant("bob", BOBS, Instant(100.8, 1080, 900))


def test_after_it_ran_out_or_was_given_back_the_next_one_gets_a_new_epoch(admission):
    admit(admission, command(seq=70))
    lease = admission.grant("bob", BOBS, Instant(100.5, 1050, 900))
    assert (lease.holder, lease.epoch) == ("bob", 2)
    late = Instant(100.5, 1050, 900)
    assert refusal(admission, command(seq=71, seen_tick=1049), late) == Why.OLD_EPOCH
    assert refusal(admission, command(seq=71, seen_tick=1049, epoch=2), late) == Why.WRONG_PROOF
    # Its sequence numbers begin anew.
    admit(admission, command(seq=0, seen_tick=1049, epoch=2, secret=BOBS), late)
    admission.end()
    assert admission.grant("ann", ANNS, late).epoch == 3


# --- the secret that is agreed --------------------------------------------------------------------

ANNS_PAIR, DAEMONS = KeyPair(b"k" * 32), b"d" * 32


@pytest.fixture
def free():
    """A desk whose lease was held once."""
    admission = Admission("cell", 0.01, 0.5, 0.5)
    admission.grant("bob", BOBS, NOW)
    admission.end()
    return admission


def test_who_asks_for_the_lease_can_prove_it_by_what_the_reply_says(free):
    grants = Grants("cell", free, lambda: DAEMONS)
    assert free.require_free(NOW) == 2
    reply = grants.grant(requests.LeaseRequest(operator="ann", key=ANNS_PAIR.public), NOW)
    assert (reply.ok, reply.tick, reply.epoch) == (True, NOW.tick, 2)
    assert reply.key == KeyPair(DAEMONS).public
    assert (free.lease.holder, free.lease.epoch) == ("ann", 2)
    secret = ANNS_PAIR.agree_with_daemon(reply.key, t.LEASE.full_key("cell"), reply.epoch)
    assert secret.hex() not in repr(reply)
    admit(free, command(secret=secret, epoch=reply.epoch))


def test_an_unusable_key_gets_no_lease_and_a_lease_that_lives_no_second_one(free):
    grants = Grants("cell", free, lambda: DAEMONS)
    with pytest.raises(Refused) as caught:
        grants.grant(requests.LeaseRequest(operator="ann", key=bytes(32)), NOW)
    assert caught.value.reason == Why.WRONG_KEY
    assert not free.lease.alive(NOW.time_s)
    asked = requests.LeaseRequest(operator="ann", key=ANNS_PAIR.public)
    grants.grant(asked, NOW)
    with pytest.raises(Refused) as caught:
        grants.grant(asked, NOW)
    assert caught.value.reason == Why.LEASE_TAKEN
