"""An operators' network in one process, for simulation: no Zenoh, commands are the same bytes."""

from collections import deque
from collections.abc import Callable

from ...protocols.messages.messages import Message
from ...protocols.topics import TICK, Flow, Topic
from ...server.operators.link import RawMessage, Receive, room


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

    def room(self, topic: Topic) -> int:
        """Return how many messages of a topic wait at most."""
        return room(topic)

    def source(self, topic: Topic) -> Receive:
        """Return what takes the messages of a topic, one at a time."""
        ring = self._ring(topic)
        return lambda: ring.popleft() if ring else None

    def publish(self, topic: Topic, message: Message) -> None:
        """Send telemetry."""
        for listener in self._listeners:
            listener(topic, message)

    def heard(self, topic: Topic) -> bool:
        """Return whether anybody listens; nobody to ticks, which a recorder has from the cycle."""
        return bool(self._listeners) and topic is not TICK

    def close(self) -> None:
        """Forget everybody."""
        self._listeners.clear()

    def _ring(self, topic: Topic) -> deque[RawMessage]:
        return self._rings.setdefault(topic.key, deque(maxlen=room(topic)))
