"""MessagePack map <-> message. What is not exactly right is refused, by name, and never coerced.

On the wire a message is one map: its fields under their names, and `v`, the protocol version.
Enums travel as strings, tuples as arrays, absent optional fields as nil or not at all. An integer
may stand where a float is expected; nothing else is converted: "1" is not 1, true is not 1.
"""

from collections.abc import Mapping
from enum import Enum, StrEnum
from functools import cache
from typing import Any, Final, TypeVar, get_args

import msgpack
from pydantic import ValidationError

from .messages.messages import VERSION, Message
from .topics import Topic, bounds_of

MessageT = TypeVar("MessageT", bound=Message)

_LONGEST_VALUE: Final = 40
_COMMON: Final = {"use_list": False, "max_ext_len": 0}
_ROOM: Final = {"max_str_len": 4096, "max_bin_len": 64, "max_array_len": 1024, "max_map_len": 256}
"""Limits for messages that bound themselves nowhere: telemetry."""

_TEXT: Final = frozenset({str})
_SLACK: Final = 8
"""Parts that are up to twice as large as any field needs, and this, are refused by field [1]."""


class Reason(StrEnum):
    """Why bytes were not accepted as a message."""

    WRONG_VERSION = "wrong_version"
    TOO_LARGE = "too_large"
    NOT_MESSAGEPACK = "not_messagepack"
    NOT_A_MAP = "not_a_map"
    WRONG_TYPE = "wrong_type"
    MISSING_FIELD = "missing_field"
    UNKNOWN_FIELD = "unknown_field"
    OUT_OF_RANGE = "out_of_range"
    NON_FINITE = "non_finite"


