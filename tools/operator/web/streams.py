"""Streams to pages: video of cameras, and what is seen around the arm."""

import base64
import json
import struct
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, Final, NamedTuple

from ....drivers.network.session import Buffer, MessageCarrier
from ....protocols import topics as t
from ....protocols.codec import CodecError, decode_as
from ....protocols.messages.perception import (
    NOTHING,
    CameraPicture,
    ContourNews,
    ObstacleNews,
    ScanPoints,
    VideoPiece,
)
from ....protocols.messages.rig import RigTruth
from ....protocols.messages.telemetry import State
from ..words import passage_words

# --- Surroundings that a page is shown: obstacles, contour, scans and pictures, as sensors tell ---
TRUTH_S: Final = 1 / 20  # pages are told the rig's truth at most this often [s]


class Told(NamedTuple):
    """A message for all pages, as JSON."""

    kind: str  # newer messages of a kind make older ones needless; empty: each one counts
    text: str


class WorldNews:
    """Reads what sensors and the rig tell; asks for what is for eyes while somebody looks."""

    def __init__(self, session: MessageCarrier) -> None:
        self._session = session
        self._truths = session.subscribe(t.RIG_TRUTH, 1)
        self._obstacles = session.subscribe(t.HELD, t.HELD.unread)
        self._contours = session.subscribe(t.CONTOUR, 1)
        self._looked_at: dict[t.Topic, Buffer] = {}
        self._truth_s = float("-inf")

    def turn(self, now_s: float, looked_at: bool) -> Iterator[Told]:
        """Yield what is new; `looked_at` says whether any page is open."""
        if looked_at and not self._looked_at:
            self._looked_at = {
                topic: self._session.subscribe(topic, topic.unread) for topic in FOR_EYES
            }
        elif not looked_at:
            for inbox in self._looked_at.values():
                inbox.close()
            self._looked_at = {}
        if now_s - self._truth_s >= TRUTH_S:
            self._truth_s = now_s
            yield from _read(self._truths, t.RIG_TRUTH, told_truth)
        yield from _read(self._obstacles, t.HELD, told_obstacle)
        yield from _read(self._contours, t.CONTOUR, told_contour)
        for topic, inbox in self._looked_at.items():
            yield from _read(inbox, topic, FOR_EYES[topic])


def _read(inbox: Buffer, topic: t.Topic, tell: Callable[[Any], Told]) -> Iterator[Told]:
    for payload in inbox.take():
        try:
            message = decode_as(topic.message, payload, topic.max_bytes)
        except CodecError:
            continue  # of another version, or junk: the page does without
        yield tell(message)


def told_truth(truth: RigTruth) -> Told:
    """Return the rig's truth as a page is told it."""
    return Told("truth", f'{{"type":"truth","truth":{truth.model_dump_json()}}}')


def told_obstacle(news: ObstacleNews) -> Told:
    """Return an obstacle, as the daemon holds it, as a page is told it."""
    return Told("", f'{{"type":"obstacle","obstacle":{news.model_dump_json()}}}')


def told_contour(news: ContourNews) -> Told:
    """Return a contour as a page is told it, with words for the passage."""
    cells = struct.unpack(f"<{news.rows * news.columns}H", news.nearest_mm)
    contour = {
        **news.model_dump(include={"tick", "rows", "columns", "cell", "phase", "most_speed"}),
        "nearest_mm": [None if each == NOTHING else each for each in cells],
        "words": passage_words(news.phase, news.reason),
    }
    return Told("contour", json.dumps({"type": "contour", "contour": contour}))


def told_picture(picture: CameraPicture) -> Told:
    told = {"camera": picture.camera, "tick": picture.tick}
    jpeg = base64.b64encode(picture.jpeg).decode()
    text = json.dumps({"type": "picture", "picture": {**told, "jpeg": jpeg}})
    return Told(f"picture {picture.camera}", text)


def told_scan(scan: ScanPoints) -> Told:
    """Return a scan as a page is told it: its points as they came, in base 64."""
    points = base64.b64encode(scan.points_mm).decode()
    text = json.dumps({"type": "scan", "scan": {"tick": scan.tick, "points_mm": points}})
    return Told("scan", text)


FOR_EYES: Final[Mapping[t.Topic, Callable[[Any], Told]]] = {
    t.PICTURE: told_picture,
    t.SCAN: told_scan,
}
"""What is made only while somebody looks, and how a page is told it."""


# --- Video of cameras that pages look at large: H.264 from beside the camera, passed on as it is
#
# Nothing is decoded or encoded here. A camera is listened to while some page looks at it; a
# page that reads slowly is given fewer frames, and never older ones.
LATE_S: Final = 0.7
"""A page that has not received a frame for so long after it was sent gets no more for now [s]."""

MOST_WAITING: Final = 90
"""Frames that wait for a page, or that a video goes back to its last key frame [1]."""

_HEAD: Final = "<BBHII"
"""Head of a frame for a page: key frame, length of the camera's name, 0, number, tick; the name
and the access unit follow."""

_DRIFT: Final = 2e-4  # clocks of two machines drift apart by less than this [s/s]

_JUMP_S: Final = 1.0
"""Telemetry that is later by more is that of another start, or comes another way [s]."""


