"""Streams: commands that hold only while they are news, as a stick's twist."""

from typing import Generic, TypeVar

from ...protocols.messages import messages as m

MessageT = TypeVar("MessageT", bound=m.Command)


class Stream(Generic[MessageT]):
    """The newest message of one stream; it is in force for `timeout_s` after it came."""

    def __init__(self, timeout_s: float) -> None:
        self._timeout_s = timeout_s
        self._newest: MessageT | None = None
        self._since_s = 0.0

    def take(self, message: MessageT, now_s: float) -> None:
        """Put a message in force."""
        self._newest, self._since_s = message, now_s

    def newest(self, now_s: float) -> MessageT | None:
        """Return the message in force, None once it is too old."""
        return None if now_s - self._since_s > self._timeout_s else self._newest

    def expire(self, now_s: float) -> MessageT | None:
        """Forget a message that is too old and return it; None where there is none."""
        if self._newest is None or self.newest(now_s) is not None:
            return None
        expired, self._newest = self._newest, None
        return expired

    def clear(self) -> None:
        """Forget the message."""
        self._newest = None
