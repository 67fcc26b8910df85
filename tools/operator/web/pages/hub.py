"""One Zenoh session behind any number of pages: telemetry is read once and passed on to all.

Each page is an operator of its own to the daemon, with its own lease, seals and name.
"""

import asyncio
import json
import time
from collections import deque
from collections.abc import Callable, Collection
from typing import Final, NamedTuple

from .....protocols import topics as t
from .....protocols.codec import encode
from .....protocols.messages import requests
from .....protocols.messages.telemetry import Description, Event, State
from .....protocols.topics import Role
from ....client.connection import Connection, OperatorError
from ...words.events import event_words
from ...words.limits import limit_words
from ...words.why import is_cause, why
from .page import Page
from .surroundings import WorldNews
from .video import DaemonClock, Videos

POLL_S: Final = 0.002
STATE_S: Final = 1 / 60
"""Pages are told the state this often [s]."""

SILENT_S: Final = 0.3
"""Telemetry older than this is missing: the pages are told [s]."""

RETRY_S: Final = 1.0
KEPT_EVENTS: Final = 50
"""Events that a page is told which comes later [1]."""


class DaemonLink(NamedTuple):
    """How the daemon is reached, and by whom."""

    daemon: str
    """"alive", or "silent"."""
    pages: int
    """Pages that are open [1]."""
    holders: list[str]
    """Names of the pages that hold a lease."""
    description: Description | None


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
        self._link = DaemonLink("silent", 0, [], None)
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
        text = (
            f'{{"type":"state","tick":{state.tick},"t":{state.time_s},'
            f'"state":{state.model_dump_json()},"limits":{json.dumps(limits_of(state))},'
            f'"why":{json.dumps(why(state, self._cause))},"mine":'
        )
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
        """Pass on what the sensors and the rig tell."""
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
        told = self._link
        self._link = DaemonLink(
            "silent" if silent else "alive",
            len(self.pages),
            sorted(p.client.name for p in self.pages if p.client.secret is not None),
            None if connection is None else connection.description,
        )
        if self._link != told:
            for page in self.pages:
                self._tell_link(page)

    def _tell_link(self, page: Page) -> None:
        link = self._link
        described = None if link.description is None else link.description.model_dump(mode="json")
        page.tell(
            {"type": "link", "you": page.client.name, "role": str(page.role)}
            | {**link._asdict(), "description": described}
        )


def limits_of(state: State) -> dict[str, str]:
    """Return all limits that act in a cell's tasks, in words, by their names."""
    names = {name for task in (state, *state.tasks.values()) for name in task.limits}
    return {name: limit_words(name) for name in names}