class VideoFrame(NamedTuple):
    """One frame of a camera's video."""

    number: int
    key: bool  # needs no frame before it
    message: bytes  # as a page is told it


class DaemonClock:
    """Tells when, on the console's clock, telemetry of a tick would have come at the earliest."""

    def __init__(self, period_s: float) -> None:
        self.period_s = period_s
        self.zero_s: float | None = None
        """Time at which the telemetry of tick 0 would have come [s]; None before any has.

        Counted back from the newest tick: one that was skipped moves it.
        """
        self._ahead_s = self._heard_s = float("-inf")

    def on_state(self, state: State, now_s: float) -> None:
        sample = now_s - state.time_s
        known = (
            self._ahead_s + _DRIFT * (now_s - self._heard_s) if self.zero_s is not None else sample
        )
        self._ahead_s = sample if abs(sample - known) > _JUMP_S else min(sample, known)
        self._heard_s = now_s
        self.zero_s = self._ahead_s + state.time_s - state.tick * self.period_s


class CameraVideo:
    """Puts the frames of one camera together from their pieces; one that lacks a piece is lost."""

    def __init__(self, inbox: Buffer) -> None:
        self.inbox = inbox
        self.group: list[VideoFrame] = []
        """All frames since the last key frame: who comes in begins with them."""
        self._pieces: list[VideoPiece] = []
        self._next: int | None = None

    def take(self) -> Iterator[VideoFrame]:
        """Yield the frames that are whole, and follow on those before them."""
        for payload in self.inbox.take():
            try:
                piece = decode_as(VideoPiece, payload, t.VIDEO.max_bytes)
            except CodecError:
                continue  # of another version, or junk
            frame = self._whole(piece)
            if frame is not None:
                self.group = [frame] if frame.key else [*self.group, frame][-MOST_WAITING:]
                yield frame

    def _whole(self, piece: VideoPiece) -> VideoFrame | None:
        first = self._pieces[0] if self._pieces else piece
        same = (piece.frame, piece.pieces, piece.key) == (first.frame, first.pieces, first.key)
        if piece.piece != len(self._pieces) or not same:
            self._pieces = []
            if piece.piece:
                return None
        self._pieces.append(piece)
        if len(self._pieces) < piece.pieces:
            return None
        data = b"".join(each.data for each in self._pieces)
        self._pieces = []
        if not piece.key and piece.frame != self._next:
            self._next = None  # one before it was lost: it means nothing until the next key frame
            return None
        self._next = piece.frame + 1
        name = piece.camera.encode()
        head = struct.pack(
            _HEAD, piece.key, len(name), 0, piece.frame & 0xFFFFFFFF, piece.tick & 0xFFFFFFFF
        )
        return VideoFrame(piece.frame & 0xFFFFFFFF, piece.key, head + name + data)


class Videos:
    """Hears the videos of those cameras that pages look at, and of no other."""

    def __init__(self, session: MessageCarrier) -> None:
        self._session = session
        self.cameras: dict[str, CameraVideo] = {}

    def turn(self, watched: Collection[str]) -> Iterator[tuple[str, VideoFrame]]:
        """Yield the frames that came, with their cameras; `watched` names those looked at."""
        for name in set(self.cameras) - set(watched):
            self.cameras.pop(name).inbox.close()
        for name in set(watched) - set(self.cameras):
            topic = t.VIDEO.by(name)
            self.cameras[name] = CameraVideo(self._session.subscribe(topic, topic.unread))
        for name, camera in self.cameras.items():
            for frame in camera.take():
                yield name, frame


class Watch:
    """One camera that a page looks at large, and what the page has received of its video."""

    def __init__(self) -> None:
        self.begun = False  # True once it was given what there is since the last key frame
        self.waiting: deque[VideoFrame] = deque()
        self.sent_s = float("-inf")  # when a frame was sent last [s]
        self._unseen: deque[tuple[int, float]] = deque()
        self._lost = True

    def received(self, number: int) -> None:
        """Take in the newest frame that the page has received."""
        if any(each == number for each, _ in self._unseen):
            while self._unseen.popleft()[0] != number:
                pass

    def offer(self, frame: VideoFrame, now_s: float) -> None:
        """Let a frame wait for the page, unless the page is behind."""
        late = bool(self._unseen) and now_s - self._unseen[0][1] > LATE_S
        if late or len(self.waiting) >= MOST_WAITING:
            self.waiting.clear()
            self._lost = True  # the next that it gets is a key frame
        elif frame.key or not self._lost:
            if frame.key:
                self.waiting.clear()
            self._lost = False
            self.waiting.append(frame)

    def next(self, now_s: float) -> bytes:
        """Return the frame that is to be sent now, of those that wait."""
        frame = self.waiting.popleft()
        self.sent_s = now_s
        self._unseen.append((frame.number, now_s))
        return frame.message


def watched_in(beat: Any, cameras: Collection[str]) -> dict[str, int]:
    """Return the cameras that a page's beat says are looked at, with the newest frame received.

    Raises `ValueError` for what is no such table; cameras that the cell has not are left out.
    """
    if not isinstance(beat, dict):
        raise ValueError("video: give a table of cameras")
    found = {name: number for name, number in beat.items() if name in cameras}
    if not all(isinstance(number, int) for number in found.values()):
        raise ValueError("video: give the number of the newest frame of each camera")
    return found
