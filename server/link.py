"""The operators' network: what the cycle sees of it, and Zenoh behind it.

Everything is polled. Commands wait in ring channels, newest wins, so no backlog is ever executed
and no Python thread but the loop's own runs in the daemon.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import zenoh

from ..drivers.device import DeviceError
from ..drivers.network.identity import Identity
from ..drivers.network.sessions import client_config, router_config
from ..protocols.roles import every_request
from ..protocols.topics import COMMANDS, REQUESTS, SENSORS, Topic

REQUEST_BOX = 32
"""Unread requests that are kept."""


@dataclass(frozen=True)
class Asked:
    """A request that waits for its answer."""

    topic: Topic
    payload: bytes
    answer: Callable[[bytes], None]
    proof: bytes = b""
    """What was attached: a proof of the lease, judged by nobody yet."""


class Put(NamedTuple):
    """A command or a sensor's reading."""

    topic: Topic
    payload: bytes
    proof: bytes = b""
    """What was attached: a proof of the lease, judged by nobody yet."""


class Link(Protocol):
    """The network as the cycle uses it; nothing here blocks."""

    def commands(self) -> Iterator[Put]:
        """Yield the commands and sensor readings that came in, oldest first on each topic."""
        ...

    def requests(self) -> Iterator[Asked]:
        """Yield the requests that came in."""
        ...

    def publish(self, topic: Topic, payload: bytes) -> None:
        """Send telemetry."""
        ...

    def close(self) -> None:
        """Let go of the network."""
        ...


class ZenohLink:
    """A Zenoh session for one cell: a router, or with `dials` a client of another one.

    Raises `DeviceError` where it cannot listen, or nobody answers.
    """

    def __init__(
        self, cell: str, endpoint: str, identity: Identity | None = None, dials: bool = False
    ) -> None:
        config = client_config if dials else router_config
        try:
            self._session = zenoh.open(config(endpoint, cell, identity))
        except zenoh.ZError as error:
            # Zenoh's own words end in places of its source.
            cause = re.sub(r" at \S+\.rs:\d+\.?", "", str(error))
            key = "router" if dials else "listen"
            raise DeviceError(f"zenoh.{key}: value {endpoint!r}: {cause}") from None
        ring = zenoh.handlers.RingChannel
        # A channel for each command, so that a flood of one crowds out no other; one for all
        # requests, so that they are answered as they came.
        self._commands = [
            (topic, self._session.declare_subscriber(topic.full_key(cell), ring(topic.unread)))
            for topic in (*COMMANDS, *SENSORS)
        ]
        self._requests = self._session.declare_queryable(every_request(cell), ring(REQUEST_BOX))
        self._by_key = {topic.full_key(cell): topic for topic in REQUESTS}
        self._cell = cell
        self._publishers: dict[str, zenoh.Publisher] = {}

    def commands(self) -> Iterator[Put]:
        """Yield the commands and sensor readings that came in, oldest first on each topic."""
        for topic, subscriber in self._commands:
            for _ in range(topic.unread):
                sample = subscriber.try_recv()
                if sample is None:
                    break
                yield Put(topic, sample.payload.to_bytes(), _bytes(sample.attachment))

    def requests(self) -> Iterator[Asked]:
        """Yield the requests that came in, oldest first."""
        for _ in range(REQUEST_BOX):
            query = self._requests.try_recv()
            if query is None:
                return
            key = str(query.key_expr)
            topic = self._by_key.get(key)
            if topic is None:
                query.drop()  # type: ignore[no-untyped-call]  # its stubs
                continue
            yield Asked(topic, _bytes(query.payload), _answer(query, key), _bytes(query.attachment))

    def publish(self, topic: Topic, payload: bytes) -> None:
        """Send telemetry. Nothing here may wait for a slow reader: what does not fit is dropped,
        and event ids tell the reader that something is missing.
        """
        publisher = self._publishers.get(topic.key)
        if publisher is None:
            publisher = self._session.declare_publisher(
                topic.full_key(self._cell),
                priority=zenoh.Priority.REAL_TIME,
                congestion_control=zenoh.CongestionControl.DROP,
            )
            self._publishers[topic.key] = publisher
        publisher.put(payload)

    def close(self) -> None:
        """Close the session."""
        self._session.close()  # type: ignore[no-untyped-call]  # its stubs


def _bytes(content: "zenoh.ZBytes | None") -> bytes:
    return b"" if content is None else content.to_bytes()


def _answer(query: "zenoh.Query", key: str) -> Callable[[bytes], None]:
    def answer(payload: bytes) -> None:
        query.reply(key, payload)
        query.drop()  # type: ignore[no-untyped-call]  # its stubs

    return answer
