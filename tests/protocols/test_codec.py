"""What crosses Zenoh: round trips, msgpack as independent reader, and every refusal."""

import math
import struct
from typing import Any

import msgpack
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from telerobot.protocols import topics
from telerobot.protocols.codec import (
    CodecError,
    Reason,
    decode,
    decode_as,
    encode,
    message_of,
    text_field,
)
from telerobot.protocols.messages import messages as m
from telerobot.protocols.messages import requests
from telerobot.protocols.messages.telemetry import Description, Event, TaskDescription
from telerobot.protocols.topics import Topic

ENVELOPE = {"v": 2, "seen_tick": 5}
LEASE = {"v": 2, "operator": "ann"}
TWIST = {**ENVELOPE, "twist": [0.1, 0, 0, 0, 0, -0.5]}


FLOATS = st.floats(0, 1)  # inside the bounds of every field
KEYS = st.binary(min_size=32, max_size=32)
COUNTS = st.integers(0, 2**63 - 1)
VECTOR6 = st.tuples(*[FLOATS] * 6)
VECTOR3 = st.tuples(*[FLOATS] * 3)
FRAMES = st.sampled_from(m.Frame)
NAMES = st.from_regex(r"[a-z][a-z0-9_]{0,31}", fullmatch=True)
COMMAND: dict[str, Any] = {
    "seen_tick": COUNTS,
}
VALUES = st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | FLOATS | st.text()
MESSAGES: list[tuple[Topic, dict[str, Any]]] = [
    (topics.KEEPALIVE, COMMAND),
    (topics.JOYSTICK, {**COMMAND, "twist": VECTOR6, "relative_to": FRAMES, "handle": VECTOR3}),
    (topics.REFLECT, {**COMMAND, "protected": st.booleans()}),
    (topics.LEASE, {"operator": st.text(min_size=1, max_size=64), "key": KEYS}),
    (
        topics.PROTECTIVE_STOP,
        {"operator": st.text(min_size=1, max_size=64), "seal": st.none() | KEYS},
    ),
    (
        topics.REFLECTION,
        {"tick": COUNTS, "wrench": VECTOR6, "slope": FLOATS, "entered": FLOATS},
    ),
    (
        topics.POSITION,
        {**COMMAND, "xyz": VECTOR3, "rpy": VECTOR3, "expressed_in": st.none() | FRAMES},
    ),
    (topics.JOG, {**COMMAND, "rates": st.lists(FLOATS, min_size=1).map(tuple)}),
    (topics.GAIN, {**COMMAND, "source": NAMES, "gain": VECTOR6}),
    (
        topics.EVENT,
        {
            "id": COUNTS,
            "tick": COUNTS,
            "time_s": FLOATS,
            "name": st.text(max_size=64),
            "severity": st.sampled_from(["info", "warning", "error"]),
            "values": st.dictionaries(st.text(), VALUES),
        },
    ),
]
ANY_MESSAGE = st.one_of(
    [st.tuples(st.just(topic), st.builds(topic.message, **kw)) for topic, kw in MESSAGES]
)


@given(ANY_MESSAGE)
def test_every_message_comes_back_as_it_was_sent(case: tuple[Topic, m.Message]) -> None:
    topic, message = case
    payload = encode(message)
    if len(payload) <= topic.max_bytes:
        assert decode(topic, payload) == message


def test_another_msgpack_reader_sees_a_plain_map() -> None:
    twist = m.JoystickTwist(seen_tick=3, twist=(1, 2, 3, 4, 5, 6), relative_to=m.Frame.BASE)
    assert msgpack.unpackb(encode(twist)) == {
        "v": 2,
        "seen_tick": 3,
        "task": None,
        "twist": [1.0, 2.0, 3.0, 4.0, 5.0, 6.0],
        "relative_to": "base",
        "expressed_in": "crf",
        "handle": None,
    }