class CodecError(ValueError):
    """Bytes refused: `reason` for programs, `detail` for people, one line."""

    def __init__(self, reason: Reason, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason
        self.detail = detail


def encode(message: Message) -> bytes:
    """Return a message as MessagePack.

    Validates nothing, so that one built with `of_valid` from plain numbers and tuples
    costs no more than its packing. Raises `TypeError` for a value that MessagePack has no type for.
    """
    fields = {"v": VERSION, **message.__dict__}
    packed: bytes = msgpack.packb(fields, default=_fields_of)
    return packed


def decode(topic: Topic, payload: bytes) -> Message:
    """Return the message that came on a topic. Raises `CodecError`."""
    return decode_as(topic.message, payload, topic.max_bytes)


def decode_as(kind: type[MessageT], payload: bytes, max_bytes: int = 4096) -> MessageT:
    """Return a message of a kind, such as a `Reply`. Raises `CodecError`."""
    if len(payload) > max_bytes:
        raise CodecError(Reason.TOO_LARGE, f"{len(payload)} bytes, at most {max_bytes}")
    fields = _unpack(kind, payload)
    _take_version(fields)
    for name, members in _enum_fields(kind).items():
        value = fields.get(name)
        if isinstance(value, str):
            if value not in members:
                raise CodecError(
                    Reason.OUT_OF_RANGE,
                    f"{name}: {_show(value)} is not one of {', '.join(members)}",
                )
            fields[name] = members[value]
    try:
        message: MessageT = kind.__pydantic_validator__.validate_python(fields, strict=True)
    except ValidationError as error:
        raise _refusal(error) from None
    return message


def text_field(topic: Topic, payload: bytes, name: str) -> str:
    """Return a text in bytes that were refused as a message; empty where there is none."""
    try:
        value = _unpack(topic.message, payload).get(name)
    except CodecError:
        return ""
    return value if isinstance(value, str) else ""


def message_of(topic: Topic, fields: Mapping[str, Any]) -> Message:
    """Return the message that plain fields make, as of TOML: judged as by `decode`.

    Raises `CodecError`.
    """
    try:
        payload: bytes = msgpack.packb({"v": VERSION, **fields})
    except (TypeError, ValueError, OverflowError) as error:
        raise CodecError(Reason.WRONG_TYPE, str(error)) from None
    return decode(topic, payload)


def _unpack(kind: type[Message], payload: bytes) -> dict[str, Any]:
    limits, flat = _limits(kind)
    pairs_hook = _OneMap() if flat else _pairs
    try:
        fields = msgpack.unpackb(
            payload, object_pairs_hook=pairs_hook, ext_hook=_no_extension, **limits
        )
    except CodecError:
        raise
    except (ValueError, TypeError, msgpack.UnpackException) as error:
        words = str(error).splitlines() or [type(error).__name__]
        raise CodecError(Reason.NOT_MESSAGEPACK, words[0]) from None
    if not isinstance(fields, dict):
        raise CodecError(Reason.NOT_A_MAP, f"a {type(fields).__name__} instead of a map")
    return fields


@cache
def _limits(kind: type[Message]) -> tuple[dict[str, Any], bool]:
    """Return what MessagePack may hold for a kind, and whether no map is in its map."""
    bounds = bounds_of(kind)
    if bounds is None:
        return {**_COMMON, **_ROOM}, False
    needed = {
        "max_str_len": bounds.text,
        "max_bin_len": bounds.binary,
        "max_array_len": bounds.array,
        "max_map_len": bounds.fields,
    }
    return {**_COMMON, **{limit: 2 * most + _SLACK for limit, most in needed.items()}}, True


class _OneMap:
    """Makes the map of a message that has no other in it; the second one that ends is refused."""

    _made = False

    def __call__(self, pairs: list[tuple[object, object]]) -> dict[object, object]:
        if self._made:
            raise CodecError(Reason.NOT_MESSAGEPACK, "a map within the map")
        self._made = True
        return _pairs(pairs)


def _pairs(pairs: list[tuple[object, object]]) -> dict[object, object]:
    fields = dict(pairs)
    if len(fields) != len(pairs) or not _TEXT.issuperset(map(type, fields)):
        raise CodecError(Reason.NOT_MESSAGEPACK, "a map's keys are strings, each there once")
    return fields


def _fields_of(value: object) -> dict[str, Any]:
    """Return the map of a message within a message."""
    if isinstance(value, Message):
        return value.__dict__
    raise TypeError(f"can not serialize '{type(value).__name__}' object")


def _no_extension(code: int, _data: bytes) -> object:
    raise ValueError(f"extension type {code} is not used here")


def _take_version(fields: dict[str, Any]) -> None:
    if "v" not in fields:
        raise CodecError(Reason.MISSING_FIELD, "v is missing")
    version = fields.pop("v")
    if type(version) is not int:
        raise CodecError(Reason.WRONG_TYPE, f"v: a {type(version).__name__} instead of an integer")
    if version != VERSION:
        raise CodecError(Reason.WRONG_VERSION, f"v: {version}, this is version {VERSION}")


@cache
def _enum_fields(kind: type[Message]) -> dict[str, dict[str, Enum]]:
    """Return the fields of a message that hold an enum, each with its members by value."""
    found: dict[str, dict[str, Enum]] = {}
    for name, field in kind.model_fields.items():
        for part in (field.annotation, *get_args(field.annotation)):
            if isinstance(part, type) and issubclass(part, Enum):
                found[name] = {str(member.value): member for member in part}
    return found


def _refusal(error: ValidationError) -> CodecError:
    complaints = error.errors(include_url=False, include_context=False)
    judged = [(_reason(c["type"], c["loc"]), c) for c in complaints]
    # a field that may be of several types complains once for each: not finite says most
    reason, first = next((j for j in judged if j[0] is Reason.NON_FINITE), judged[0])
    path = _path(first["loc"])
    if reason is Reason.MISSING_FIELD:
        return CodecError(reason, f"{path} is missing")
    if reason is Reason.UNKNOWN_FIELD:
        return CodecError(reason, f"{path} is not a field of this message")
    words = first["msg"].splitlines()[0]
    if first["type"] == "missing":
        words = "the array is too short"
    elif path:
        words = f"{words}, not {_show(first['input'])}"
    return CodecError(reason, f"{path}: {words}" if path else words)


def _reason(kind: str, loc: tuple[int | str, ...]) -> Reason:
    if kind == "missing":
        return Reason.MISSING_FIELD if len(loc) == 1 else Reason.OUT_OF_RANGE
    if kind == "extra_forbidden":
        return Reason.UNKNOWN_FIELD
    if kind == "finite_number":
        return Reason.NON_FINITE
    if kind.endswith("_type") or kind == "is_instance_of":
        return Reason.WRONG_TYPE
    return Reason.OUT_OF_RANGE


def _path(loc: tuple[int | str, ...]) -> str:
    parts = [f"[{p}]" if isinstance(p, int) else f".{_cut(p)}" for p in loc]
    return "".join(parts).removeprefix(".")


def _cut(text: str) -> str:
    """Return foreign text cut, and all that is not printable as escapes."""
    plain = repr(text[: _LONGEST_VALUE + 1])[1:-1]
    return plain if len(plain) <= _LONGEST_VALUE else plain[:_LONGEST_VALUE] + "…"


def _show(value: object) -> str:
    """Return a refused value for the detail: short and flat."""
    if isinstance(value, (int, float)) or value is None:
        return _cut(str(value))
    if isinstance(value, str):
        return f"'{_cut(value)}'"
    return f"a {type(value).__name__}"
