"""The operators' network: its interface to the daemon, over Zenoh and in memory, who may see it."""

import contextlib
import os
import re
import threading
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from queue import SimpleQueue
from typing import Any, Final, Literal, NamedTuple, Protocol

import zenoh

from ...config.schema.network import ZenohSection
from ...drivers.device import DeviceError
from ...drivers.network.certificates import known
from ...drivers.network.identity import Identity
from ...drivers.network.sessions import Hearing, member_config, router_config
from ...protocols.codec import encode
from ...protocols.messages.messages import Message
from ...protocols.topics import COMMANDS, REQUESTS, SENSORS, TICK, Flow, Topic
from ..events import Events
from ..process import PRIORITY

# --- Exposure of the operators' network: warnings where it is open to all, or soon to nobody ------


def network(zenoh: ZenohSection) -> Literal["local", "certified", "insecure"]:
    """Return who may speak to a daemon: this machine, who shows a certificate, or anybody."""
    if zenoh.exposed:
        return "insecure"
    return "local" if zenoh.security.directory is None else "certified"


def exposure(zenoh: ZenohSection) -> list[str]:
    """Return in words that anybody who reaches the daemon may command; empty if not so."""
    if network(zenoh) != "insecure":
        return []
    return [
        f"INSECURE: {zenoh.endpoint} reaches beyond this machine without certificates: "
        "anybody there may read, command and stop this arm"
    ]


def opening_events(zenoh: ZenohSection) -> Events:
    """Return the events of a run that begins; the first says that anybody may command."""
    events = Events()
    for words in exposure(zenoh):
        events.standing("insecure", words, endpoint=zenoh.endpoint)
    return events


def doubts(identity: Identity | None) -> list[str]:
    """Return in words which certificates of the daemon's folder end soon, or are of no use."""
    return [] if identity is None else known(identity.folder)[1]


# --- Answers to requests, sent by a thread of their own, because a hand-over to Zenoh may block ---
#
# Even to let go of a request waits, for locks that Zenoh's threads hold, or for room on the way
# to who asked. A tick shall not. This thread does nothing else, and knows nothing of the
# daemon.

MOST: Final = 1024
"""While more answers wait than this, no further requests are taken in [1]."""

END_S: Final = 2.0
"""Answers that are under way at the end are waited for [s]."""


class AnswerThread:
    """Sends answers, or lets requests go without one, in the order in which they are given."""

    def __init__(self) -> None:
        self._waiting: SimpleQueue[tuple[zenoh.Query, str, bytes | None] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="answers", daemon=True)
        self._thread.start()

    @property
    def crowded(self) -> bool:
        """True while so many wait that no more requests should be taken in."""
        return self._waiting.qsize() > MOST

    def give(self, query: "zenoh.Query", key: str, payload: bytes | None) -> None:
        """Answer a request on a key, or with None let it go; returns at once."""
        self._waiting.put((query, key, payload))

    def close(self) -> None:
        """Send what waits, and end."""
        self._waiting.put(None)
        self._thread.join(END_S)

    def _run(self) -> None:
        # Who waits for this thread is the loop, for the interpreter's lock: ordinary threads must
        # not keep it from giving that back. Where it is denied, the loop's own notice says so.
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY - 1))
        while (given := self._waiting.get()) is not None:
            query, key, payload = given
            with contextlib.suppress(zenoh.ZError):  # who asked is gone
                if payload is not None:
                    query.reply(key, payload)
            query.drop()  # type: ignore[no-untyped-call]  # its stubs


# --- The operators' network: its interface to the daemon, and Zenoh's implementation --------------
#
# Everything is polled. Messages wait in ring channels, one for each topic, newest wins, so no
# backlog is ever executed, and a flood on one key crowds out no other. No Python thread but the
# loop's own runs in the daemon, and one that sends answers.

RING: Final = 128
"""Messages of a topic that wait to be sorted: 12,800 a second at 100 Hz [1]."""

Answer = Callable[[bytes | None], None]
"""Answers a request; with None it ends without an answer."""


class Content(Protocol):
    """Bytes that are not copied yet."""

    def __len__(self) -> int:
        """Return how many there are."""
        ...

    def __bytes__(self) -> bytes:
        """Copy them."""
        ...


