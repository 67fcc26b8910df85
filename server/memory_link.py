"""An operators' network inside one process, for simulation: the same bytes, no Zenoh."""

from collections import deque
from collections.abc import Callable, Iterator

from ..protocols.topics import Flow, Topic
from .link import Asked, Put


class MemoryLink:
    """Both ends of the network: the cycle polls it, an operator in the same process uses it."""

    def __init__(self) -> None:
        self._commands: dict[str, deque[Put]] = {}
        self._requests: deque[Asked] = deque()
        self._listeners: list[Callable[[Topic, bytes], None]] = []

    def put(self, topic: Topic, payload: bytes, proof: bytes = b"") -> None:
        """Send as an operator or a sensor; newest wins, as in Zenoh's ring channels."""
        if topic.flow not in (Flow.COMMAND, Flow.SENSOR):
            raise ValueError(f"{topic.key} is no command")
        box = self._commands.setdefault(topic.key, deque(maxlen=topic.unread))
        box.append(Put(topic, payload, proof))

    def ask(
        self, topic: Topic, payload: bytes, answer: Callable[[bytes], None], proof: bytes = b""
    ) -> None:
        """Send a request as an operator; `answer` is called with the reply's bytes."""
        self._requests.append(Asked(topic, payload, answer, proof))

    def listen(self, listener: Callable[[Topic, bytes], None]) -> None:
        """Hand all telemetry to a listener as it is published."""
        self._listeners.append(listener)

    def commands(self) -> Iterator[Put]:
        """Yield the commands and sensor readings that came in, oldest first on each topic."""
        for box in self._commands.values():
            while box:
                yield box.popleft()

    def requests(self) -> Iterator[Asked]:
        """Yield the requests that came in."""
        while self._requests:
            yield self._requests.popleft()

    def publish(self, topic: Topic, payload: bytes) -> None:
        """Send telemetry."""
        for listener in self._listeners:
            listener(topic, payload)

    def close(self) -> None:
        """Forget everybody."""
        self._listeners.clear()
