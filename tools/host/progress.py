"""Progress on a terminal, of what takes longer than one cares to wait without a word."""

from collections.abc import Iterable
from typing import Final, TypeVar

from tqdm import tqdm

SHOWN_AFTER_S: Final = 2.0  # time after which progress is shown [s]

Item = TypeVar("Item")


def counted(items: Iterable[Item], what: str, unit: str) -> Iterable[Item]:
    """Return the same items; on a terminal a line says how many there were, until they end."""
    shown: Iterable[Item] = tqdm(
        items, desc=what, unit=f" {unit}", delay=SHOWN_AFTER_S, disable=None, leave=False
    )
    return shown
