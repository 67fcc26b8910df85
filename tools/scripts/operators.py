"""Operators of a script: each with a client, a connection of its own, and perhaps a handle."""

from collections.abc import Callable, Iterator
from functools import partial

from ...config.schema.network import ReflectionSection
from ...protocols import topics as t
from ...protocols.messages.messages import Reflection
from ...protocols.messages.telemetry import State
from ..client.protocol_client import Ask, ProtocolClient, Put
from ..reflect.client import ReflectingClient
from .generators.delay_line import Conditions, DelayLine
from .generators.handles import Handles
from .generators.master import MasterHandle
from .generators.tables import HandleMotion, LinkConditions, MovingMaster, Network


class Operators:
    """All operators of one script, by name; told the time and what the daemon sends."""

    def __init__(
        self,
        cell: str,
        put: Put,
        ask: Ask,
        network: Network,
        reflection: ReflectionSection | None,
        new_key: Callable[[], bytes],
    ) -> None:
        self.handles = Handles(reflection)
        self._cell, self._put, self._ask, self._new_key = cell, put, ask, new_key
        self._network = network
        self._now_s = 0.0
        self._lines: dict[str, DelayLine] = {}
        self._clients: dict[str, ProtocolClient] = {}
        self._masters: dict[str, MasterHandle] = {}

    def __iter__(self) -> Iterator[ProtocolClient]:
        return iter(self._clients.values())

    def __getitem__(self, name: str) -> ProtocolClient:
        """Return an operator's client; a new operator is connected first."""
        client = self._clients.get(name)
        if client is None:
            client = self._clients[name] = self._connected(name)
        return client

    def on_state(self, state: State) -> None:
        """Send a state down every operator's line."""
        for client in self:
            arrive = partial(self._arrive, client, state)
            self._lines[client.name].carry(arrive, self._now_s, t.STATE.key)

    def on_reflection(self, news: Reflection) -> None:
        """Send the force of reflection down the line of every operator with a handle."""
        for name, handle in self.handles.of_operator.items():
            arrive = partial(self._feel, handle, news)
            self._lines[name].carry(arrive, self._now_s, t.REFLECTION.key)

    def receive(self, now_s: float) -> None:
        """Deliver what has arrived on the lines by now."""
        self._now_s = now_s
        for line in self._lines.values():
            line.run(now_s)

    def run(self, now_s: float) -> None:
        """Move all handles on, and send keepalives and streams that are due."""
        self.handles.run(now_s)
        for client in self:
            client.run(now_s)

    def connect(self, name: str, to: LinkConditions) -> None:
        """Change an operator's connection; what is under way arrives as before."""
        self._lines[name].set(Conditions(to.delay_s, to.jitter, to.loss, to.cut))

    def move_master(self, name: str, step: MovingMaster) -> None:
        """Move an operator's master device on at a twist, and stream its pose."""
        master = self._masters.setdefault(name, MasterHandle())
        master.move(step.twist, step.expressed_in, self._now_s)
        self[name].stream_made(t.MASTER_POSE, master.fields)

    def move_device(self, name: str, step: HandleMotion) -> None:
        """Move an operator's reflecting handle. Raises `ValueError` in a cell without them."""
        self.handles.take(step, self[name], self._now_s)

    def _arrive(self, client: ProtocolClient, state: State) -> None:
        client.on_state(state)
        self.handles.on_state(client.name, state, self._now_s)

    def _feel(self, handle: ReflectingClient, news: Reflection) -> None:
        handle.on_reflection(news, self._now_s)

    def _connected(self, name: str) -> ProtocolClient:
        """Return a client whose connection is a line of its own, both ways."""
        network = self._network
        conditions = Conditions(0.5 * network.rtt_s, network.jitter, network.loss)
        line = self._lines[name] = DelayLine(network.seed + len(self._lines), conditions)

        def put(topic: t.Topic, payload: bytes, proof: bytes) -> None:
            self.handles.sent(name, topic, client.seq, self._now_s)
            line.carry(lambda: self._put(topic, payload, proof), self._now_s, topic.key)

        def ask(
            topic: t.Topic, payload: bytes, answer: Callable[[bytes], None], proof: bytes
        ) -> None:
            def back(reply: bytes) -> None:
                line.carry(lambda: answer(reply), self._now_s)

            line.carry(lambda: self._ask(topic, payload, back, proof), self._now_s)

        client = ProtocolClient(name, self._cell, put, ask, self._new_key)
        return client
