"""The scanner's clock beside the daemon's: neither is the other's, and messages of both come late.

Of either the message that came soonest tells most: how its stamp differs from the clock of who
listens is then the least. The clocks may drift apart.
"""

import math
from typing import Final

DRIFT: Final = 1e-4
"""Clocks drift apart by at most [s/s]."""
WRAPS: Final = 1 << 32
"""The scanner's clock counts up to that [µs]."""
FORGET_S: Final = 2.0
"""A stamp that is off by more is another clock's: one of the two started again [s]."""


class _Least:
    """The least difference of arrival and stamp."""

    def __init__(self) -> None:
        self.least, self._last_s = math.inf, 0.0

    def hear(self, arrived_s: float, stamp_s: float) -> None:
        late_s = arrived_s - stamp_s
        if abs(late_s - self.least) > FORGET_S:
            self.least = late_s
        self.least = min(self.least + DRIFT * (arrived_s - self._last_s), late_s)
        self._last_s = arrived_s


class Clocks:
    """Tells when a scan began, on the daemon's clock, by what was heard of both."""

    def __init__(self) -> None:
        self._daemon, self._scanner = _Least(), _Least()
        self._sent_us: int | None = None

    def hear_daemon(self, arrived_s: float, time_s: float) -> None:
        """Note when a message of a tick at `time_s` arrived, on the clock of who listens."""
        self._daemon.hear(arrived_s, time_s)

    def hear_scanner(self, arrived_s: float, start_us: int, sent_us: int) -> float | None:
        """Return when a scan began on the daemon's clock [s]; None before a tick was heard."""
        last = self._sent_us
        turns = 0 if last is None else round((last - sent_us) / WRAPS)
        self._sent_us = sent_us + turns * WRAPS
        self._scanner.hear(arrived_s, self._sent_us * 1e-6)
        if math.isinf(self._daemon.least):
            return None
        began_s = (self._sent_us - (sent_us - start_us) % WRAPS) * 1e-6
        return began_s + self._scanner.least - self._daemon.least
