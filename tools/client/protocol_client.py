"""An operator's protocol, without a network or a clock: lease, proofs, streams, replies."""

import hashlib
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ...protocols import topics as t
from ...protocols.codec import CodecError, decode_as, encode
from ...protocols.messages import requests
from ...protocols.messages.telemetry import Event, State
from ...protocols.proof import KeyPair, prove, random_key

# --- Operator's side of the protocol, without a network: lease, sequence, freshness, streams ------
#
# A `ProtocolClient` is given what comes in (`on_state`, `on_event`) and the time (`run`); it
# sends through two functions. `telerobot.Operator` puts Zenoh behind them, a simulation the
# cycle's own link.
Put = Callable[[t.Topic, bytes, bytes], None]  # sends a command: topic, payload, proof of the lease
Ask = Callable[[t.Topic, bytes, Callable[[bytes], None], bytes], None]
"""Sends a request: topic, payload, what takes the reply, and a proof of the lease or nothing."""
Fields = Callable[[float], Mapping[str, Any] | None]
"""Makes a stream's fields anew for every message, from the time [s]; None: nothing to send."""
OnReply = Callable[[requests.Reply], None]

UNPROVEN = (t.LEASE, t.PROTECTIVE_STOP)  # requests that anyone may send

SEALS = 64  # protective stops of one's own that can still be cleared [1]

ANYBODY: Mapping[str, Any] = {"seen_tick": 0}  # an envelope to judge fields with

KEEPALIVE_S = 0.1
STREAM_S = 0.01


def ignore(_told: object) -> None:
    """Take in what is told, and do nothing."""


def stream_name(topic: t.Topic, fields: Mapping[str, Any]) -> tuple[t.Topic, str]:
    """Return what tells one stream from another: its topic, and the task or mechanism."""
    return topic, str(fields.get("task") or fields.get("mechanism") or "")


class NoLease(Exception):
    """The client cannot do what it was asked: it holds no lease."""


