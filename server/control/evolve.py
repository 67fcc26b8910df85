"""A changed copy of a frozen dataclass, quickly: the tick makes a dozen of them."""

from typing import Any, TypeVar

T = TypeVar("T")


def evolve(value: T, **changes: Any) -> T:
    """Return a copy of a frozen dataclass with some fields changed.

    As `dataclasses.replace`, at a fifth of its cost; for dataclasses without slots and without
    `__post_init__`. Raises `TypeError` for a field that there is not.
    """
    fields = value.__dict__
    if not changes.keys() <= fields.keys():
        unknown = ", ".join(sorted(changes.keys() - fields.keys()))
        raise TypeError(f"{type(value).__name__} has no field {unknown}")
    copy = object.__new__(type(value))
    copy.__dict__.update(fields)
    copy.__dict__.update(changes)
    return copy
