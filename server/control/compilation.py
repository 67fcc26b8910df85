"""When kernels are made, and news of it; it needs no compiler, so that anybody can ask.

A kernel is made, which is read from disk or compiled, when it is called for the first time. Who
must not wait then, as a loop in real time, makes all that there are before.
"""

from collections.abc import Callable
from typing import Any

Make = Callable[[], bool]
"""Makes one kernel, once; returns whether it had to be compiled, and was not on disk."""

listeners: list[Callable[[str, str], None]] = []
"""Called with module and name of each kernel that was compiled, and not read from disk."""
makers: dict[str, list[Make]] = {}
"""Who makes the kernels of each module that was imported."""


def add(function: Callable[..., Any], make: Make) -> Make:
    """Take note of a kernel; return what makes it and tells of it."""

    def made() -> bool:
        compiled = make()
        if compiled:
            for listener in listeners:
                listener(function.__module__, function.__name__)
        return compiled

    makers.setdefault(function.__module__, []).append(made)
    return made


def make_all() -> None:
    """Make the kernels of all modules that were imported."""
    for each in makers.values():
        for make in each:
            make()
