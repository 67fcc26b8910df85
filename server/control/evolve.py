"""A changed copy of a frozen dataclass, quickly: the tick makes a dozen of them."""

from typing import Any, TypeVar

T = TypeVar("T")


def evolve(value: T, **changes: Any) -> T:
    """Return a copy of a frozen dataclass with some fields changed.

    As `dataclasses.replace`, at a fifth of its cost; for dataclasses without slots and without
    `__post_init__`. Raises `TypeError` for a field that there is not.
    """
    copy = object.__new__(type(value))
    fields = copy.__dict__
    fields |= value.__dict__
    fields |= changes
    if len(fields) != len(value.__dict__):
        unknown = ", ".join(sorted(changes.keys() - value.__dict__.keys()))
        raise TypeError(f"{type(value).__name__} has no field {unknown}")
    return copy
