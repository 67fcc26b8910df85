"""Carrier of an operator's messages: a Zenoh session, or a simulation's own link."""

from collections.abc import Callable, Iterator
from typing import Protocol

from ...protocols import topics as t


class Buffer(Protocol):
    """Messages of one topic since the last look."""

    def take(self) -> Iterator[bytes]:
        """Yield the payloads that wait, oldest first."""
        ...

    def close(self) -> None:
        """Listen no more."""
        ...


class MessageCarrier(Protocol):
    """Carrier of an operator's messages, polled."""

    @property
    def shown(self) -> str | None:
        """Common name of the certificate that is shown; None without one."""
        ...

    def subscribe(self, topic: t.Topic, depth: int) -> Buffer:
        """Listen to a topic, keeping the newest `depth` messages between two looks."""
        ...

    def put(self, topic: t.Topic, payload: bytes, proof: bytes = b"") -> None:
        """Send a command."""
        ...

    def ask(
        self, topic: t.Topic, payload: bytes, answer: Callable[[bytes], None], proof: bytes = b""
    ) -> None:
        """Send a request; `poll` hands its reply to `answer`."""
        ...

    def poll(self) -> None:
        """Hand over the replies that have come."""
        ...

    def close(self) -> None:
        """Close the line."""
        ...
