"""Live connection of an operator to a daemon: session, telemetry, keepalive, streams, lease."""

import time
from collections.abc import Callable
from pathlib import Path

from ...config.load import Cell, load_cell
from ...drivers.network.identity import identity_of
from ...drivers.network.session import NotCertified, Session
from ...protocols import topics as t
from ...protocols.codec import CodecError, decode_as, encode
from ...protocols.messages.messages import Reflection
from ...protocols.messages.perception import RigMotion
from ...protocols.messages.rig import RigFault
from ...protocols.messages.telemetry import Description, Event, State
from ...protocols.topics import Role
from ...server.process import Clock, MonotonicClock
from ..host.address import moved
from .line import MessageCarrier
from .protocol_client import ProtocolClient
from .round_trip import RoundTrip

POLL_S = 0.002


def ignore(_told: object) -> None:
    """Take in what is told, and do nothing."""


class OperatorError(Exception):
    """The daemon refused, or did not answer: carries the reason by name."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason = reason
        self.detail = detail


class Connection:
    """A session that reads telemetry and sends what is due, inside `spin` and `turn`."""

    def __init__(
        self,
        cell: str | Cell,
        endpoint: str | None = None,
        name: str = "operator",
        identity: str | Path | None = None,
    ) -> None:
        loaded = cell if isinstance(cell, Cell) else load_cell(cell)
        loaded = moved(loaded, endpoint=endpoint, identity=identity)
        self.endpoint = loaded.config.zenoh.dialled
        shown = identity_of(loaded, Role.OPERATOR, name)
        try:
            session = Session(loaded.config.name, self.endpoint, shown)
        except ConnectionError as error:
            raise OperatorError("no_daemon", str(error)) from None
        self._begin(loaded, name, session, MonotonicClock())

    def _begin(self, cell: Cell, name: str, session: MessageCarrier, clock: Clock) -> None:
        """Listen to a cell's daemon over a line that is open."""
        self.cell = cell.config.name
        self.session, self.clock = session, clock
        # Of what is true only now, the newest that can be read; junk between does not push it out.
        depths = {t.STATE: 64, t.REFLECTION: 64, t.EVENT: 256, t.DESCRIPTION: 8}
        self._inboxes = {topic: session.subscribe(topic, n) for topic, n in depths.items()}
        self.client = ProtocolClient(name, self.cell, self._put, session.ask)
        self.description: Description | None = None
        """The daemon's description of its cell; comes within a second."""
        self.round_trip = RoundTrip()
        self.state_since_s: float | None = None
        """Time of reading the newest state, on `clock` [s]."""
        self.on_state: Callable[[State], None] = ignore
        """Called with every state that is read."""
        self.on_event: Callable[[Event], None] = ignore
        """Called with every event that is read."""
        self.on_reflection: Callable[[Reflection], None] = ignore
        """Called with every force for the handle that is read; none come of most cells."""
        self.reflection = cell.config.reflection
        """Section `[reflection]` of the cell."""

    @property
    def state(self) -> State | None:
        """The newest state that was read."""
        return self.client.state

    @property
    def events(self) -> list[Event]:
        """All events that were read."""
        return self.client.events

    @property
    def holds_lease(self) -> bool:
        """True from the grant of the lease until it is released or telemetry shows it lost."""
        return self.client.secret is not None

    def spin(self, seconds: float = 0.0, until: Callable[[], bool] | None = None) -> bool:
        """Keep the session alive for a while, or until something holds; return whether it did."""
        end = self.clock.now() + seconds
        while True:
            self.turn()
            if until is not None and until():
                return True
            if self.clock.now() >= end:
                return until is None
            self._rest()

    def turn(self) -> None:
        """Read what came in and send what is due, once; waits for nothing."""
        for topic, inbox in self._inboxes.items():
            payloads = list(inbox.take())
            if topic.life is not t.Life.STREAM:
                for payload in payloads:
                    self._take(topic, payload)
            elif payloads:
                any(self._take(topic, payload) for payload in reversed(payloads))
        self.session.poll()
        self.client.run(self.clock.now())

    def inject(self, fault: RigFault | RigMotion) -> None:
        """Inject a fault into the virtual hardware, or move what stands there."""
        topic = t.RIG_MOTION if isinstance(fault, RigMotion) else t.RIG_FAULT
        try:
            self.session.put(topic, encode(fault))
        except NotCertified as error:
            raise OperatorError("not_certified", str(error)) from None

    def close(self) -> None:
        """End the session."""
        self.session.close()

    def _rest(self) -> None:
        """Let a little time pass between two turns."""
        time.sleep(POLL_S)

    def _take(self, topic: t.Topic, payload: bytes) -> bool:
        """Take in what was told; return False for what cannot be read."""
        try:
            message = decode_as(topic.message, payload, topic.max_bytes)
        except CodecError:
            return False  # another version's telemetry; commands would be refused by name
        if isinstance(message, State):
            self._take_state(message, self.clock.now())
        elif isinstance(message, Reflection):
            self.on_reflection(message)
        elif isinstance(message, Event):
            self.client.on_event(message)
            self.on_event(message)
        elif isinstance(message, Description):
            self.description = message
        return True

    def _take_state(self, state: State, now_s: float) -> None:
        self.client.on_state(state)
        self.state_since_s = now_s
        if self.holds_lease:
            self.client.watch_lease(state)
            self.round_trip.echoed(state.last_seq, now_s)
        self.on_state(state)

    def _put(self, topic: t.Topic, payload: bytes, proof: bytes) -> None:
        self.round_trip.sent(topic.key, self.client.seq, self.clock.now())
        self.session.put(topic, payload, proof)
