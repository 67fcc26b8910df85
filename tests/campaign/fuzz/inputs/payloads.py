"""Bytes for the network: of every message, valid, mutated and made up."""

import random
from typing import Any

import msgpack
from telerobot.protocols.messages.messages import VERSION
from telerobot.protocols.topics import Topic

from .values import Values


def junk(values: Values, topic: Topic) -> bytes:
    """Return bytes that are no message, or nearly one, of a topic."""
    dice = values.dice
    way = dice.randrange(6)
    if way == 0:
        return dice.randbytes(dice.choice((0, 1, 7, 200, topic.max_bytes, topic.max_bytes + 1)))
    if way == 1:
        return _packed(_anything(dice, 5))
    if way == 2:
        return _nested(dice)
    fields: dict[str, Any] = {"v": VERSION, **_plain(values.fields(topic.message))}
    for _ in range(dice.randrange(3)):
        name = dice.choice((*topic.message.model_fields, "v", "more"))
        fields[name] = _anything(dice, 3)
    packed = _packed(fields)
    return mutated(dice, packed) if way == 3 else packed


def mutated(dice: random.Random, data: bytes) -> bytes:
    """Return bytes with a few of them turned, cut out, doubled or put in."""
    changed = bytearray(data)
    for _ in range(dice.randint(1, 4)):
        at = dice.randrange(len(changed) + 1)
        way = dice.randrange(5)
        if way == 0 and at < len(changed):
            changed[at] ^= 1 << dice.randrange(8)
        elif way == 1:
            del changed[at : at + dice.randint(1, 8)]
        elif way == 2:
            changed[at:at] = dice.randbytes(dice.randint(1, 8))
        elif way == 3:
            changed[at:at] = changed[at : at + dice.randint(1, 40)]
        else:
            del changed[at:]
    return bytes(changed)


def _nested(dice: random.Random) -> bytes:
    """Return containers in containers, up to a payload's length: 1.5 kB may be 1,500 deep."""
    opening = dice.choice((b"\x91", b"\x81\xa1a", b"\x92\xc0", b"\xdc\x00\x01"))
    return opening * dice.choice((3, 30, 400, 1500 // len(opening))) + b"\xc0"


def _anything(dice: random.Random, depth: int) -> Any:
    """Return a value that MessagePack has a type for."""
    way = dice.randrange(12 if depth > 0 else 9)
    if way < 3:
        return dice.choice((None, True, False, 0, -1, 2**63, 2**64 - 1, -(2**63)))
    if way < 5:
        return dice.choice((float("nan"), float("inf"), -float("inf"), 1.7e308, 5e-324, 0.1))
    if way < 7:
        return "".join(chr(dice.choice((97, 0, 0x263A))) for _ in range(dice.choice((0, 3, 300))))
    if way < 9:
        return dice.randbytes(dice.choice((0, 3, 300)))
    count = dice.choice((0, 1, 3, 70))
    if way < 11:
        return [_anything(dice, depth - 1 if count < 70 else 0) for _ in range(count)]
    return {str(i): _anything(dice, depth - 1 if count < 70 else 0) for i in range(count)}


def _packed(value: Any) -> bytes:
    packed: bytes = msgpack.packb(value)
    return packed


def _plain(fields: dict[str, Any]) -> dict[str, Any]:
    """Return fields with enums as their values, as they cross the wire."""
    return {name: getattr(value, "value", value) for name, value in fields.items()}