def test_a_message_from_any_msgpack_writer_is_understood() -> None:
    message = decode(topics.JOYSTICK, msgpack.packb({**TWIST, "expressed_in": "mrf"}))
    assert isinstance(message, m.JoystickTwist)
    assert message.twist == (0.1, 0.0, 0.0, 0.0, 0.0, -0.5)
    assert [type(x) for x in message.twist] == [float] * 6
    assert message.relative_to is m.Frame.CRF
    assert message.expressed_in is m.Frame.MRF


def test_a_reply_is_read_without_a_topic() -> None:
    reply = requests.Reply(ok=False, reason="lease_held", detail="by ada", tick=7)
    assert decode_as(requests.Reply, encode(reply)) == reply


def test_an_unvalidated_message_is_encoded_as_it_stands() -> None:
    event = Event.model_construct(
        id=1, tick=2, time_s=0.5, name="x", severity="info", detail="", values={"a": 1.5}
    )
    assert decode(topics.EVENT, encode(event)) == event


def position(**changes: Any) -> dict[str, Any]:
    return {**ENVELOPE, "xyz": [0, 0, 0], "rpy": [0, 0, 0], **changes}


def without(name: str) -> dict[str, Any]:
    return {key: value for key, value in TWIST.items() if key != name}


REFUSALS: list[tuple[str, Topic, Any, Reason, str]] = [
    ("version", topics.JOYSTICK, {**TWIST, "v": 1}, Reason.WRONG_VERSION, "v: 1"),
    ("no version", topics.JOYSTICK, without("v"), Reason.MISSING_FIELD, "v is missing"),
    ("version type", topics.JOYSTICK, {**TWIST, "v": True}, Reason.WRONG_TYPE, "v: a bool"),
    ("array", topics.JOYSTICK, [1, 2], Reason.NOT_A_MAP, "tuple"),
    ("nil", topics.JOYSTICK, None, Reason.NOT_A_MAP, "NoneType"),
    (
        "missing",
        topics.JOYSTICK,
        without("seen_tick"),
        Reason.MISSING_FIELD,
        "seen_tick is missing",
    ),
    ("unknown", topics.JOYSTICK, {**TWIST, "speed": 1}, Reason.UNKNOWN_FIELD, "speed"),
    ("string", topics.JOYSTICK, {**TWIST, "seen_tick": "1"}, Reason.WRONG_TYPE, "seen_tick"),
    ("bool", topics.JOYSTICK, {**TWIST, "seen_tick": True}, Reason.WRONG_TYPE, "seen_tick"),
    ("float", topics.JOYSTICK, {**TWIST, "seen_tick": 1.0}, Reason.WRONG_TYPE, "1.0"),
    ("nested bool", topics.JOYSTICK, {**TWIST, "twist": [True] * 6}, Reason.WRONG_TYPE, "True"),
    ("enum type", topics.JOYSTICK, {**TWIST, "relative_to": 1}, Reason.WRONG_TYPE, "relative_to"),
    ("enum", topics.JOYSTICK, {**TWIST, "relative_to": "tool"}, Reason.OUT_OF_RANGE, "'tool'"),
    ("short", topics.JOYSTICK, {**TWIST, "twist": [0] * 5}, Reason.OUT_OF_RANGE, "twist"),
    ("long", topics.JOYSTICK, {**TWIST, "twist": [0] * 7}, Reason.OUT_OF_RANGE, "twist"),
    ("negative", topics.JOYSTICK, {**TWIST, "seen_tick": -1}, Reason.OUT_OF_RANGE, "-1"),
    ("bound", topics.POSITION, position(speed=-1.0), Reason.OUT_OF_RANGE, "-1.0"),
    ("literal", topics.MODE, {**ENVELOPE, "action": "fly"}, Reason.OUT_OF_RANGE, "'fly'"),
    ("neither", topics.POSTURE, ENVELOPE, Reason.OUT_OF_RANGE, "either posture or q"),
    ("nan", topics.JOYSTICK, {**TWIST, "twist": [math.nan] + [0] * 5}, Reason.NON_FINITE, "[0]"),
    ("inf", topics.POSITION, position(speed=math.inf), Reason.NON_FINITE, "speed"),
    ("array for a number", topics.JOYSTICK, {**TWIST, "seen_tick": [5]}, Reason.WRONG_TYPE, "seen"),
    ("bytes", topics.MODE, {**ENVELOPE, "action": b"hold"}, Reason.OUT_OF_RANGE, "action"),
    ("text as key", topics.LEASE, {**LEASE, "key": "k" * 32}, Reason.WRONG_TYPE, "key"),
    ("short key", topics.LEASE, {**LEASE, "key": b"k" * 31}, Reason.OUT_OF_RANGE, "key"),
    ("bytes key", topics.JOYSTICK, {b"v": 1}, Reason.NOT_MESSAGEPACK, "keys"),
    ("map key", topics.JOYSTICK, {1: 1}, Reason.NOT_MESSAGEPACK, ""),
]


