"""Values that a message's schema allows, the odd ones more often than the usual."""

import math
import random
import types
from collections.abc import Mapping, Sequence
from enum import Enum
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Len, Lt, MaxLen, MinLen
from pydantic import ValidationError
from pydantic.fields import FieldInfo
from telerobot.protocols.messages.messages import Command, Message

ODD = (0.0, -0.0, 1.0, -1.0, 5e-324, 1e-12, -1e-6, 0.3, math.pi, 1e6, -1e300, 1.7e308)
"""Numbers that have hurt somebody."""
WORDS = ("base", "carrier", "mrf", "wall", "floor", "ready", "start", "park", "x", "")
ENVELOPE = frozenset(Command.model_fields)
TRIES = 20
"""Draws of fields until they make a valid message [1]."""


class Values:
    """Draws fields for messages; `words` are names that mean something in the cell."""

    def __init__(self, dice: random.Random, words: Sequence[str] = ()) -> None:
        self.dice = dice
        self._words = (*words, *WORDS)

    def fields(self, kind: type[Message]) -> dict[str, Any]:
        """Return fields of a message, less a command's envelope, each inside its own bounds.

        What the message demands of several fields together may still be broken.
        """
        found = {}
        for name, field in kind.model_fields.items():
            if name in ENVELOPE or (not field.is_required() and self.dice.random() < 0.5):
                continue
            found[name] = self.of(field.annotation, field.metadata)
        if "nearest_mm" in found and self.dice.random() < 0.5:  # drawn apart, they never agree
            found["rows"], found["columns"] = self.dice.randint(1, 20), self.dice.randint(1, 40)
            found["nearest_mm"] = self.dice.randbytes(2 * found["rows"] * found["columns"])
        return found

    def message(self, kind: type[Message], **given: Any) -> Message | None:
        """Return a message of a kind with the given fields; None if the rest never fits."""
        for _ in range(TRIES):
            try:
                return kind(**{**self.fields(kind), **given})
            except ValidationError:
                continue
        return None

    def of(self, annotation: Any, metadata: Sequence[Any] = ()) -> Any:
        """Return a value of an annotated type."""
        dice, origin = self.dice, get_origin(annotation)
        if origin is Annotated:
            inner, *more = get_args(annotation)
            return self.of(inner, (*metadata, *_flat(more)))
        if origin in (Union, types.UnionType):
            return self.of(dice.choice(get_args(annotation)), metadata)
        if origin is Literal:
            return dice.choice(get_args(annotation))
        if origin is tuple:
            return self._tuple(get_args(annotation), metadata)
        if origin in (dict, Mapping):
            key, value = get_args(annotation)
            return {self.of(key): self.of(value) for _ in range(dice.randrange(3))}
        if annotation is type(None):
            return None
        if isinstance(annotation, type) and issubclass(annotation, Enum):
            return dice.choice(list(annotation))
        if annotation is bool:
            return dice.random() < 0.5
        if annotation is int:
            return round(self.number(metadata, whole=True))
        if annotation is float:
            return self.number(metadata)
        if annotation is bytes:
            least, most = _lengths(metadata)
            return dice.randbytes(dice.choice((least, min(most, 32), most)))
        return self._text(metadata)

    def number(self, metadata: Sequence[Any] = (), *, whole: bool = False) -> float:
        """Return a number inside its bounds: an odd one, a bound, or any between."""
        low, high = -math.inf, math.inf
        for bound in _flat(metadata):
            if isinstance(bound, Ge):
                low = float(bound.ge)  # type: ignore[arg-type]  # any that compares
            elif isinstance(bound, Gt):
                low = math.nextafter(float(bound.gt), math.inf)  # type: ignore[arg-type]  # as above
            elif isinstance(bound, Le):
                high = float(bound.le)  # type: ignore[arg-type]  # as above
            elif isinstance(bound, Lt):
                high = math.nextafter(float(bound.lt), -math.inf)  # type: ignore[arg-type]  # as above
        dice = self.dice
        way = dice.random()
        if way < 0.3:
            value = dice.choice(ODD)
        elif way < 0.5:
            value = dice.choice((low, high))
        elif way < 0.75 or math.isinf(low) or math.isinf(high):
            value = dice.gauss(0.0, 10.0 ** dice.uniform(-3.0, 1.0))
        else:
            value = dice.uniform(low, high)
        value = min(max(value, low), high)
        if math.isinf(value):
            value = math.copysign(1.7e308, value)
        return float(min(abs(value), 2.0**62)) if whole else value

    def _tuple(self, parts: tuple[Any, ...], metadata: Sequence[Any]) -> tuple[Any, ...]:
        if len(parts) != 2 or parts[1] is not Ellipsis:
            return tuple(self.of(part) for part in parts)
        least, most = _lengths(metadata)
        count = self.dice.choice((least, 6, 7, 8, self.dice.randint(least, most)))
        return tuple(self.of(parts[0]) for _ in range(min(max(count, least), most)))

    def _text(self, metadata: Sequence[Any]) -> str:
        least, most = _lengths(metadata)
        dice = self.dice
        if dice.random() < 0.8:
            text = dice.choice(self._words)
        else:
            text = "".join(chr(dice.choice((97, 48, 95, 0, 0x1F600))) for _ in range(12))
        return text[:most].ljust(least, "a")


def _flat(metadata: Sequence[Any]) -> list[Any]:
    """Return constraints one by one, those of a `Field(...)` in an annotation among them."""
    flat: list[Any] = []
    for item in metadata:
        flat += item.metadata if isinstance(item, FieldInfo) else [item]
    return flat


def _lengths(metadata: Sequence[Any]) -> tuple[int, int]:
    least, most = 0, 64
    for item in _flat(metadata):
        if isinstance(item, (Len, MinLen)):
            least = max(least, item.min_length)
        if isinstance(item, (Len, MaxLen)) and item.max_length is not None:
            most = min(most, item.max_length)
    return least, most
