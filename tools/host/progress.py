"""Words of a command while it works: lines beside its result, and progress of what takes long."""

import math
import sys
import time
from collections.abc import Callable, Iterable
from typing import Final, TypeVar

from tqdm import tqdm

from ...config.errors import printable

SHOWN_AFTER_S: Final = 2.0  # time after which progress is shown [s]

Item = TypeVar("Item")


def counted(items: Iterable[Item], what: str, unit: str) -> Iterable[Item]:
    """Return the same items; on a terminal a line says how many there were, until they end."""
    shown: Iterable[Item] = tqdm(
        items, desc=what, unit=f" {unit}", delay=SHOWN_AFTER_S, disable=None, leave=False
    )
    return shown


def say(line: str) -> None:
    """Print a line that is no result, whoever worded it."""
    print(printable(line), file=sys.stderr, flush=True)


class Sparing:
    """Says what comes often: at most every so many seconds, and how many more there were."""

    def __init__(
        self,
        every_s: float,
        say: Callable[[str], None] = say,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._every_s, self._say, self._clock = every_s, say, clock
        self._next_s = -math.inf
        self._left_out = 0

    def __call__(self, why: str) -> None:
        """Tell of one, now or as a part of the next line's count."""
        now_s = self._clock()
        if now_s < self._next_s:
            self._left_out += 1
            return
        more = f" (and {self._left_out} more before)" if self._left_out else ""
        self._say(f"telerobot: {why}{more}")
        self._next_s, self._left_out = now_s + self._every_s, 0
