"""One browser page: an operator of its own, whose every motion is held by the page's heartbeat.

The page sends a beat every 10 ms while something is held, with all that is held in it, and ten a
second else. Motion stops when beats stop: after `HELD_S` the streams are told zero, after
`LAPSED_S` what was held has to be let go of first, after `ALIVE_S` the lease is not renewed.
"""

import asyncio
import json
import time
from collections.abc import Callable, Collection, Mapping
from typing import Any, Final

from pydantic import ValidationError

from .....drivers.network.session import NotCertified
from .....protocols import topics as t
from .....protocols.messages import requests
from .....protocols.messages.telemetry import State
from .....protocols.topics import Role
from ....client.protocol_client import Ask, NoLease, ProtocolClient, Put
from ....client.round_trip import RoundTrip
from ...words.refusals import refusal_words
from .neutral import STREAMS, neutral, stream_name
from .video import DaemonClock, VideoFrame, Watch, watched_in

HELD_S: Final = 0.04
"""Motion of a page that is silent for longer ends [s]: four beats that do not come."""

LAPSED_S: Final = 0.25
"""Keys of a page that was silent for longer count only once they were let go of [s]."""

ALIVE_S: Final = 1.0
"""The lease of a page that is silent for longer is not renewed [s]: so long may a page stutter."""

RATE: Final = 400.0
BURST: Final = 400.0
"""Messages a second that a page may say, and at once; one that holds something says 100 [1]."""

WAITING: Final = 256
"""Messages that wait for a page that reads slowly, beside the newest state [1]."""

TOPICS: Final = {topic.key: topic for topic in (*t.COMMANDS, *t.REQUESTS)}
_ANYBODYS: Final = (t.PROTECTIVE_STOP, t.PROTECTIVE_CLEAR)