@dataclass
class ProtocolClient:
    """One operator: what it holds, what it streams, what it was told."""

    name: str
    cell: str
    put: Put
    ask: Ask
    new_key: Callable[[], bytes] = random_key
    """Makes 32 random bytes for each key pair and each seal."""
    secret: bytes | None = None  # proves the lease; None without one
    epoch: int = 0
    state: State | None = None
    events: list[Event] = field(default_factory=list)
    mute: bool = False  # True cuts the client off: nothing is sent any more
    seq: int = 0  # number of the newest message that was sent
    _lease_seen: bool = False
    _keepalive_due_s: float = 0.0
    _stream_due_s: float = 0.0
    _streams: dict[tuple[t.Topic, str], Mapping[str, Any] | Fields] = field(default_factory=dict)
    """By topic, and by the task or mechanism that it names, if any."""
    _seals: deque[bytes] = field(default_factory=lambda: deque(maxlen=SEALS))
    """Secrets that open this client's protective stops."""

    # --- what comes in -----------------------------------------------------------------------

    def on_state(self, state: State) -> None:
        self.state = state

    def watch_lease(self, state: State) -> None:
        """Let go of a lease that a state shows to be lost; states from before it don't count."""
        if self.secret is None:
            return
        if state.lease_epoch == self.epoch and state.lease_holder == self.name:
            self._lease_seen = True
        elif self._lease_seen or state.lease_epoch >= self.epoch:
            self.drop_lease()

    def on_event(self, event: Event) -> None:
        self.events.append(event)

    @property
    def seen_tick(self) -> int:
        """The newest telemetry tick that was seen."""
        return 0 if self.state is None else self.state.tick

    # --- what goes out -----------------------------------------------------------------------

    def run(self, now_s: float) -> None:
        """Send what is due at `now_s`: the keepalive, and streams that are on."""
        if self.secret is None or self.mute:
            return
        if now_s >= self._keepalive_due_s:
            self._keepalive_due_s = now_s + KEEPALIVE_S - 1e-6
            self.command(t.KEEPALIVE)
        if now_s >= self._stream_due_s:
            self.send_streams(now_s)

    def send_streams(self, now_s: float) -> None:
        """Send all streams now, ahead of time; the next time they are due is counted from here."""
        self._stream_due_s = now_s + STREAM_S - 1e-6
        for (topic, _), made in self._streams.items():
            fields = made(now_s) if callable(made) else made
            if fields is not None:
                self.command(topic, **fields)

    def stream(self, topic: t.Topic, **fields: Any) -> None:
        """Keep sending a command at 100 Hz, these fields until the next call for the same task.

        Raises `ValueError` for fields that its message does not take.
        """
        topic.message(**ANYBODY, **fields)  # now, and not in some later `run`
        self._streams[stream_name(topic, fields)] = fields

    def stream_made(self, topic: t.Topic, fields: Fields, named: str | None = None) -> None:
        """Keep sending a command at 100 Hz whose fields are made anew each time.

        They name that task or mechanism.
        """
        self._streams[topic, named or ""] = fields

    def end_stream(self, topic: t.Topic, named: str | None = None) -> None:
        """Fall silent on a topic, for a task or mechanism; without a name, for all."""
        for streamed, name in tuple(self._streams):
            if streamed is topic and named in (None, name):
                del self._streams[streamed, name]

    def command(self, topic: t.Topic, **fields: Any) -> None:
        """Send a command now. Raises `NoLease` without a lease."""
        if self.mute:
            return
        self._need_lease()
        payload = encode(topic.message(**{**fields, "seen_tick": self.seen_tick}))
        self.put(topic, payload, self.prove(topic, payload))

    def request(self, topic: t.Topic, on_reply: OnReply, **fields: Any) -> None:
        """Send a request; its reply goes to `on_reply`. Raises `NoLease` without a lease."""
        if self.mute:
            return
        if topic.needs_proof:
            self._need_lease()
            fields["seen_tick"] = self.seen_tick
        payload = encode(topic.message(**fields))
        proof = b"" if topic in UNPROVEN or self.secret is None else self.prove(topic, payload)
        self.ask(topic, payload, lambda reply: on_reply(_reply(reply)), proof)

    def prove(self, topic: t.Topic, payload: bytes) -> bytes:
        """Return the proof that a payload comes from who holds the lease, under a new number.

        Raises `NoLease` without a lease.
        """
        secret = self._need_lease()
        self.seq += 1
        return prove(secret, topic.full_key(self.cell), self.epoch, self.seq, payload)

    def send(self, topic: t.Topic, on_reply: OnReply, **fields: Any) -> None:
        """Send on any topic of an operator, as its row says: stream, command, request.

        Raises `NoLease` without a lease, `ValueError` for fields that its message does not take.
        """
        own = {
            t.LEASE: self.acquire,
            t.RELEASE: self.release,
            t.PROTECTIVE_STOP: self.protective_stop,
            t.PROTECTIVE_CLEAR: self.clear_protective_stop,
        }.get(topic)
        if own is not None:
            own(on_reply)
        elif topic.flow.asks:
            self.request(topic, on_reply, **fields)
        elif topic.life is t.Life.STREAM:
            self.stream(topic, **fields)
        else:
            self.command(topic, **fields)

    def acquire(self, on_reply: OnReply) -> None:
        """Ask for the lease; once granted, it is kept alive by `run`."""
        pair = KeyPair(self.new_key())

        def granted(reply: requests.Reply) -> None:
            if reply.ok:
                reply = self._take_lease(pair, reply)
            on_reply(reply)

        self.request(t.LEASE, granted, operator=self.name, key=pair.public)

    def protective_stop(self, on_reply: OnReply) -> None:
        """Ask for the protective stop, sealed: this client can clear it, or the lease's holder."""
        self._seals.append(self.new_key())
        seal = hashlib.sha256(self._seals[-1]).digest()
        self.request(t.PROTECTIVE_STOP, on_reply, operator=self.name, seal=seal)

    def clear_protective_stop(self, on_reply: OnReply) -> None:
        """Clear all protective stops with the lease, else the newest one that was asked for."""
        opens = self._seals[-1] if self.secret is None and self._seals else None

        def cleared(reply: requests.Reply) -> None:
            if opens is not None and reply.reason != "no_answer" and opens in self._seals:
                self._seals.remove(opens)  # it is used up, or opens nothing
            on_reply(reply)

        self.request(t.PROTECTIVE_CLEAR, cleared, operator=self.name, opens=opens)

    def release(self, on_reply: OnReply) -> None:
        """Give the lease back."""
        self.request(t.RELEASE, on_reply)
        self.drop_lease()

    def drop_lease(self) -> None:
        """Forget the lease, and fall silent."""
        self.secret = None
        self._lease_seen = False
        self._streams.clear()

    def _need_lease(self) -> bytes:
        if self.secret is None:
            raise NoLease(f"{self.name} holds no lease")
        return self.secret

    def _take_lease(self, pair: KeyPair, reply: requests.Reply) -> requests.Reply:
        """Take the lease that was granted; return the reply, or that its key is of no use."""
        key, epoch = reply.key, reply.epoch
        if key is None or epoch is None:
            return requests.Reply(ok=False, reason="wrong_key", detail="no key with the lease")
        try:
            self.secret = pair.agree_with_daemon(key, t.LEASE.full_key(self.cell), epoch)
        except ValueError:
            return requests.Reply(ok=False, reason="wrong_key", detail="key is of no use")
        self.epoch, self._lease_seen, self._keepalive_due_s = epoch, False, 0.0
        return reply


def _reply(payload: bytes) -> requests.Reply:
    """Return a reply; one that cannot be read is a refusal."""
    try:
        return decode_as(requests.Reply, payload)
    except CodecError as error:
        return requests.Reply(ok=False, reason=error.reason, detail=error.detail[:500])


# --- Round trip: from a command to the telemetry that shows it accepted. Pure ---------------------
REMEMBERED = 512  # commands per key whose echo is waited for [1]


class RoundTrip:
    """Pairs what was sent with the sequence numbers that telemetry echoes."""

    def __init__(self) -> None:
        self._sent: dict[str, deque[tuple[int, float]]] = {}
        self.seconds: float | None = None
        """From sending a command to seeing its echo, the newest one [s]; None before the first."""
        self.heard_s: float | None = None  # time of the newest echo [s]

    def sent(self, key: str, seq: int, now_s: float) -> None:
        """Note that a command was sent."""
        self._sent.setdefault(key, deque(maxlen=REMEMBERED)).append((seq, now_s))

    def echoed(self, last_seq: Mapping[str, int], now_s: float) -> None:
        """Take in the newest accepted sequence number of every key."""
        for key, seq in last_seq.items():
            sent = self._sent.get(key, deque())
            while sent and sent[0][0] <= seq:
                number, since_s = sent.popleft()
                if number == seq:
                    self.seconds, self.heard_s = now_s - since_s, now_s
