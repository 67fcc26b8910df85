"""A remote operator over Zenoh: `telerobot.Operator`, for a user's own scripts.

    with Operator("pa10") as operator:
        operator.acquire()
        operator.enable()
        operator.joystick([0.02, 0, 0, 0, 0, 0], seconds=2.0)
"""

import json
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Self

import zenoh

from ..config.load import Cell, load_cell
from ..protocols import messages as m
from ..protocols import topics as t
from ..protocols.codec import CodecError, decode_as, encode
from .pilot import Pilot

REPLY_TIMEOUT_S = 5.0
POLL_S = 0.002


class OperatorError(Exception):
    """The daemon refused, or did not answer: carries the reason by name."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason = reason
        self.detail = detail


def client_config(endpoint: str) -> "zenoh.Config":
    """Return a Zenoh client's configuration: it talks to the daemon and to nobody else."""
    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": "client",
        "connect/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


class Operator:
    """One operator's session with a daemon; a context manager.

    Nothing runs in the background: the lease is renewed, streams are sent and telemetry is read
    inside `spin` and the calls that wait. Call one of them at least ten times a second, or the
    lease runs out and the arm goes to HOLD.
    """

    def __init__(
        self, cell: str | Cell, endpoint: str | None = None, name: str = "operator"
    ) -> None:
        loaded = cell if isinstance(cell, Cell) else load_cell(cell)
        self.cell = loaded.config.name
        target = endpoint or loaded.config.zenoh.listen
        try:
            self._session = zenoh.open(client_config(target))
        except zenoh.ZError as error:
            raise OperatorError("no_daemon", f"nobody answers at {target}: {error}") from None
        self._states = self._subscribe(t.STATE, 1)
        self._events = self._subscribe(t.EVENT, 256)
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._replies: list[tuple[Any, Callable[[bytes], None], float]] = []
        self.pilot = Pilot(name, self._put, self._ask)
        self.on_state: Callable[[m.State], None] | None = None
        """Called with every state that is read."""
        self.on_event: Callable[[m.Event], None] | None = None
        """Called with every event that is read."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    # --- reading -----------------------------------------------------------------------------

    @property
    def state(self) -> m.State | None:
        """The newest state that was read."""
        return self.pilot.state

    @property
    def events(self) -> list[m.Event]:
        """All events that were read."""
        return self.pilot.events

    def spin(self, seconds: float = 0.0, until: Callable[[], bool] | None = None) -> bool:
        """Keep the session alive for a while, or until something holds; return whether it did."""
        end = time.monotonic() + seconds
        while True:
            self._turn()
            if until is not None and until():
                return True
            if time.monotonic() >= end:
                return until is None
            time.sleep(POLL_S)

    def wait_state(self, timeout_s: float = REPLY_TIMEOUT_S) -> m.State:
        """Return the first state that comes. Raises `OperatorError` when none does."""
        if not self.spin(timeout_s, lambda: self.state is not None) or self.state is None:
            raise OperatorError("no_daemon", f"no telemetry of cell {self.cell}")
        return self.state

    # --- asking ------------------------------------------------------------------------------

    def acquire(self) -> None:
        """Take the lease. Raises `OperatorError` while somebody else holds it."""
        self._wait(self.pilot.acquire)

    def release(self) -> None:
        """Give the lease back; a moving arm stops."""
        self._wait(self.pilot.release)

    def enable(self) -> None:
        """Switch the drives on, or go on after HOLD; returns once the arm may be moved."""
        self.wait_state()
        self.request(t.MODE, action="enable")
        self.spin(REPLY_TIMEOUT_S, lambda: self.state is not None and self.state.mode == "enabled")

    def hold(self) -> None:
        """Stop and stand."""
        self.request(t.MODE, action="hold")

    def disable(self) -> None:
        """Stop, and switch the drives off."""
        self.request(t.MODE, action="disable")

    def reset(self) -> None:
        """Leave FAULT, once its cause is gone."""
        self.request(t.MODE, action="reset")

    def protective_stop(self) -> None:
        """Stop the arm; works without the lease."""
        self.request(t.PROTECTIVE_STOP, operator=self.pilot.name)

    def clear_protective_stop(self) -> None:
        """Clear a protective stop that this operator asked for, or any with the lease."""
        self.request(t.PROTECTIVE_CLEAR, operator=self.pilot.name, token=self.pilot.token)

    def request(self, topic: t.Topic, **fields: Any) -> m.Reply:
        """Send any request and return its reply. Raises `OperatorError` when refused."""
        return self._wait(lambda on_reply: self.pilot.request(topic, on_reply, **fields))

    # --- commanding --------------------------------------------------------------------------

    def joystick(
        self,
        twist: Sequence[float],
        seconds: float = 0.0,
        expressed_in: str = "crf",
        relative_to: str = "crf",
    ) -> None:
        """Stream a stick twist [m/s, rad/s] for a while; with `seconds` 0, until told otherwise."""
        self.pilot.stream(
            t.JOYSTICK,
            twist=tuple(twist),
            expressed_in=m.Frame(expressed_in),
            relative_to=m.Frame(relative_to),
        )
        if seconds > 0.0:
            self.spin(seconds)
            self.pilot.end_stream(t.JOYSTICK)

    def move_to(
        self, xyz: Sequence[float], rpy: Sequence[float], relative_to: str = "crf", **more: Any
    ) -> None:
        """Set a target pose of the MRF [m, rad]; returns at once."""
        self.pilot.command(
            t.POSITION, xyz=tuple(xyz), rpy=tuple(rpy), relative_to=m.Frame(relative_to), **more
        )

    def posture(self, posture: str | Sequence[float]) -> None:
        """Move to a joint posture, by name or angles [rad]; returns at once."""
        if isinstance(posture, str):
            self.pilot.command(t.POSTURE, posture=posture)
        else:
            self.pilot.command(t.POSTURE, q=tuple(posture))

    def wait_goal(self, timeout_s: float) -> bool:
        """Wait until the goal is reached; return whether it was."""
        self.spin(0.1)
        return self.spin(timeout_s, lambda: self.state is not None and self.state.at_goal)

    def command(self, topic: t.Topic, **fields: Any) -> None:
        """Send any command."""
        self.pilot.command(topic, **fields)

    def inject(self, fault: m.RigFault) -> None:
        """Inject a fault into the virtual hardware."""
        self._put(t.RIG_FAULT, encode(fault))

    def close(self) -> None:
        """Release the lease, if held, and end the session."""
        if self.pilot.token is not None and not self.pilot.mute:
            try:
                self.release()
            except OperatorError:
                self.pilot.token = None  # it has run out already: there is nothing to release
        self._session.close()  # type: ignore[no-untyped-call]

    # --- network -----------------------------------------------------------------------------

    def _turn(self) -> None:
        while (sample := self._states.try_recv()) is not None:
            self._take(t.STATE, sample.payload.to_bytes())
        while (sample := self._events.try_recv()) is not None:
            self._take(t.EVENT, sample.payload.to_bytes())
        for waiting in tuple(self._replies):
            self._poll_reply(*waiting, waiting)
        self.pilot.run(time.monotonic())

    def _take(self, topic: t.Topic, payload: bytes) -> None:
        try:
            message = decode_as(topic.message, payload, topic.max_bytes)
        except CodecError:
            return  # another version's telemetry; commands would be refused by name
        if isinstance(message, m.State):
            self.pilot.on_state(message)
            if self.on_state is not None:
                self.on_state(message)
        elif isinstance(message, m.Event):
            self.pilot.on_event(message)
            if self.on_event is not None:
                self.on_event(message)

    def _poll_reply(
        self,
        replies: Any,
        answer: Callable[[bytes], None],
        deadline_s: float,
        waiting: tuple[Any, Callable[[bytes], None], float],
    ) -> None:
        try:
            reply = replies.try_recv()
        except zenoh.ZError:
            reply = None  # the channel closed without a reply
            deadline_s = 0.0
        if reply is not None and reply.ok is not None:
            self._replies.remove(waiting)
            answer(reply.ok.payload.to_bytes())
        elif time.monotonic() > deadline_s:
            self._replies.remove(waiting)
            nobody = m.Reply(ok=False, reason="no_answer", detail="the daemon did not answer")
            answer(encode(nobody))

    def _wait(self, send: Callable[[Callable[[m.Reply], None]], None]) -> m.Reply:
        replies: list[m.Reply] = []
        send(replies.append)
        self.spin(REPLY_TIMEOUT_S + 1.0, lambda: bool(replies))
        if not replies:
            raise OperatorError("no_answer", "the daemon did not answer")
        if not replies[0].ok:
            raise OperatorError(replies[0].reason, replies[0].detail)
        return replies[0]

    def _put(self, topic: t.Topic, payload: bytes) -> None:
        publisher = self._publishers.get(topic.key)
        if publisher is None:
            publisher = self._session.declare_publisher(
                topic.full_key(self.cell),
                priority=zenoh.Priority.REAL_TIME,
                congestion_control=zenoh.CongestionControl.DROP,
            )
            self._publishers[topic.key] = publisher
        publisher.put(payload)

    def _ask(self, topic: t.Topic, payload: bytes, answer: Callable[[bytes], None]) -> None:
        replies = self._session.get(
            topic.full_key(self.cell),
            zenoh.handlers.FifoChannel(2),
            payload=payload,
            timeout=REPLY_TIMEOUT_S,
        )
        self._replies.append((replies, answer, time.monotonic() + REPLY_TIMEOUT_S))

    def _subscribe(self, topic: t.Topic, depth: int) -> Any:
        return self._session.declare_subscriber(
            topic.full_key(self.cell), zenoh.handlers.RingChannel(depth)
        )
