"""When kernels are made, and news of it; it needs no compiler, so that anybody can ask.

A kernel is made, which is read from disk or compiled, when it is called for the first time. Who
must not wait then, as a loop in real time, makes all that there are before.
"""

from collections.abc import Callable
from typing import Any

Make = Callable[[], bool]
"""Makes one kernel, once; returns whether it had to be compiled, and was not on disk."""
Listener = Callable[[str, str, int], None]
"""Called with module and name of a kernel, and with how many are to be made after it now."""

listeners: list[Listener] = []
"""Those who are told of each kernel that was compiled, and not read from disk."""
makers: dict[str, list[Callable[[int], bool]]] = {}
"""Who makes the kernels of each module that was imported."""


def add(function: Callable[..., Any], make: Make) -> Callable[[int], bool]:
    """Take note of a kernel; return what makes it, and tells of it and of how many follow."""

    def made(left: int) -> bool:
        compiled = make()
        if compiled:
            for listener in listeners:
                listener(function.__module__, function.__name__, left)
        return compiled

    makers.setdefault(function.__module__, []).append(made)
    return made


def make_all() -> None:
    """Make the kernels of all modules that were imported."""
    each = [make for of_module in makers.values() for make in of_module]
    for i, make in enumerate(each, 1):
        make(len(each) - i)
