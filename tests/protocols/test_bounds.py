"""No message is larger than its kind's bounds, and none that could be sent is refused for them."""

from typing import Any, Literal

import msgpack
import pytest
from pydantic import ValidationError
from telerobot.protocols import topics as t
from telerobot.protocols.codec import decode, encode
from telerobot.protocols.messages.messages import MOST, VERSION, Message
from telerobot.protocols.messages.perception import LARGEST_JPEG, MOST_RAYS, MOST_TAGS
from telerobot.protocols.messages.requests import Reply
from telerobot.protocols.topics import bounds_of

FROM_STRANGERS = (*t.COMMANDS, *t.REQUESTS, *t.SENSORS)


def long_winded(value: Any) -> bytes:
    """Pack with the longest heads and numbers that MessagePack has."""
    if isinstance(value, dict):
        inside = b"".join(long_winded(part) for item in value.items() for part in item)
        return b"\xdf" + len(value).to_bytes(4, "big") + inside
    if isinstance(value, (list, tuple)):
        return b"\xdd" + len(value).to_bytes(4, "big") + b"".join(map(long_winded, value))
    if isinstance(value, str):
        return b"\xdb" + len(value.encode()).to_bytes(4, "big") + value.encode()
    if isinstance(value, bytes):
        return b"\xc6" + len(value).to_bytes(4, "big") + value
    if type(value) is int:
        return b"\xcf" + value.to_bytes(8, "big")
    return bytes(msgpack.packb(value))


def test_everything_that_strangers_may_send_is_bounded():
    for topic in FROM_STRANGERS:
        assert bounds_of(topic.message) is not None, topic.key
        assert topic.max_bytes < 9100


LARGEST = [
    (t.JOG, {"rates": (0.1,) * 64}),
    (t.POSTURE, {"q": (0.1,) * 64}),
    (t.POSTURE, {"posture": "ö" * 32}),
    (t.PATH, {"waypoints": ((0.1,) * 6,) * MOST, "speeds": (0.1,) * MOST}),
    (t.PATH, {"twists": ((0.1,) * 6,) * MOST, "durations_s": (0.1,) * MOST}),
    (t.JOYSTICK, {"twist": (0.1,) * 6, "handle": (1.0,) * 3}),
    (t.PAYLOAD, {"name": "🤖" * 32, "bias": (0.1,) * 6}),
    (t.SIGHTING, {"camera": "🤖" * 32, "tick": 1, "poses": ((0.1,) * 6,) * 2,
                  "errors_px": (0.1, 0.2), "quality": 0.5,
                  "seen": ((2**62, (0.1,) * 8),) * MOST_TAGS}),
    (t.OBSTACLE, {"name": "o" * 32, "tick": 2**62, "shape": "sight_line", "xyz": (0.1,) * 3,
                  "to": (0.1,) * 3, "rpy": (0.1,) * 3, "half_size": (0.1,) * 3, "radius": 0.1,
                  "velocity": (0.1,) * 3, "max_speed": 0.1, "max_acceleration": 0.1,
                  "timeout_s": 0.1, "stale": "keep", "clearance": 0.1, "hard": True}),
    (t.FRAME_NEWS, {"name": "carrier", "tick": 2**62, "xyz": (0.1,) * 3, "rpy": (0.1,) * 3,
                    "twist": (0.1,) * 6, "seen_from": "world", "quality": 0.1}),
    (t.PICTURE, {"camera": "🤖" * 32, "tick": 2**62, "jpeg": b"j" * LARGEST_JPEG}),
    (t.SCAN, {"tick": 2**62, "points_mm": b"p" * 12 * MOST_RAYS}),
    (t.LEASE, {"operator": "🤖" * 64, "key": b"k" * 32}),
    (t.PROTECTIVE_STOP, {"operator": "🤖" * 64, "seal": b"k" * 32}),
]  # fmt: skip


@pytest.mark.parametrize(("topic", "fields"), LARGEST)
def test_the_largest_message_fits_whatever_writes_it(topic, fields):
    if topic.needs_proof:
        fields = {"seen_tick": 2**62, **fields}
    message = topic.message(**fields)
    assert len(encode(message)) <= topic.max_bytes
    wire = msgpack.unpackb(encode(message))
    winded = long_winded(wire)
    assert len(winded) <= topic.max_bytes
    assert decode(topic, winded) == message


def test_a_field_without_a_bound_leaves_its_message_without_one():
    class Loose(Message):
        text: str

    class Nested(Message):
        values: dict[str, int]

    class Endless(Message):
        values: tuple[float, ...]

    class Tight(Message):
        word: Literal["one", "three"]
        number: int | None = None

    assert [bounds_of(kind) for kind in (Loose, Nested, Endless)] == [None] * 3
    most = len(long_winded({"v": VERSION, "word": "three", "number": 1}))
    assert bounds_of(Tight).size == most
    assert bounds_of(Reply) is not None
    with pytest.raises(ValidationError):
        Tight(word="two")
