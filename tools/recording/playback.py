"""`telerobot console`: the live page, or a recorded run's."""

import argparse
import asyncio
import base64
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final, TypeVar

from aiohttp import web
from pydantic import ValidationError

from ...protocols.messages.messages import Message
from ...protocols.messages.perception import CameraPicture, ContourNews, ObstacleNews, ScanPoints
from ...protocols.messages.rig import RigTruth
from ...protocols.messages.telemetry import Event, State
from ..host.progress import counted
from ..operator.web import cli as live
from ..operator.web.pages import told_state
from ..operator.web.server import Access, Listen, SceneServer
from ..operator.web.streams import (
    Told,
    told_contour,
    told_obstacle,
    told_picture,
    told_scan,
    told_truth,
)
from ..operator.words import event_words, is_cause
from .run_file import Recorded, RecordError, read_cell, read_run, read_scene

# --- A recorded run, cut into pieces of a few seconds that a page asks for as it plays ------------
#
# Each piece holds the messages that a live page would be told, with their time `t` in the run
# [s], and begins with the newest of everything from before, so that a page can begin anywhere.
PIECE_S: Final = 4.0  # length of a piece [s]

STATE_S: Final = 1 / 25  # messages of one kind are at least so far apart [s]: the eye sees no more

BYTES: Final = ("jpeg", "nearest_mm", "points_mm")
"""Fields that a recording has as text."""

Words = Mapping[str, Any]
M = TypeVar("M", bound=Message)


class Timeline:
    """One recorded run; raises `RecordError`, `ConfigError`, `OSError` for one that cannot be."""

    def __init__(self, path: Path) -> None:
        self.cell = read_cell(path)
        self.scene = read_scene(path)
        """What the page drew when the run was recorded; None in older recordings."""
        self.events: list[Words] = []  # all events in words, each with its time `t` [s]
        self.length_s = 0.0
        self.states = 0  # states that can be shown [1]
        self._path = path
        self._cause: Event | None = None
        self._pieces: list[bytes] = []
        self._open: list[str] = []
        self._newest: dict[str, tuple[float, str]] = {}
        self._start_ns: int | None = None
        self._told = False
        """Whether an event came since the newest state: the next one is shown in any case."""
        self._read()
        if not self.states:
            raise RecordError(
                f"{path}: holds no states to show; a black box is for `telerobot replay`"
            )

    @property
    def summary(self) -> Words:
        """The run as a page is told of it first."""
        return {
            "name": self._path.name,
            "cell": self.cell.config.name,
            "length_s": self.length_s,
            "piece_s": PIECE_S,
            "events": self.events,
        }

    def piece(self, i: int) -> bytes | None:
        """Return the messages from `i` · `PIECE_S` on, as JSON; None beyond the end."""
        return zlib.decompress(self._pieces[i]) if 0 <= i < len(self._pieces) else None

    def _read(self) -> None:
        tellers = self._tellers()
        messages = read_run(self._path, tuple(tellers))
        for message in counted(messages, "read", "messages"):
            if self._start_ns is None:
                self._start_ns = message.stamp_ns
            t = max(0.0, (message.stamp_ns - self._start_ns) / 1e9)
            self.length_s = max(self.length_s, t)
            while t >= PIECE_S * (len(self._pieces) + 1):
                self._close_piece()
            try:
                tellers[message.topic](t, message)
            except (ValidationError, ValueError, TypeError, KeyError) as error:
                words = " ".join(str(error).split())[:200]
                raise RecordError(f"{self._path}: a message of {message.topic}: {words}") from None
        self._close_piece()

    def _tellers(self) -> Mapping[str, Callable[[float, Recorded], None]]:
        contour = self._other("contour", ContourNews, told_contour)
        obstacle = self._other("obstacle", ObstacleNews, told_obstacle)
        return {
            "state": self._state,
            "event": self._event,
            "truth": self._other("truth", RigTruth, told_truth),
            "obstacle": obstacle,
            "sensor/obstacle": obstacle,  # as it was put, in older recordings
            "sensor/contour": contour,
            "contour": contour,  # as a simulation names it
            "scan": self._other("scan", ScanPoints, told_scan, tick=0),
            "view/picture": self._other("picture", CameraPicture, told_picture),
        }

    def _state(self, t: float, message: Recorded) -> None:
        if not self._told and not self._due("state", t):
            return
        self._told = False
        state = State.model_validate(message.json())
        self.states += 1
        self._add("state", t, told_state(state, self._cause)[:-1] + "}")

    def _event(self, t: float, message: Recorded) -> None:
        event = Event.model_validate(message.json())
        if is_cause(event):
            self._cause = event
        self._told = True
        self.events.append({"t": t, **event.model_dump(mode="json"), **event_words(event)})

    def _other(
        self, kind: str, message: type[M], tell: Callable[[M], Told], **given: int
    ) -> Callable[[float, Recorded], None]:
        """Return what takes in a message of a kind, with fields that are `given` beside it."""

        def take(t: float, recorded: Recorded) -> None:
            row = recorded.json()
            name = f"{kind} {row.get('camera') or row.get('name') or ''}"
            if self._due(name, t):
                whole = {
                    key: base64.b64decode(value) if key in BYTES else value
                    for key, value in row.items()
                }
                self._add(name, t, tell(message.model_validate({**given, **whole})).text)

        return take

    def _due(self, name: str, t: float) -> bool:
        last = self._newest.get(name)
        return last is None or t - last[0] >= STATE_S - 1e-6

    def _add(self, name: str, t: float, text: str) -> None:
        self._newest[name] = (t, text)
        self._open.append(_timed(t, text))

    def _close_piece(self) -> None:
        self._pieces.append(zlib.compress(f"[{','.join(self._open)}]".encode(), 1))
        self._open = [_timed(t, text) for t, text in self._newest.values()]


