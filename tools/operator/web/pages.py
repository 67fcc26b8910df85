"""Sessions of pages: each an operator of its own; what all of them are told."""

import asyncio
import json
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping
from typing import Any, Final

from pydantic import ValidationError

from ....drivers.network.session import NotCertified
from ....protocols import topics as t
from ....protocols.codec import encode
from ....protocols.messages import requests
from ....protocols.messages.telemetry import Description, Event, State
from ....protocols.topics import Role
from ...client.operator import Connection, OperatorError
from ...client.protocol_client import Ask, NoLease, ProtocolClient, Put, RoundTrip, stream_name
from ..words import event_words, is_cause, limit_words, refusal_words, why
from .streams import DaemonClock, VideoFrame, Videos, Watch, WorldNews, watched_in

# --- Streams that a page may hold, and what each says once it is let go of ------------------------
STREAMS: Final = (t.JOYSTICK, t.JOG, t.SELF_MOTION, t.DRIVE, t.MASTER_POSE)


def neutral(fields: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the same stream asking for nothing; None for one that ends by silence.

    A stick at zero stops at once; one that falls silent only when the daemon's timeout is over.
    A master's pose moves nothing while it stays what it is.
    """
    for key in ("twist", "rates"):
        if key in fields:
            return {**fields, key: [0.0] * len(fields[key])}
    return {**fields, "rate": 0.0} if "rate" in fields else None


# --- One browser page: an operator of its own, whose every motion is held by the page's heartbeat
#
# The page sends a beat every 10 ms while something is held, with all that is held in it, and
# ten a second else. Motion stops when beats stop: after `HELD_S` the streams are told zero,
# after `LAPSED_S` what was held has to be let go of first, after `ALIVE_S` the lease is not
# renewed.
HELD_S: Final = 0.04
"""Motion of a page that is silent for longer ends [s]: four beats that do not come."""

LAPSED_S: Final = 0.25
"""Keys of a page that was silent for longer count only once they were let go of [s]."""

ALIVE_S: Final = 1.0
"""The lease of a page that is silent for longer is not renewed [s]: so long may a page stutter."""

RATE: Final = 400.0
BURST: Final = 400.0
"""Messages a second that a page may say, and at once; one that holds something says 100 [1]."""

WAITING: Final = 256  # messages that wait for a page that reads slowly, beside the newest state [1]

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
        self.dismissed = ""  # why the page is let go of; empty while it is not
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
        watched = watched_in(message.get("video", {}), self._cameras)
        self.watches = {name: self.watches.get(name) or Watch() for name in watched}
        for name, number in watched.items():
            self.watches[name].received(number)
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


# --- One Zenoh session behind any number of pages: telemetry is read once and passed on to all ----
#
# Each page is an operator of its own to the daemon, with its own lease, seals and name.
POLL_S: Final = 0.002
STATE_S: Final = 1 / 60  # pages are told the state this often [s]

SILENT_S: Final = 0.3  # telemetry older than this is missing: the pages are told [s]

RETRY_S: Final = 1.0
KEPT_EVENTS: Final = 50  # events that a page is told which comes later [1]


class PageHub:
    """Passes on what the daemon tells, and what the pages send."""

    def __init__(self, connect: Callable[[], Connection], period_s: float = 0.01) -> None:
        """Build it; `period_s` is the daemon's."""
        self._connect = connect
        self._connection: Connection | None = None
        self._surroundings: WorldNews | None = None
        self._videos: Videos | None = None
        self._daemon_clock = DaemonClock(period_s)
        self._tried_s = self._stated_s = float("-inf")
        self._cause: Event | None = None
        self._link: dict[str, Any] = {
            "daemon": "silent", "pages": 0, "holders": [], "description": None
        }  # fmt: skip
        """How the daemon is reached, and by whom: what pages were told last."""
        self._events: deque[str] = deque(maxlen=KEPT_EVENTS)
        self.pages: set[Page] = set()

    async def run(self) -> None:
        """Pass messages on, for ever."""
        while True:
            self.turn(time.monotonic())
            await asyncio.sleep(POLL_S)

    def close(self) -> None:
        """End the session; leases are given back."""
        for page in self.pages:
            page.end()
        if self._connection is not None:
            self._connection.close()

    def open_page(self, name: str, role: Role, cell: str, cameras: Collection[str] = ()) -> Page:
        """Return the operator of a page that has come, which may look at these cameras."""
        page = Page(
            name, role, cell, self._put, self._ask, cameras=cameras, daemon=self._daemon_clock
        )
        self.pages.add(page)
        for event in self._events:
            page.tell_text(event)
        self._tell_link(page)
        return page

    def close_page(self, page: Page) -> None:
        """End what a page did that has gone."""
        page.end()
        self.pages.discard(page)
        self._tell_links()

    def turn(self, now_s: float) -> None:
        """Read what came, and send what is due."""
        if self._connection is None and now_s - self._tried_s > RETRY_S:
            self._tried_s = now_s
            self._open()
        if self._connection is not None:
            self._connection.turn()
            for page in tuple(self.pages):
                page.run(now_s)
            self._tell_surroundings(now_s)
            self._tell_videos()
        self._tell_links()

    # --- the session -------------------------------------------------------------------------

    def _open(self) -> None:
        try:
            self._connection = self._connect()
        except OperatorError:
            return  # nobody answers yet: the pages see it in the link, and it is tried again
        self._connection.on_state = self._on_state
        self._connection.on_event = self._on_event
        self._surroundings = WorldNews(self._connection.session)
        self._videos = Videos(self._connection.session)

    def _put(self, topic: t.Topic, payload: bytes, proof: bytes) -> None:
        if self._connection is not None:
            self._connection.session.put(topic, payload, proof)

    def _ask(
        self, topic: t.Topic, payload: bytes, answer: Callable[[bytes], None], proof: bytes
    ) -> None:
        if self._connection is None:
            nobody = "nobody answers at the daemon's endpoint"
            answer(encode(requests.Reply(ok=False, reason="no_answer", detail=nobody)))
            return
        self._connection.session.ask(topic, payload, answer, proof)

    # --- what is told ------------------------------------------------------------------------

    def _on_state(self, state: State) -> None:
        for page in self.pages:
            page.on_state(state)
        now_s = time.monotonic()
        self._daemon_clock.on_state(state, now_s)
        if now_s - self._stated_s < STATE_S - POLL_S or not self.pages:
            return
        self._stated_s = now_s
        text = told_state(state, self._cause)
        text += f'"tick":{state.tick},"t":{state.time_s},"mine":'
        for page in self.pages:
            page.tell_state(text)

    def _on_event(self, event: Event) -> None:
        if is_cause(event):
            self._cause = event
        text = json.dumps({"type": "event", **event.model_dump(), **event_words(event)})
        self._events.append(text)
        for page in self.pages:
            page.tell_text(text)

    def _tell_surroundings(self, now_s: float) -> None:
        if self._surroundings is None:
            return
        for kind, text in self._surroundings.turn(now_s, bool(self.pages)):
            for page in self.pages:
                if kind:
                    page.tell_newest(kind, text)
                else:
                    page.tell_text(text)

    def _tell_videos(self) -> None:
        """Pass on the videos that are looked at; who begins to is told all since a key frame."""
        if self._videos is None:
            return
        watched = {name for page in self.pages for name in page.watches}
        for name, frame in self._videos.turn(watched):
            for page in self.pages:
                if name in page.watches and page.watches[name].begun:
                    page.tell_video(name, [frame])
        for page in self.pages:
            for name, watch in page.watches.items():
                if not watch.begun:
                    watch.begun = True
                    page.tell_video(name, self._videos.cameras[name].group)

    def _tell_links(self) -> None:
        """Tell all pages how the daemon is reached, when that has changed."""
        connection = self._connection
        since = None if connection is None else connection.state_since_s
        silent = since is None or time.monotonic() - since > SILENT_S
        link = {
            "daemon": "silent" if silent else "alive",
            "pages": len(self.pages),
            "holders": sorted(p.client.name for p in self.pages if p.client.secret is not None),
            "description": None if connection is None else connection.description,
        }
        if self._link != link:
            self._link = link
            for page in self.pages:
                self._tell_link(page)

    def _tell_link(self, page: Page) -> None:
        described: Description | None = self._link["description"]
        page.tell(
            {"type": "link", "you": page.client.name, "role": str(page.role), **self._link}
            | {"description": None if described is None else described.model_dump(mode="json")}
        )


def told_state(state: State, cause: Event | None) -> str:
    """Return a state as a page is told it, as JSON that more is added to; ends with a comma.

    All limits that act in the cell's tasks, and why the arm is in its mode, are words.
    """
    names = {name for task in (state, *state.tasks.values()) for name in task.limits}
    limits = json.dumps({name: limit_words(name) for name in names})
    words = json.dumps(why(state, cause))
    return f'{{"type":"state","state":{state.model_dump_json()},"limits":{limits},"why":{words},'
