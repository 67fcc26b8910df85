"""A transmit PDO that is sent when what it maps has changed (CiA 301, 7.5.2.37).

Transmission type 0: at the SYNC after the change. 254, 255: at once, but no sooner than the inhibit
time after the one before, and at the latest when the event timer has run out.
"""

from typing import Final

from .objects import ObjectStore
from .pdo import Pdo

INHIBIT_S: Final = 1e-4
"""Unit of the inhibit time, sub-index 3 [s]."""
TIMER_S: Final = 1e-3
"""Unit of the event timer, sub-index 5 [s]."""


class EventPdo:
    """Memory of one such PDO: what was sent last, and when."""

    def __init__(self, pdo: Pdo) -> None:
        self.pdo = pdo
        self.at_sync = pdo.transmission == 0
        self._told: bytes | None = None
        self._told_s = 0.0

    def due(self, store: ObjectStore, now_s: float) -> bytes | None:
        """Return the data to be sent now; None while nothing has changed, or too soon."""
        data = self.pdo.pack(store)
        elapsed = now_s - self._told_s + 1e-7
        if self._told is not None and not self.at_sync:
            inhibit, timer = self.pdo.inhibit * INHIBIT_S, self.pdo.timer * TIMER_S
            late = 0.0 < timer <= elapsed
            if elapsed < inhibit or (data == self._told and not late):
                return None
        elif data == self._told:
            return None
        self._told, self._told_s = data, now_s
        return data
