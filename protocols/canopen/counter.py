"""A drive's position counter of 32 bits: what turns for ever makes it wrap."""

from typing import Final

SPAN: Final = 1 << 32
HALF: Final = 1 << 31


def wrapped(counts: int) -> int:
    """Return counts as a counter of 32 bits, with a sign, has them."""
    return (counts + HALF) % SPAN - HALF


class Unwrapped:
    """Counts of a joint that turns for ever: between two readings it goes the shorter way."""

    def __init__(self) -> None:
        self._last: int | None = None

    def take(self, counts: int) -> int:
        """Return a reading without the wraps since the first one."""
        last = counts if self._last is None else self._last
        self._last = last + wrapped(counts - last)
        return self._last
