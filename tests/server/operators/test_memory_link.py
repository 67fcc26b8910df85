import pytest
from telerobot.protocols import topics as t
from telerobot.protocols.messages.messages import Message
from telerobot.server.operators.link import MemoryLink, room


def next_on(link, topic):
    """Return the oldest message that waits on a topic; None without one."""
    poll, read = link.source(topic)
    waiting = poll()
    return None if waiting is None else read(waiting)


def rest(link, topic):
    """Return what waits on a topic."""
    taken = []
    while (parcel := next_on(link, topic)) is not None:
        taken.append(parcel.payload)
    return taken


def test_commands_come_oldest_first_and_only_once():
    link = MemoryLink()
    link.put(t.JOYSTICK, b"1", b"proof")
    link.put(t.JOYSTICK, b"2")
    assert next_on(link, t.JOYSTICK) == (b"1", b"proof", None, "")
    assert rest(link, t.JOYSTICK) == [b"2"]
    assert next_on(link, t.JOYSTICK) is None


@pytest.mark.parametrize("topic", [t.JOYSTICK, t.FRAME_NEWS, t.OBSTACLE])
def test_of_a_backlog_only_the_newest_are_kept_and_no_topic_crowds_out_another(topic):
    link = MemoryLink()
    link.put(t.KEEPALIVE, b"alive")
    for i in range(1000):
        link.put(topic, str(i).encode())
    assert rest(link, t.KEEPALIVE) == [b"alive"]
    kept = range(1000 - room(topic), 1000)
    assert rest(link, topic) == [str(i).encode() for i in kept]


def test_what_is_no_command_is_not_put_and_what_is_no_request_not_asked():
    with pytest.raises(ValueError, match="no command"):
        MemoryLink().put(t.LEASE, b"")
    with pytest.raises(ValueError, match="no request"):
        MemoryLink().ask(t.CANCEL, b"", print)


def test_a_request_brings_its_answer_to_who_asked():
    link, answers = MemoryLink(), []
    link.ask(t.LEASE, b"please", answers.append, b"proof")
    asked = next_on(link, t.LEASE)
    asked.answer(b"yes")
    assert (asked.payload, asked.attached) == (b"please", b"proof")
    assert answers == [b"yes"]
    assert next_on(link, t.LEASE) is None
    link.ask(t.LEASE, b"please", answers.append)
    next_on(link, t.LEASE).answer(None)
    assert answers == [b"yes"]


def test_telemetry_reaches_everybody_who_listens_until_the_link_closes():
    link, heard = MemoryLink(), []
    for _ in range(2):
        link.listen(lambda topic, message: heard.append((topic, message)))
    link.publish(t.STATE, state := Message())
    link.close()
    link.publish(t.STATE, Message())
    assert heard == [(t.STATE, state)] * 2
