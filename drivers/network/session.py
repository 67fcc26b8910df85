"""Carrier of an operator's messages: its interface, and a Zenoh session. All of it is polled."""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import zenoh

from ...protocols import topics as t
from ...protocols.codec import encode
from ...protocols.messages import requests
from ...protocols.roles import sender_name
from .identity import Identity
from .sessions import client_config

REPLY_TIMEOUT_S = 5.0
"""A request that is not answered by then will not be [s]."""


class NotCertified(Exception):
    """The process's certificate does not allow to send on a topic."""


class Buffer(Protocol):
    """Messages of one topic since the last look."""

    def take(self) -> Iterator[bytes]:
        """Yield the payloads that wait, oldest first."""
        ...

    def close(self) -> None: ...


class MessageCarrier(Protocol):
    """Carrier of an operator's messages: a Zenoh session, or a simulation's own line."""

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

    def poll(self) -> None: ...

    def close(self) -> None: ...


class TopicBuffer:
    """Messages of one topic since the last look; the oldest give way to newer ones.

    What was put on an expression with a wildcard was put by no daemon, whatever it matches.
    """

    def __init__(
        self,
        subscriber: "zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]",
        topic: t.Topic,
        cell: str,
    ) -> None:
        self._subscriber = subscriber
        self._topic, self._cell = topic, cell

    def close(self) -> None:
        """Listen no more."""
        self._subscriber.undeclare()  # type: ignore[no-untyped-call]  # its stubs

    def take(self) -> Iterator[bytes]:
        """Yield the payloads that wait, oldest first."""
        while (sample := self._subscriber.try_recv()) is not None:
            sender = self._topic.sender_on(str(sample.key_expr), self._cell)
            if sender is not None and len(sample.payload) <= self._topic.max_bytes:
                yield sample.payload.to_bytes()


@dataclass(frozen=True)
class _Waiting:
    """A request that was sent and is not answered yet."""

    replies: "zenoh.handlers.Handler[zenoh.Reply]"
    answer: Callable[[bytes], None]
    deadline_s: float


class Session:
    """A client session with one cell's daemon. Raises `ConnectionError` if nobody answers."""

    def __init__(self, cell: str, endpoint: str, identity: Identity | None = None) -> None:
        self.cell = cell
        self.shown = None if identity is None else identity.certificate.name
        """Common name of the certificate that is shown; None without one."""
        may = None if identity is None else identity.certificate.rights
        self._may = None if may is None else may.puts | may.asks
        self._hears = None if may is None else may.hears
        try:
            config = client_config(endpoint, cell, identity)
        except zenoh.ZError:
            raise ConnectionError(
                f"{endpoint} is no Zenoh endpoint, such as tcp/127.0.0.1:7447"
            ) from None
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError:
            shown = "" if self.shown is None else f", or not to {self.shown}"
            raise ConnectionError(f"nobody answers at {endpoint}{shown}") from None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._waiting: list[_Waiting] = []

    def subscribe(self, topic: t.Topic, depth: int) -> TopicBuffer:
        """Listen to a topic, keeping the newest `depth` messages between two looks."""
        ring: zenoh.handlers.RingChannel[zenoh.Sample] = zenoh.handlers.RingChannel(depth)
        key = topic.heard_key(self.cell)
        return TopicBuffer(self._session.declare_subscriber(key, ring), topic, self.cell)

    def may_hear(self, topic: t.Topic) -> bool:
        """Return whether the certificate allows to listen to a topic."""
        return self._hears is None or topic.heard_key(self.cell) in self._hears

    def put(self, topic: t.Topic, payload: bytes, proof: bytes = b"") -> None:
        """Send a command; a congested link drops it.

        Where keys name their sender, that is the certificate's name, if one is shown.

        Raises `NotCertified`: the network would drop it without a word.
        """
        if self.shown is not None and topic.by_sender:
            topic = topic.by(sender_name(self.shown))
        refusal = self._refusal(topic)
        if refusal:
            raise NotCertified(refusal)
        self._publisher(topic).put(payload, attachment=proof or None)

    def heard(self, topic: t.Topic) -> bool:
        """Return whether anybody listens to a topic that is put here."""
        status: Any = self._publisher(topic).matching_status  # a bool, its stubs say
        return bool(status.matching)

    def _publisher(self, topic: t.Topic) -> "zenoh.Publisher":
        key = topic.full_key(self.cell)
        publisher = self._publishers.get(key)
        if publisher is None:
            seen = topic.flow is t.Flow.PICTURE  # what people look at gives way to all else
            publisher = self._session.declare_publisher(
                key,
                priority=zenoh.Priority.BACKGROUND if seen else zenoh.Priority.REAL_TIME,
                congestion_control=zenoh.CongestionControl.DROP,
            )
            self._publishers[key] = publisher
        return publisher

    def ask(
        self, topic: t.Topic, payload: bytes, answer: Callable[[bytes], None], proof: bytes = b""
    ) -> None:
        """Send a request; `poll` hands its reply, or one that says nobody answered, to `answer`.

        The reply to a request that this process is not certified for comes at once: the network
        would drop it without a word.
        """
        refusal = self._refusal(topic)
        if refusal:
            answer(encode(requests.Reply(ok=False, reason="not_certified", detail=refusal)))
            return
        channel: zenoh.handlers.FifoChannel[zenoh.Reply] = zenoh.handlers.FifoChannel(2)
        replies = self._session.get(
            topic.full_key(self.cell),
            channel,
            payload=payload,
            attachment=proof or None,
            timeout=REPLY_TIMEOUT_S,
        )
        self._waiting.append(_Waiting(replies, answer, time.monotonic() + REPLY_TIMEOUT_S))

    def poll(self) -> None:
        """Hand over the replies that have come."""
        for waiting in tuple(self._waiting):
            payload = _reply(waiting)
            if payload is not None:
                self._waiting.remove(waiting)
                waiting.answer(payload)

    def _refusal(self, topic: t.Topic) -> str:
        """Return in words that the certificate does not allow to send on a topic, if so."""
        key = topic.full_key(self.cell)
        allowed = self._may is None or topic.put_key(self.cell) in self._may
        return "" if allowed else f"{self.shown} may not send on {key}"

    def close(self) -> None:
        """Close the session."""
        self._session.close()  # type: ignore[no-untyped-call]


def _reply(waiting: _Waiting) -> bytes | None:
    """Return the reply that came, that none will come, or None while it may still come."""
    closed = False
    try:
        reply = waiting.replies.try_recv()
    except zenoh.ZError:
        reply, closed = None, True
    if reply is not None and reply.ok is not None:
        return reply.ok.payload.to_bytes()
    if closed or reply is not None or time.monotonic() > waiting.deadline_s:
        return encode(
            requests.Reply(ok=False, reason="no_answer", detail="the daemon did not answer")
        )
    return None