@pytest.mark.parametrize(("topic", "content", "reason", "words"), [r[1:] for r in REFUSALS],
                         ids=[r[0] for r in REFUSALS])  # fmt: skip
def test_refusals_name_reason_field_and_value(
    topic: Topic, content: Any, reason: Reason, words: str
) -> None:
    with pytest.raises(CodecError) as refused:
        decode(topic, msgpack.packb(content))
    assert refused.value.reason is reason
    assert words in refused.value.detail
    assert "\n" not in refused.value.detail


GOOD = msgpack.packb(TWIST)


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        GOOD[:-1],
        GOOD + b"\0",
        b"\xc1",
        b"\x82\xa1v\x01\xa1v\x01",
        b"\x81\xa1v" + b"\x91" * 200,
        b"\x81\xa1v\xd4\x05\x00",
        b"\x81\xa1v\xd6\xff\x00\x00\x00\x00",
        b"\x81\xa1v\xc7\x00\x05",
        b"\x81\xa1v\xdb" + struct.pack(">I", 2**31),
        b"\x81\xa1v\xdd" + struct.pack(">I", 2**31),
        b"\x81\xa1v\xa1\xff",
        b"\x81\x91\x01\x01",
        b"\x81\xa1v" * 50 + b"\xc0",
        b"\x81\xa1v\x92\x80\x80",
        b"\x81\xa1v\xdc\x00\x15" + b"\xc0" * 21,
        b"\xde\x00\x19" + b"".join(b"\xa1" + bytes([c, 0]) for c in range(65, 90)),
    ],
    ids=["empty", "cut", "extra", "reserved", "twice", "deep", "extension", "timestamp",
         "empty extension", "huge string", "huge array", "not utf-8", "array as key", "nested maps",
         "maps within", "array beyond any field", "map beyond all fields"],
)  # fmt: skip
def test_what_is_not_one_messagepack_map_is_refused(payload: bytes) -> None:
    with pytest.raises(CodecError) as refused:
        decode(topics.JOYSTICK, payload)
    assert refused.value.reason is Reason.NOT_MESSAGEPACK


@pytest.mark.parametrize("topic", [topics.JOYSTICK, topics.LEASE], ids=lambda topic: topic.key)
def test_a_payload_of_just_the_topics_size_is_read_and_one_byte_more_is_not(topic: Topic) -> None:
    # What no longer fits is refused by its size; at just the size, by what is in it.
    for size, reason in ((0, Reason.NOT_MESSAGEPACK), (1, Reason.TOO_LARGE)):
        with pytest.raises(CodecError) as refused:
            decode(topic, b"\xc1" * (topic.max_bytes + size))
        assert refused.value.reason is reason


def test_a_message_of_just_as_many_bytes_as_it_may_have_is_read() -> None:
    payload = encode(m.CancelGoals(seen_tick=5))
    assert decode_as(m.CancelGoals, payload, len(payload)).seen_tick == 5
    with pytest.raises(CodecError, match="too_large"):
        decode_as(m.CancelGoals, payload, len(payload) - 1)


