import pytest
from telerobot.protocols import messages as m
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.server.admission import Admission, Now, Refused, Why

NOW = Now(time_s=100.0, tick=1000, enabled_since=900)


@pytest.fixture
def admission():
    """Half a second of command age, at 10 ms; ann holds the lease since just now."""
    admission = Admission(0.01, 0.5, 0.5)
    admission.grant("ann", "secret", NOW)
    return admission


def command(topic=t.JOYSTICK, **changes):
    envelope = {"token": "secret", "epoch": 1, "seq": 5, "seen_tick": 998, **changes}
    fields = {
        t.JOYSTICK: {"twist": (0.1, 0, 0, 0, 0, 0)},
        t.POSITION: {"xyz": (0, 0, 0), "rpy": (0, 0, 0)},
        t.MODE: {"action": "enable"},
        t.SPEED: {"factor": 0.5},
    }.get(topic, {})
    return encode(topic.message(**envelope, **fields))


def refusal(admission, payload, now=NOW, topic=t.JOYSTICK):
    before = dict(admission.last_seq), admission.age_ticks
    with pytest.raises(Refused) as caught:
        admission.admit(topic, payload, now)
    assert (admission.last_seq, admission.age_ticks) == before
    assert caught.value.detail
    assert "secret" not in caught.value.detail
    return caught.value.reason


def test_what_the_holder_sends_in_time_is_admitted_and_noted(admission):
    message = admission.admit(t.JOYSTICK, command(), NOW)
    assert isinstance(message, m.JoystickTwist)
    assert message.twist[0] == 0.1
    assert admission.last_seq == {t.JOYSTICK.key: 5}
    assert admission.age_ticks == 2


@pytest.mark.parametrize(
    ("changes", "now", "reason"),
    [
        ({}, Now(100.5, 1000, 900), Why.NO_LEASE),
        ({"token": "guess"}, NOW, Why.WRONG_TOKEN),
        ({"epoch": 0}, NOW, Why.OLD_EPOCH),
        ({"epoch": 2}, NOW, Why.OLD_EPOCH),
        ({"seen_tick": 949}, NOW, Why.OLD_PICTURE),
        ({"seen_tick": 1001}, NOW, Why.FUTURE_PICTURE),
        ({"seen_tick": 998}, Now(100.0, 1000, 999), Why.BEFORE_ENABLE),
        ({}, Now(100.0, 1000, None), Why.NOT_ENABLED),
    ],
)
def test_each_reason_to_refuse(admission, changes, now, reason):
    assert refusal(admission, command(**changes), now) == reason


def test_at_its_very_limits_a_command_is_still_admitted(admission):
    admission.admit(t.JOYSTICK, command(seq=0, seen_tick=950), NOW)
    assert admission.age_ticks == 50
    admission.admit(t.JOYSTICK, command(seq=1, seen_tick=1000), NOW)
    admission.admit(t.JOYSTICK, command(seq=2), Now(100.499, 1000, 998))


@pytest.mark.parametrize("seq", [0, 4, 5])
def test_what_comes_twice_or_out_of_order_is_refused(admission, seq):
    admission.admit(t.JOYSTICK, command(), NOW)
    assert refusal(admission, command(seq=seq)) == Why.OUT_OF_ORDER


def test_order_is_kept_for_each_topic_on_its_own(admission):
    admission.admit(t.JOYSTICK, command(seq=50), NOW)
    admission.admit(t.POSITION, command(t.POSITION, seq=1), NOW)
    assert admission.last_seq == {t.JOYSTICK.key: 50, t.POSITION.key: 1}


@pytest.mark.parametrize("topic", [t.KEEPALIVE, t.MODE, t.SPEED])
def test_keepalives_and_requests_need_the_lease_but_no_enabled_arm(admission, topic):
    admission.admit(topic, command(topic), Now(100.0, 1000, None))
    assert refusal(admission, command(topic, token="guess"), NOW, topic) == Why.WRONG_TOKEN


def test_a_link_that_delivers_everything_in_order_and_late_is_noticed(admission):
    for tick in range(1000, 1100):
        admission.renew(Now(100.0, tick, 900))
        payload = command(seq=tick, seen_tick=tick - 60)
        assert refusal(admission, payload, Now(100.0, tick, 900)) == Why.OLD_PICTURE


def test_bytes_that_are_no_message_are_refused_by_the_codecs_name(admission):
    assert refusal(admission, b"\xc1") == "not_messagepack"
    assert refusal(admission, b"") != ""


def test_while_a_lease_lives_nobody_else_gets_one(admission):
    with pytest.raises(Refused) as caught:
        admission.grant("bob", "other", NOW)
    assert caught.value.reason == Why.LEASE_TAKEN
    assert "ann" in caught.value.detail
    admission.renew(Now(100.4, 1040, 900))
    with pytest.raises(Refused):
        admission.grant("bob", "other", Now(100.8, 1080, 900))


def test_after_it_ran_out_or_was_given_back_the_next_one_gets_a_new_epoch(admission):
    admission.admit(t.JOYSTICK, command(seq=70), NOW)
    lease = admission.grant("bob", "other", Now(100.5, 1050, 900))
    assert (lease.holder, lease.epoch) == ("bob", 2)
    late = Now(100.5, 1050, 900)
    assert refusal(admission, command(seq=71, seen_tick=1049), late) == Why.OLD_EPOCH
    assert refusal(admission, command(seq=71, seen_tick=1049, epoch=2), late) == Why.WRONG_TOKEN
    # Its sequence numbers begin anew.
    payload = command(seq=0, seen_tick=1049, epoch=2, token="other")
    admission.admit(t.JOYSTICK, payload, late)
    admission.end()
    assert admission.grant("ann", "third", late).epoch == 3