class RawMessage(NamedTuple):
    """A message as it came in."""

    payload: Content
    attached: Content = b""
    """A proof of the lease, judged by nobody yet."""
    answer: Answer | None = None
    """Of a request."""
    sender: str = ""
    """Name in the key, of a topic whose keys name their senders; else empty."""


class Source(NamedTuple):
    """What takes the messages of a topic: `poll` costs nothing where none waits."""

    poll: Callable[[], Any]
    """Returns the oldest message that waits, as the network has it; None without one."""
    read: Callable[[Any], RawMessage | None]
    """Returns such a message; None for one that is let go of unread."""


class Link(Protocol):
    """The network as the cycle uses it; nothing here blocks."""

    @property
    def crowded(self) -> bool:
        """True while so many answers wait that no more requests should be taken in."""
        ...

    def source(self, topic: Topic) -> Source:
        """Return what takes the messages of a topic, one at a time."""
        ...

    def publish(self, topic: Topic, message: Message) -> None:
        """Send telemetry."""
        ...

    def heard(self, topic: Topic) -> bool:
        """Return whether anybody listens to a telemetry topic, as far as the network knows."""
        ...

    def close(self) -> None:
        """Let go of the network."""
        ...


def room(topic: Topic) -> int:
    """Return how many messages of a topic wait at most until they are sorted.

    A sensor's are not sorted, and wait where they are.
    """
    return topic.unread if topic.flow is Flow.SENSOR else RING


class ZenohLink:
    """A Zenoh session for one cell: a router, or with `dials` a client of another one.

    Raises `DeviceError` where it cannot listen, or nobody answers.
    """

    def __init__(
        self, cell: str, endpoint: str, identity: Identity | None = None, dials: bool = False
    ) -> None:
        config = member_config if dials else router_config
        try:
            self._session = zenoh.open(config(endpoint, cell, identity))
        except zenoh.ZError as error:
            # Zenoh's own words end in places of its source.
            cause = re.sub(r" at \S+\.rs:\d+\.?", "", str(error))
            key = "router" if dials else "listen"
            raise DeviceError(f"zenoh.{key}: value {endpoint!r}: {cause}") from None
        ring = zenoh.handlers.RingChannel
        self._puts = {
            topic.key: self._session.declare_subscriber(topic.heard_key(cell), ring(room(topic)))
            for topic in (*COMMANDS, *SENSORS)
        }
        self._queries = {
            topic.key: self._session.declare_queryable(topic.full_key(cell), ring(room(topic)))
            for topic in REQUESTS
        }
        self._cell = cell
        self._answers = AnswerThread()
        self._keys = {topic.key: topic.full_key(cell) for topic in REQUESTS}
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._told: dict[str, tuple[Message, bytes]] = {}
        """The newest message of each topic, and its bytes."""
        self._hearings: dict[str, Hearing] = {}

    @property
    def crowded(self) -> bool:
        """True while so many answers wait that no more requests should be taken in."""
        return self._answers.crowded

    def source(self, topic: Topic) -> Source:
        """Return what takes the messages of a topic, one at a time."""
        if topic.flow is Flow.REQUEST:
            read_request = partial(_request, self._answers, self._keys[topic.key])
            return Source(self._queries[topic.key].try_recv, read_request)
        read = partial(_signed, topic, self._cell) if topic.by_sender else _put
        return Source(self._puts[topic.key].try_recv, read)

    def publish(self, topic: Topic, message: Message) -> None:
        """Send telemetry. Nothing here may wait for a slow reader: what does not fit is dropped,
        and event ids tell the reader that something is missing. What is told again is not encoded
        again.
        """
        told = self._told.get(topic.key)
        if told is None or told[0] is not message:
            told = self._told[topic.key] = message, encode(message)
        self._publisher(topic).put(told[1])

    def heard(self, topic: Topic) -> bool:
        """Return whether anybody listens to a telemetry topic, as far as the network knows."""
        hearing = self._hearings.get(topic.key)
        if hearing is None:
            hearing = self._hearings[topic.key] = Hearing(self._publisher(topic))
        return bool(hearing)

    def _publisher(self, topic: Topic) -> "zenoh.Publisher":
        publisher = self._publishers.get(topic.key)
        if publisher is None:
            publisher = self._session.declare_publisher(
                topic.full_key(self._cell),
                priority=zenoh.Priority.REAL_TIME,
                congestion_control=zenoh.CongestionControl.DROP,
            )
            self._publishers[topic.key] = publisher
        return publisher

    def close(self) -> None:
        """Close the session."""
        self._answers.close()
        self._session.close()  # type: ignore[no-untyped-call]  # its stubs


