"""When kernels are compiled, and news of it; it needs no compiler, so that anybody can ask."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

Make = Callable[[], bool]
"""Makes one kernel; returns whether it had to be compiled, and was not on disk."""

listeners: list[Callable[[str, str], None]] = []
"""Called with module and name of each kernel that was compiled, and not read from disk."""
_later: list[dict[str, list[Make]]] = []


def make(function: Callable[..., Any], maker: Make) -> None:
    """Make a kernel now, or when its turn comes."""
    if _later:
        _later[-1].setdefault(function.__module__, []).append(maker)
    elif maker():
        for listener in listeners:
            listener(function.__module__, function.__name__)


@contextmanager
def put_off() -> Iterator[dict[str, list[Make]]]:
    """Make no kernel in here; return who makes them, by module."""
    _later.append({})
    try:
        yield _later[-1]
    finally:
        _later.pop()