def _timed(t: float, text: str) -> str:
    return f'{{"t":{t:.4f},{text[1:]}'


# --- The HTTP of a recorded run: its page, its scene, and its pieces; nothing can be sent ---------
class PlaybackServer(SceneServer):
    """Serves the page of one recorded run, to who knows either secret."""

    INDEX = "playback.html"

    def __init__(self, timeline: Timeline, access: Access, listen: Listen, secure: bool) -> None:
        super().__init__(timeline.cell, access, listen, secure, timeline.scene)
        self._timeline = timeline

    def _add_routes(self, router: web.UrlDispatcher) -> None:
        router.add_get("/run.json", self._run)
        router.add_get(r"/pieces/{number:\d{1,9}}.json", self._piece)

    async def _run(self, _request: web.Request) -> web.StreamResponse:
        return web.json_response(self._timeline.summary)

    async def _piece(self, request: web.Request) -> web.StreamResponse:
        piece = self._timeline.piece(int(request.match_info["number"]))
        if piece is None:
            raise web.HTTPNotFound
        return web.Response(body=piece, content_type="application/json")


# --- `telerobot console`: a cell's page; of a recorded run, the page with its time line -----------
RECORDING: Final = ".mcap"  # end of the name of a recorded run


def run(args: argparse.Namespace) -> int:
    """Serve a page until told to end. Raises `ConfigError`, `RecordError`, `OSError`."""
    file = Path(args.cell)
    if file.suffix != RECORDING:
        return live.run(args)
    listen = live.listen_of(args)
    timeline = Timeline(file)
    return asyncio.run(_play(timeline, listen, args))


async def _play(timeline: Timeline, listen: Listen, args: argparse.Namespace) -> int:
    def server(access: Access, secure: bool) -> PlaybackServer:
        return PlaybackServer(timeline, access, listen, secure)

    return await live.serve_page(timeline.cell, listen, args, None, server, asyncio.Event().wait)
