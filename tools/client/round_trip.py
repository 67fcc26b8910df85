"""Round trip: from a command to the telemetry that shows it accepted. Pure."""

from collections import deque
from collections.abc import Mapping

REMEMBERED = 512
"""Commands per key whose echo is waited for [1]."""


class RoundTrip:
    """Pairs what was sent with the sequence numbers that telemetry echoes."""

    def __init__(self) -> None:
        self._sent: dict[str, deque[tuple[int, float]]] = {}
        self.seconds: float | None = None
        """From sending a command to seeing its echo, the newest one [s]; None before the first."""
        self.heard_s: float | None = None
        """Time of the newest echo [s]."""

    def sent(self, key: str, seq: int, now_s: float) -> None:
        """Note that a command was sent."""
        self._sent.setdefault(key, deque(maxlen=REMEMBERED)).append((seq, now_s))

    def echoed(self, last_seq: Mapping[str, int], now_s: float) -> None:
        """Take in the newest accepted sequence number of every key."""
        for key, seq in last_seq.items():
            sent = self._sent.get(key, deque())
            while sent and sent[0][0] <= seq:
                number, since_s = sent.popleft()
                if number == seq:
                    self.seconds, self.heard_s = now_s - since_s, now_s
