"""Time for the loop: the monotonic clock, or a virtual one that a simulation sets."""

import time
from typing import Protocol


class Clock(Protocol):
    """Seconds on a clock that never goes back."""

    def now(self) -> float:
        """Return the time [s]."""
        ...

    def wall_ns(self) -> int:
        """Return the time of day [ns since 1970]: for stamps of records, and nothing else."""
        ...


class MonotonicClock:
    """The machine's monotonic clock."""

    def now(self) -> float:
        """Return the time [s]."""
        return time.monotonic()

    def wall_ns(self) -> int:
        """Return the time of day [ns since 1970]."""
        return time.time_ns()

    def sleep_until(self, deadline_s: float) -> None:
        """Sleep until an absolute time [s]; return at once when it has passed."""
        left = deadline_s - time.monotonic()
        if left > 0:
            time.sleep(left)


class VirtualClock:
    """A clock that stands until it is set."""

    def __init__(self) -> None:
        self.time_s = 0.0

    def now(self) -> float:
        """Return the time [s]."""
        return self.time_s

    def wall_ns(self) -> int:
        """Return the virtual time [ns]."""
        return round(self.time_s * 1e9)