def test_a_payload_over_the_topics_size_is_refused_unread() -> None:
    most = topics.JOYSTICK.max_bytes
    with pytest.raises(CodecError, match=f"too_large: {most + 1} bytes, at most {most}"):
        decode(topics.JOYSTICK, b"\xc1" * (most + 1))


@given(st.integers(0, 200).flatmap(lambda n: st.binary(min_size=n, max_size=n)))
@example(b"\x81\xa1v\x01")
def test_no_bytes_whatever_raise_anything_else(payload: bytes) -> None:
    with pytest.raises(CodecError):
        decode(topics.JOYSTICK, payload)


def test_every_reason_is_seen_in_these_tests() -> None:
    seen = {r[3] for r in REFUSALS} | {Reason.NOT_MESSAGEPACK, Reason.TOO_LARGE}
    assert seen == set(Reason)


@pytest.mark.parametrize("bias", [(0, 0, -101.0, 0, 0, 0), (0, 0, 0, 0, 10.1, 0)])
def test_a_bias_that_no_sensor_has_is_refused(bias: tuple[float, ...]) -> None:
    sent = msgpack.packb({"v": m.VERSION, "seen_tick": 1, "mass": 1.0, "bias": bias})
    with pytest.raises(CodecError) as caught:
        decode(topics.PAYLOAD, sent)
    assert caught.value.reason is Reason.OUT_OF_RANGE
    assert caught.value.detail.startswith("bias[")


def refused(topic: Topic, content: dict[str, Any]) -> CodecError:
    with pytest.raises(CodecError) as caught:
        decode_as(topic.message, msgpack.packb(content), 2**20)
    assert str(caught.value) == f"{caught.value.reason}: {caught.value.detail}"
    return caught.value


@pytest.mark.parametrize(
    ("topic", "content", "detail"),
    [
        (topics.JOYSTICK, {**TWIST, "speed": 1}, "speed is not a field of this message"),
        (topics.JOYSTICK, {**TWIST, "twist": [0] * 5}, "twist[5]: the array is too short"),
        (topics.JOYSTICK, {**TWIST, "relative_to": "tool"},
         f"relative_to: 'tool' is not one of {', '.join(m.Frame)}"),
    ],
    ids=["unknown field", "short array", "enum"],
)  # fmt: skip
def test_a_refusal_says_in_words_what_is_wrong(
    topic: Topic, content: dict[str, Any], detail: str
) -> None:
    assert refused(topic, content).detail == detail


@pytest.mark.parametrize(
    ("value", "shown"),
    [(b"hold", "a bytes"), ([], "a tuple"), (None, "None"), (7, "7"), ("fly", "'fly'")],
)
def test_a_refused_value_is_shown_if_it_is_short_and_flat(value: Any, shown: str) -> None:
    detail = refused(topics.MODE, {**ENVELOPE, "action": value}).detail
    assert detail.endswith(f", not {shown}")


def test_what_is_wrong_with_a_message_as_a_whole_names_no_field() -> None:
    detail = refused(topics.POSTURE, ENVELOPE).detail
    assert not detail.startswith(":")
    assert "not {" not in detail
    assert "a dict" not in detail


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("x" * 40, "x" * 40),
        ("x" * 41, "x" * 40 + "…"),
        ("x" * 100, "x" * 40 + "…"),
        ("\n" * 20, "\\n" * 20),
        ("\n" * 21, "\\n" * 20 + "…"),
    ],
)
def test_foreign_text_is_shown_in_forty_characters_that_can_be_printed(
    name: str, shown: str
) -> None:
    detail = refused(topics.JOYSTICK, {**TWIST, name: 1}).detail
    assert detail == f"{shown} is not a field of this message"


EVENT = {"v": 2, "id": 1, "tick": 1, "time_s": 0.0, "name": "n", "severity": "info"}


