"""News of kernels that had to be compiled; it needs no compiler itself, so that anybody can ask."""

from collections.abc import Callable

listeners: list[Callable[[str], None]] = []
"""Called with the name of each kernel that was compiled, and not read from disk."""


def tell(name: str) -> None:
    """Tell all listeners of a kernel that was compiled."""
    for listener in listeners:
        listener(name)