class Page:
    """Session of one page: its lease, held controls and messages; its socket is the server's."""

    def __init__(
        self,
        name: str,
        role: Role,
        cell: str,
        put: Put,
        ask: Ask,
        clock: Callable[[], float] = time.monotonic,
        cameras: Collection[str] = (),
        daemon: DaemonClock | None = None,
    ) -> None:
        self.role = role
        self._clock = clock
        self.client = ProtocolClient(name, cell, self._put, ask)
        self.round_trip = RoundTrip()
        self.outbox: asyncio.Queue[str] = asyncio.Queue(WAITING)
        self.newest: dict[str, str] = {}
        """State, contour and pictures that are not sent yet; a newer one takes each one's place."""
        self.watches: dict[str, Watch] = {}
        """Cameras that are looked at large, as long as the page is alive."""
        self._cameras, self._daemon = cameras, daemon
        self.wake = asyncio.Event()
        self.dismissed = ""
        """Why the page is let go of; empty while it is not."""
        self._send_on = put
        self._beat_s = clock()
        self._allowed, self._counted_s = BURST, clock()
        self._held: dict[tuple[t.Topic, str], dict[str, Any]] = {}
        self._lapsed = False

    # --- what the page says ------------------------------------------------------------------

    def take(self, text: str) -> None:
        """Take in one message of the page; what is no message is told so, and ends what is held.

        One that says more than it may is dismissed, so that it cannot keep the others waiting.
        """
        if not self._afford():
            self.dismissed = "says too much"
            self._hold({})
            self.wake.set()
            return
        try:
            message = json.loads(text)
            kind = message["type"]
            if kind == "beat":
                self._beat(message)
            elif kind == "send":
                self._send(message)
            else:
                raise ValueError(f"no such type: {kind}")
        except (
            ValueError, TypeError, KeyError, AttributeError, RecursionError, NotCertified
        ) as error:  # fmt: skip
            self._hold({})
            self.tell({"type": "complaint", "detail": str(error)[:200]})

    def _afford(self) -> bool:
        now_s = self._clock()
        self._allowed = min(BURST, self._allowed + RATE * (now_s - self._counted_s)) - 1.0
        self._counted_s = now_s
        return self._allowed >= 0.0

    def _beat(self, message: Mapping[str, Any]) -> None:
        self._beat_s = self._clock()
        held = {} if self.role is not Role.OPERATOR else dict(message.get("held") or {})
        if self._lapsed and held:
            held = {}  # what was held when the page fell silent has to be let go of first
        else:
            self._lapsed = False
        self._hold(held)
        self._watch(watched_in(message.get("video", {}), self._cameras))
        trip = self.round_trip.seconds
        echo_ms = None if trip is None else round(1e3 * trip, 1)
        self.tell(
            {"type": "beat", "n": message.get("n"), "lapsed": self._lapsed, "echo_ms": echo_ms}
            | self._clocks()
        )

    def _clocks(self) -> dict[str, float]:
        """Return the console's clock, and the daemon's ticks on it, where pictures have an age."""
        if not self._cameras or self._daemon is None or self._daemon.zero_s is None:
            return {}
        return {
            "now_ms": 1e3 * self._beat_s,
            "zero_ms": 1e3 * self._daemon.zero_s,
            "period_ms": 1e3 * self._daemon.period_s,
        }

    def _watch(self, watched: Mapping[str, int]) -> None:
        """Look at these cameras large, and at no other."""
        self.watches = {name: self.watches.get(name) or Watch() for name in watched}
        for name, number in watched.items():
            self.watches[name].received(number)

    def _send(self, message: Mapping[str, Any]) -> None:
        number, key = message.get("id"), str(message.get("key"))

        def replied(reply: requests.Reply) -> None:
            self.tell(
                {"type": "reply", "id": number, "key": key, "ok": reply.ok, "reason": reply.reason,
                 "detail": reply.detail, "words": "" if reply.ok else refusal_words(reply)}
            )  # fmt: skip

        def refuse(reason: str, detail: str) -> None:
            replied(requests.Reply(ok=False, reason=reason, detail=detail[:500]))

        topic = TOPICS.get(key)
        if topic is None or topic.life is t.Life.STREAM:
            refuse("unknown_topic", f"{key} is nothing that a page can send")
            return
        if self.role is not Role.OPERATOR and topic not in _ANYBODYS:
            refuse("not_certified", "this page may watch, and stop the arm; it may not drive")
            return
        try:
            self.client.send(topic, replied, **dict(message.get("fields") or {}))
            if not topic.flow.asks:
                replied(requests.Reply(ok=True))  # a command is refused by an event, if it is
        except NoLease:
            refuse("no_lease", "you do not hold the lease: take it first")
        except NotCertified as error:
            refuse("not_certified", str(error))
        except ValidationError as error:
            first = error.errors()[0]
            where = ".".join(str(part) for part in first["loc"])
            refuse("out_of_range", f"{where}: {first['msg']}" if where else first["msg"])

    # --- what is held ------------------------------------------------------------------------

    def run(self, now_s: float) -> None:
        """Send what is due, if the page is alive."""
        silent_s = now_s - self._beat_s
        if silent_s > HELD_S:
            self._hold({})
        if silent_s > LAPSED_S:
            self._lapsed = True
        if silent_s > ALIVE_S:
            self.watches = {}
            return  # the lease runs out, as that of any operator who hangs
        self.client.run(now_s)

    def end(self) -> None:
        """The page has gone: all motion ends, and the lease is given back."""
        self._hold({})
        if self.client.secret is not None:
            self.client.release(lambda _reply: None)

    def on_state(self, state: State) -> None:
        """Take in a state: what is held ends where the arm may not be moved."""
        held = self.client.secret is not None
        self.client.on_state(state)
        self.client.watch_lease(state)
        self.round_trip.echoed(state.last_seq, self._clock())
        if self.client.secret is None or state.mode != "enabled":
            for topic in STREAMS:
                self.client.end_stream(topic)
            self._held = {}
            self._lapsed = self._lapsed or (held and self.client.secret is None)

    def _hold(self, held: Mapping[str, Any]) -> None:
        """Stream what is held; what no longer is, is told zero, now and until it is held again."""
        state = self.client.state
        if self.client.secret is None or state is None or state.mode != "enabled":
            return
        wanted = {
            stream_name(topic, fields): dict(fields)
            for key, each in held.items()
            if (topic := TOPICS.get(key)) in STREAMS and topic is not None
            for fields in (each if isinstance(each, list) else [each])
        }
        changed = False
        for name, fields in wanted.items():
            if self._held.get(name) != fields:
                self.client.stream(name[0], **fields)
                self._held[name] = fields
                changed = True
        for name in [name for name in self._held if name not in wanted]:
            still = neutral(self._held[name])
            other = any(topic is not name[0] for topic, _ in wanted)
            if still is None or other:  # a jog at zero would keep the stick waiting
                self.client.end_stream(name[0], name[1] or None)
                del self._held[name]
            elif still != self._held[name]:
                self.client.stream(name[0], **still)
                self._held[name] = still
                changed = True
        if changed:
            self.client.send_streams(self._clock())

    def _put(self, topic: t.Topic, payload: bytes, proof: bytes) -> None:
        self.round_trip.sent(topic.key, self.client.seq, self._clock())
        self._send_on(topic, payload, proof)

    # --- what the page is told ---------------------------------------------------------------

    def tell(self, message: Mapping[str, Any]) -> None:
        """Queue a message for the page."""
        self.tell_text(json.dumps(message))

    def tell_text(self, text: str) -> None:
        """Queue a message that is JSON already."""
        try:
            self.outbox.put_nowait(text)
        except asyncio.QueueFull:
            self.dismissed = "reads too slowly"
        self.wake.set()

    def tell_state(self, text: str) -> None:
        """Let the page be told the newest state, in place of one that it has not read.

        `text` ends where it says whether the page has the lease.
        """
        self.tell_newest("state", text + ("true}" if self.client.secret else "false}"))

    def tell_video(self, camera: str, frames: Collection[VideoFrame]) -> None:
        """Let the page be told frames of a camera that it looks at."""
        for frame in frames:
            self.watches[camera].offer(frame, self._clock())
        self.wake.set()

    def next_frame(self) -> bytes | None:
        """Return a frame of a video that is to be sent now; None if there is none."""
        waiting = [watch for watch in self.watches.values() if watch.waiting]
        if not waiting:
            return None
        # No camera keeps another one waiting on a slow link.
        return min(waiting, key=lambda watch: watch.sent_s).next(self._clock())

    def tell_newest(self, kind: str, text: str) -> None:
        """Let the page be told JSON, in place of an older one of its kind that it has not read."""
        self.newest[kind] = text
        self.wake.set()