def test_of_all_complaints_about_a_value_that_is_not_finite_says_most() -> None:
    """A value may be a number, a text or a flag: none of these is why it is refused."""
    error = refused(topics.EVENT, {**EVENT, "values": {"force": math.nan}})
    assert error.reason is Reason.NON_FINITE
    assert error.detail.startswith("values.force")


@pytest.mark.parametrize(
    ("make", "most"),
    [
        (lambda n: {**EVENT, "name": "x" * n}, 4096),
        (lambda n: {**EVENT, "name": b"x" * n}, 64),
        (lambda n: {**EVENT, "name": [0] * n}, 1024),
        (lambda n: {**EVENT, "name": {str(i): 0 for i in range(n)}}, 256),
    ],
    ids=["text", "bytes", "array", "map"],
)
def test_where_a_cells_own_names_are_in_a_message_its_parts_have_room_and_no_more(
    make: Any, most: int
) -> None:
    assert refused(topics.EVENT, make(most)).reason is not Reason.NOT_MESSAGEPACK
    assert refused(topics.EVENT, make(most + 1)).reason is Reason.NOT_MESSAGEPACK


@pytest.mark.parametrize(
    ("make", "most"),
    [
        (lambda n: {**TWIST, "task": "x" * n}, 2 * 128 + 8),
        (lambda n: {**TWIST, "task": b"x" * n}, 8),
        (lambda n: {**TWIST, "twist": [0] * n}, 2 * 6 + 8),
        (lambda n: {str(i): 0 for i in range(n)}, 2 * 7 + 8),
    ],
    ids=["text", "bytes", "array", "map"],
)
def test_what_is_twice_as_large_as_any_field_is_refused_unread(make: Any, most: int) -> None:
    assert refused(topics.JOYSTICK, make(most)).reason is not Reason.NOT_MESSAGEPACK
    assert refused(topics.JOYSTICK, make(most + 1)).reason is Reason.NOT_MESSAGEPACK


def test_a_reply_has_four_kilobytes_and_no_more() -> None:
    for length, reason in ((4096, Reason.NOT_MESSAGEPACK), (4097, Reason.TOO_LARGE)):
        with pytest.raises(CodecError) as caught:
            decode_as(requests.Reply, b"\xc1" * length)
        assert caught.value.reason is reason


def test_a_message_within_a_message_travels_as_a_map() -> None:
    task = {"task": "a", "mechanism": "b"}
    inner = TaskDescription.model_construct(**task)
    sent = encode(Description.model_construct(cell="c", tasks=(inner,)))
    (read,) = msgpack.unpackb(sent)["tasks"]
    assert {key: read[key] for key in task} == task
    assert "v" not in read


def test_a_value_that_messagepack_has_no_type_for_is_an_error() -> None:
    with pytest.raises(TypeError, match="can not serialize 'object' object"):
        encode(Event.model_construct(id=1, values={"a": object()}))


def test_a_text_can_be_read_out_of_what_is_no_message() -> None:
    for name, text in (("task", "left"), ("v", ""), ("twist", ""), ("there is none", "")):
        assert (
            text_field(topics.JOYSTICK, msgpack.packb({"task": "left", **ENVELOPE}), name) == text
        )
    assert text_field(topics.JOYSTICK, b"\xc1", "task") == ""


def test_plain_fields_make_the_message_that_its_bytes_make() -> None:
    fields = {"seen_tick": 5, "twist": [0.1, 0, 0, 0, 0, -0.5]}
    assert message_of(topics.JOYSTICK, fields) == decode(topics.JOYSTICK, GOOD)
    for wrong, reason in (({"seen_tick": object()}, Reason.WRONG_TYPE),
                          ({"seen_tick": 2**64}, Reason.WRONG_TYPE),
                          ({"seen_tick": -1}, Reason.OUT_OF_RANGE)):  # fmt: skip
        with pytest.raises(CodecError) as caught:
            message_of(topics.JOYSTICK, {**fields, **wrong})
        assert caught.value.reason is reason
