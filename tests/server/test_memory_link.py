import pytest
from telerobot.protocols import topics as t
from telerobot.server.memory_link import MemoryLink


def test_commands_come_oldest_first_and_only_once():
    link = MemoryLink()
    link.put(t.JOYSTICK, b"1")
    link.put(t.JOYSTICK, b"2")
    assert list(link.commands()) == [(t.JOYSTICK, b"1", b""), (t.JOYSTICK, b"2", b"")]
    assert list(link.commands()) == []


def test_of_a_backlog_only_the_newest_are_kept_and_no_topic_crowds_out_another():
    link = MemoryLink()
    link.put(t.KEEPALIVE, b"alive")
    for i in range(100):
        link.put(t.JOYSTICK, bytes([i]))
    got = list(link.commands())
    assert (t.KEEPALIVE, b"alive", b"") in got
    sticks = [payload for topic, payload, _ in got if topic is t.JOYSTICK]
    assert sticks == [bytes([i]) for i in range(100 - t.JOYSTICK.unread, 100)]


def test_what_is_no_command_is_not_put():
    with pytest.raises(ValueError, match="no command"):
        MemoryLink().put(t.LEASE, b"")


def test_a_request_brings_its_answer_to_who_asked():
    link, answers = MemoryLink(), []
    link.ask(t.LEASE, b"please", answers.append, b"proof")
    (asked,) = link.requests()
    asked.answer(b"yes")
    assert (asked.topic, asked.payload, asked.proof) == (t.LEASE, b"please", b"proof")
    assert answers == [b"yes"]
    assert list(link.requests()) == []


def test_telemetry_reaches_everybody_who_listens_until_the_link_closes():
    link, heard = MemoryLink(), []
    for _ in range(2):
        link.listen(lambda topic, payload: heard.append((topic, payload)))
    link.publish(t.STATE, b"s")
    link.close()
    link.publish(t.STATE, b"late")
    assert heard == [(t.STATE, b"s")] * 2