def _put(sample: "zenoh.Sample") -> RawMessage:
    return RawMessage(sample.payload, sample.attachment or b"")


def _signed(topic: Topic, cell: str, sample: "zenoh.Sample") -> RawMessage:
    """Return a message with its sender; who puts on many keys at once is not named."""
    sender = topic.sender_on(str(sample.key_expr), cell) or ""
    return RawMessage(sample.payload, sample.attachment or b"", sender=sender)


def _request(answers: AnswerThread, key: str, query: "zenoh.Query") -> RawMessage | None:
    answer = partial(answers.give, query, key)
    if str(query.key_expr) == key:
        return RawMessage(query.payload or b"", query.attachment or b"", answer)
    answer(None)  # Who asks many keys at once is told nothing: a request goes to one.
    return None


# --- The operators' network in one process, for simulation: no Zenoh, commands are the same bytes -


class MemoryLink:
    """Both ends of the network: the cycle polls it, an operator in the same process uses it."""

    def __init__(self) -> None:
        self._rings: dict[str, deque[RawMessage]] = {}
        self._listeners: list[Callable[[Topic, Message], None]] = []

    def put(self, topic: Topic, payload: bytes, proof: bytes = b"") -> None:
        """Send as an operator or a sensor; newest wins, as in Zenoh's ring channels."""
        if topic.flow not in (Flow.COMMAND, Flow.SENSOR):
            raise ValueError(f"{topic.key} is no command")
        self._ring(topic).append(RawMessage(payload, proof, sender=topic.sender))

    def ask(
        self, topic: Topic, payload: bytes, answer: Callable[[bytes], None], proof: bytes = b""
    ) -> None:
        """Send a request as an operator; `answer` is called with the reply's bytes."""
        if topic.flow is not Flow.REQUEST:
            raise ValueError(f"{topic.key} is no request")

        def reply(content: bytes | None) -> None:
            if content is not None:
                answer(content)

        self._ring(topic).append(RawMessage(payload, proof, reply))

    def listen(self, listener: Callable[[Topic, Message], None]) -> None:
        """Hand all telemetry to a listener as it is published; messages are not encoded."""
        self._listeners.append(listener)

    crowded = False
    """No answer ever waits."""

    def source(self, topic: Topic) -> Source:
        """Return what takes the messages of a topic, one at a time."""
        ring = self._ring(topic)
        return Source(lambda: ring.popleft() if ring else None, lambda message: message)

    def publish(self, topic: Topic, message: Message) -> None:
        """Send telemetry."""
        for listener in self._listeners:
            listener(topic, message)

    def heard(self, topic: Topic) -> bool:
        """Return whether anybody listens; nobody to ticks, which a recorder has from the cycle."""
        return bool(self._listeners) and topic is not TICK

    def close(self) -> None:
        self._listeners.clear()

    def _ring(self, topic: Topic) -> deque[RawMessage]:
        return self._rings.setdefault(topic.key, deque(maxlen=room(topic)))


class MemoryBuffer:
    """Messages of one topic since the last look."""

    def __init__(self, link: MemoryLink, topic: Topic, depth: int) -> None:
        self._topic = topic
        self._kept: deque[bytes] = deque(maxlen=depth)
        link.listen(self._hear)

    def take(self) -> Iterator[bytes]:
        """Yield the payloads that wait, oldest first."""
        while self._kept:
            yield self._kept.popleft()

    def close(self) -> None:
        """Listen no more."""
        self._kept = deque(maxlen=0)

    def _hear(self, topic: Topic, message: Message) -> None:
        if topic is self._topic:
            self._kept.append(encode(message))


class MemoryLine:
    """An operator's end of a simulation's link. What is sent is heard in the next tick."""

    def __init__(self, link: MemoryLink) -> None:
        self._link, self.put, self.ask = link, link.put, link.ask
        self.shown: str | None = None
        """No certificate is shown."""

    def subscribe(self, topic: Topic, depth: int) -> MemoryBuffer:
        """Listen to a topic, keeping the newest `depth` messages between two looks."""
        return MemoryBuffer(self._link, topic, depth)

    def poll(self) -> None:
        """Do nothing: replies are handed over within the tick that makes them."""

    def close(self) -> None:
        """Do nothing: the link ends with its simulation."""
