"""End of a process that runs until it is told to, or for a while."""

import signal
import time
from collections.abc import Callable
from types import FrameType


def until_told(seconds: float | None) -> Callable[[], bool]:
    """Return a function that is True once SIGTERM or SIGINT came, or `seconds` have passed.

    From here on the two signals end nothing by themselves; None: only they count.
    """
    asked: list[int] = []

    def on_signal(number: int, _frame: FrameType | None) -> None:
        asked.append(number)

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, on_signal)
    end_s = None if seconds is None else time.monotonic() + seconds

    def over() -> bool:
        return bool(asked) or (end_s is not None and time.monotonic() > end_s)

    return over
