"""How large a message of a kind can be, from its fields' types: what is larger is refused unread.

A kind whose fields are not all bounded, such as telemetry with names of a cell's own choice, has
no bounds.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from functools import cache
from types import NoneType, UnionType
from typing import Annotated, Any, Final, Literal, Union, get_args, get_origin

from annotated_types import MaxLen
from pydantic import BaseModel

_HEAD: Final = 5
"""Longest head of a string or container in MessagePack [B]."""

_NUMBER: Final = 9
"""Longest number, with its head [B]."""

_UTF8: Final = 4
"""Bytes that a character may take [1]."""


@dataclass(frozen=True)
class Bounds:
    """Most that MessagePack takes for one value, and for the parts that it is made of."""

    size: int
    """Bytes in all, however long-winded the writer [B]."""
    text: int = 0
    """Longest string, or name of a field [B]."""
    binary: int = 0
    """Longest byte string [B]."""
    array: int = 0
    """Elements of the longest array [1]."""
    fields: int = 0
    """Entries of the message's map; no other map is in it [1]."""

    def covering(self, *others: "Bounds") -> "Bounds":
        """Return bounds for any one of several values."""
        each = (self, *others)
        return Bounds(
            max(b.size for b in each),
            max(b.text for b in each),
            max(b.binary for b in each),
            max(b.array for b in each),
        )


@cache
def bounds_of(kind: type[BaseModel]) -> Bounds | None:
    """Return the bounds of messages of a kind, None where a field has none."""
    values = [_bounds(field.annotation, field.metadata) for field in kind.model_fields.values()]
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return None
    # The version is a field of its own, `v`.
    names = [_text(name) for name in (*kind.model_fields, "v")]
    size = _HEAD + _NUMBER + sum(b.size for b in (*known, *names))
    one = names[0].covering(*names, *known)
    return Bounds(size, one.text, one.binary, one.array, len(names))


def _bounds(kind: Any, metadata: Iterable[object] = ()) -> Bounds | None:
    """Return the bounds of a field's type, None where it has none."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _bounds(parts[0], (*parts[1:], *metadata))
    longest = _longest(metadata)
    if origin in (Union, UnionType):
        return _any_of(_bounds(part, metadata) for part in parts)
    if origin is Literal:
        return _any_of(_text(value) for value in parts)
    if origin is tuple:
        return _array(parts, longest)
    if isinstance(kind, type) and issubclass(kind, Enum):
        return _any_of(_text(member.value) for member in kind)
    if kind in (int, float, bool, NoneType):
        return Bounds(_NUMBER)
    if longest is not None and kind is str:
        return Bounds(_HEAD + _UTF8 * longest, text=_UTF8 * longest)
    if longest is not None and kind is bytes:
        return Bounds(_HEAD + longest, binary=longest)
    return None


def _longest(metadata: Iterable[object]) -> int | None:
    """Return the length that a field's constraints allow, None for any."""
    for item in metadata:
        if isinstance(item, MaxLen):
            return item.max_length
        nested = getattr(item, "metadata", None)  # a Field within Annotated
        if nested and (found := _longest(nested)) is not None:
            return found
    return None


def _array(parts: tuple[Any, ...], longest: int | None) -> Bounds | None:
    if parts[-1] is Ellipsis:
        if longest is None:
            return None
        parts = (parts[0],) * longest
    elements = [_bounds(part) for part in parts]
    known = [element for element in elements if element is not None]
    if len(known) < len(elements):
        return None
    inside = known[0].covering(*known)
    size = _HEAD + sum(element.size for element in known)
    return Bounds(size, inside.text, inside.binary, max(inside.array, len(parts)))


def _any_of(several: Iterable[Bounds | None]) -> Bounds | None:
    each = list(several)
    known = [bounds for bounds in each if bounds is not None]
    return known[0].covering(*known) if len(known) == len(each) else None


def _text(text: str) -> Bounds:
    length = len(text.encode())
    return Bounds(_HEAD + length, text=length)
