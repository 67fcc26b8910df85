"""The operator's side of the protocol, without a network: lease, sequence, freshness, streams.

A `Pilot` is told what comes in (`on_state`, `on_event`) and what time it is (`run`); it sends
through two functions that it is given. `telerobot.Operator` puts Zenoh behind them, a simulation
puts the cycle's own link.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ..protocols import messages as m
from ..protocols import requests
from ..protocols import topics as t
from ..protocols.codec import decode_as, encode

Put = Callable[[t.Topic, bytes], None]
"""Sends a command."""
Ask = Callable[[t.Topic, bytes, Callable[[bytes], None]], None]
"""Sends a request; its reply comes through the callback."""
Fields = Callable[[float], Mapping[str, Any] | None]
"""Makes a stream's fields anew for every message, from the time [s]; None: nothing to send."""
OnReply = Callable[[requests.Reply], None]

ANYBODY: Mapping[str, Any] = {"token": "-", "epoch": 0, "seq": 0, "seen_tick": 0}
"""An envelope to judge fields with."""

KEEPALIVE_S = 0.1
STREAM_S = 0.01


class PilotError(Exception):
    """The pilot cannot do what it was asked: it holds no lease."""


@dataclass
class Pilot:
    """One operator: what it holds, what it streams, what it was told."""

    name: str
    put: Put
    ask: Ask
    token: str | None = None
    epoch: int = 0
    state: m.State | None = None
    events: list[m.Event] = field(default_factory=list)
    mute: bool = False
    """True cuts the pilot off: nothing is sent any more."""
    seq: int = 0
    """Number of the newest message that was sent."""
    _keepalive_due_s: float = 0.0
    _stream_due_s: float = 0.0
    _streams: dict[t.Topic, Mapping[str, Any] | Fields] = field(default_factory=dict)

    # --- what comes in -----------------------------------------------------------------------

    def on_state(self, state: m.State) -> None:
        """Take in a state."""
        self.state = state

    def on_event(self, event: m.Event) -> None:
        """Take in an event."""
        self.events.append(event)

    @property
    def seen_tick(self) -> int:
        """The newest telemetry tick that was seen."""
        return 0 if self.state is None else self.state.tick

    # --- what goes out -----------------------------------------------------------------------

    def run(self, now_s: float) -> None:
        """Send what is due at `now_s`: the keepalive, and streams that are on."""
        if self.token is None or self.mute:
            return
        if now_s >= self._keepalive_due_s:
            self._keepalive_due_s = now_s + KEEPALIVE_S - 1e-6
            self.command(t.KEEPALIVE)
        if now_s >= self._stream_due_s:
            self._stream_due_s = now_s + STREAM_S - 1e-6
            for topic, made in self._streams.items():
                fields = made(now_s) if callable(made) else made
                if fields is not None:
                    self.command(topic, **fields)

    def stream(self, topic: t.Topic, **fields: Any) -> None:
        """Keep sending a command at 100 Hz, these fields until the next call.

        Raises `ValueError` for fields that its message does not take.
        """
        topic.message(**ANYBODY, **fields)  # now, and not in some later `run`
        self._streams[topic] = fields

    def stream_made(self, topic: t.Topic, fields: Fields) -> None:
        """Keep sending a command at 100 Hz whose fields are made anew each time."""
        self._streams[topic] = fields

    def end_stream(self, topic: t.Topic) -> None:
        """Fall silent on a stream."""
        self._streams.pop(topic, None)

    def command(self, topic: t.Topic, **fields: Any) -> None:
        """Send a command now. Raises `PilotError` without a lease."""
        if self.mute:
            return
        self.put(topic, encode(topic.message(**self._envelope(), **fields)))

    def request(self, topic: t.Topic, on_reply: OnReply, **fields: Any) -> None:
        """Send a request; its reply goes to `on_reply`. Raises `PilotError` without a lease."""
        if self.mute:
            return
        envelope = self._envelope() if issubclass(topic.message, m.Command) else {}
        payload = encode(topic.message(**envelope, **fields))
        self.ask(topic, payload, lambda reply: on_reply(decode_as(requests.Reply, reply)))

    def acquire(self, on_reply: OnReply) -> None:
        """Ask for the lease; once granted, it is kept alive by `run`."""

        def granted(reply: requests.Reply) -> None:
            if reply.ok and reply.token is not None and reply.epoch is not None:
                self.token, self.epoch = reply.token, reply.epoch
                self._keepalive_due_s = 0.0
            on_reply(reply)

        self.request(t.LEASE, granted, operator=self.name)

    def release(self, on_reply: OnReply) -> None:
        """Give the lease back."""
        self.request(t.RELEASE, on_reply)
        self.drop_lease()

    def drop_lease(self) -> None:
        """Forget the lease, and fall silent."""
        self.token = None
        self._streams.clear()

    def _envelope(self) -> dict[str, Any]:
        if self.token is None:
            raise PilotError(f"{self.name} holds no lease")
        self.seq += 1
        return {
            "token": self.token,
            "epoch": self.epoch,
            "seq": self.seq,
            "seen_tick": self.seen_tick,
        }
