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


def sparing(
    every_s: float, say: Callable[[str], None] = say, clock: Callable[[], float] = time.monotonic
) -> Callable[[str], None]:
    """Return what says a line at most every so many seconds, and how many more there were."""
    next_s, left_out = -math.inf, 0

    def tell(why: str) -> None:
        nonlocal next_s, left_out
        now_s = clock()
        if now_s < next_s:
            left_out += 1
            return
        more = f" (and {left_out} more before)" if left_out else ""
        say(f"telerobot: {why}{more}")
        next_s, left_out = now_s + every_s, 0

    return tell
