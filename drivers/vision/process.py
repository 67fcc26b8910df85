"""Process of the cameras: looks through each at its rate, and tells the daemon what is seen.

A process of its own, so that no picture ever delays the control loop or the physics. The same code
looks at pictures of real cameras and at rendered ones.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

from ...config.schema.surroundings import CameraSection
from ...protocols import topics as t
from ...protocols.codec import encode
from ...protocols.messages.perception import (
    LARGEST_FRAME,
    LARGEST_JPEG,
    CameraPicture,
    Sighting,
    VideoPiece,
)
from ...protocols.messages.rig import RigTruth
from ...protocols.messages.telemetry import State
from ..device import DeviceError
from ..network.sensor_session import Over, newest
from ..network.session import Session
from .detector import Detection, Detector, Picture, told
from .opencv import save, small_jpeg
from .video import VideoEncoder

SAVE_EVERY_S = 1.0
"""Pictures are saved at most this often [s]."""

SHOW_EVERY_S = 0.2
"""People are shown a camera's picture at most this often, while somebody looks [s]."""


Eye = Callable[[], Picture | None]
"""Returns a picture, None where there is none yet. Raises `DeviceError`."""


class Looker:
    """Looks through one camera at its rate, and sends what it sees.

    While people look at it large, its pictures are taken for their video as well, at a rate of its
    own; one that is due for both is taken once.
    """

    def __init__(self, camera: CameraSection, eye: Eye, period_s: float) -> None:
        self.camera = camera
        self.due_s = self.video_due_s = 0.0
        self.watched = False
        self.pictures = self.seen = 0
        self._eye = eye
        self._detector = Detector(camera)
        # A rendered picture is as old as the joint angles that made it; a real one is older than
        # the newest telemetry by what the cell says.
        self._late_ticks = 0 if camera.device is None else round(camera.latency_s / period_s)

    @property
    def next_s(self) -> float:
        """When the next picture is due, for whatever it is [s]."""
        return min(self.due_s, self.video_due_s) if self.watched else self.due_s

    def exposed(self, newest_tick: int) -> int:
        """Return the tick in which a picture was exposed that is there now."""
        return max(0, newest_tick - self._late_ticks)

    def look(self, newest_tick: int, now_s: float) -> tuple[Sighting, Picture, Detection] | None:
        """Return the message of one picture, with what it is about; None without a picture."""
        self.due_s = max(self.due_s + 1.0 / self.camera.rate_hz, now_s)
        picture = self._eye()
        if picture is None:
            return None
        sight = self._detector.look(picture)
        self.pictures += 1
        self.seen += bool(sight.candidates)
        return told(self.camera, self.exposed(newest_tick), sight), picture, sight

    def film(self, now_s: float, picture: Picture | None) -> Picture | None:
        """Return a picture for the video if one is due; `picture` is one that there is already.

        None where none is due, or there.
        """
        period_s = 1.0 / self.camera.video_hz
        early_s = 0.0 if picture is None else period_s / 2
        if not self.watched or now_s < self.video_due_s - early_s:
            return None
        self.video_due_s = max(self.video_due_s + period_s, now_s)
        return self._eye() if picture is None else picture


class _Video:
    """The video of one camera, made while somebody looks."""

    def __init__(self, session: Session, camera: CameraSection) -> None:
        self._session, self._camera = session, camera
        self._topic = t.VIDEO.by(camera.name)
        self._encoder: VideoEncoder | None = None
        self._impossible = False
        self._frame = 0

    def watched(self) -> bool:
        """Return whether it is to be made; once nobody looks any more it begins anew."""
        if self._impossible or not self._session.heard(self._topic):
            if self._encoder is not None:
                self._encoder.end()
            return False
        if self._encoder is None:
            try:
                self._encoder = VideoEncoder(self._camera)
            except DeviceError as error:
                self._impossible = True
                print(f"telerobot: {error}; small pictures go on", file=sys.stderr, flush=True)
        return not self._impossible

    def tell(self, tick: int, picture: Picture, now_s: float) -> None:
        """Send a picture as the next frame; one that stays too large is left out."""
        encoded = None if self._encoder is None else self._encoder.encode(picture, now_s)
        if self._encoder is None or encoded is None:
            return
        if len(encoded.data) > LARGEST_FRAME:
            self._encoder.end()
            return
        self._frame += 1
        starts = range(0, len(encoded.data), LARGEST_JPEG)
        for i, start in enumerate(starts):
            piece = VideoPiece(
                camera=self._camera.name, tick=tick, frame=self._frame, key=encoded.key, piece=i,
                pieces=len(starts), data=encoded.data[start : start + LARGEST_JPEG],
            )  # fmt: skip
            self._session.put(self._topic, encode(piece))


class PictureWork:
    """The process's loop: hear the daemon, look, tell."""

    def __init__(
        self,
        session: Session,
        lookers: list[Looker],
        on_truth: Callable[[RigTruth], None] | None,
        folder: Path | None,
    ) -> None:
        """`on_truth` is called with what the rig tells; pictures are saved in a `folder`."""
        self._session, self._lookers, self._folder = session, lookers, folder
        self._on_truth = on_truth
        self._states = session.subscribe(t.STATE, 1)
        self._truths = session.subscribe(t.RIG_TRUTH, 1)
        self._tick: int | None = None
        self._saved: dict[str, float] = {}
        self._shown: dict[str, float] = {}
        self._videos = {looker: _Video(session, looker.camera) for looker in lookers}

    def run(self, over: Over) -> None:
        """Look through every camera when it is due. Raises `DeviceError`."""
        while not over():
            for each, video in self._videos.items():
                each.watched = video.watched()
            looker = min(self._lookers, key=lambda each: each.next_s)
            time.sleep(min(0.1, max(0.0, looker.next_s - time.monotonic())))
            self._hear()
            now_s = time.monotonic()
            if self._tick is None:
                time.sleep(0.01)
            elif now_s >= looker.next_s:
                picture = self._look(looker, self._tick, now_s) if now_s >= looker.due_s else None
                picture = looker.film(now_s, picture)
                if picture is not None:
                    self._videos[looker].tell(looker.exposed(self._tick), picture, now_s)

    def _hear(self) -> None:
        state = newest(self._states, State, t.STATE.max_bytes)
        if state is not None:
            self._tick = state.tick
        truth = newest(self._truths, RigTruth, t.RIG_TRUTH.max_bytes)
        if truth is not None and self._on_truth is not None:
            self._on_truth(truth)

    def _look(self, looker: Looker, tick: int, now_s: float) -> Picture | None:
        looked = looker.look(tick, now_s)
        if looked is None:
            return None
        sighting, picture, sight = looked
        self._session.put(t.SIGHTING, encode(sighting))
        name = looker.camera.name
        due = now_s - self._shown.get(name, -1e9) >= SHOW_EVERY_S
        if due and self._session.heard(t.PICTURE):
            self._shown[name] = now_s
            self._show(name, sighting.tick, picture)
        if self._folder is not None and now_s - self._saved.get(name, -1e9) >= SAVE_EVERY_S:
            self._saved[name] = now_s
            save(self._folder / f"{name}.png", picture, sight.corners)
        return picture

    def _show(self, name: str, tick: int, picture: Picture) -> None:
        """Tell people what a camera sees; a picture that stays too large is left out."""
        jpeg = small_jpeg(picture, LARGEST_JPEG)
        if jpeg is not None:
            self._session.put(t.PICTURE, encode(CameraPicture(camera=name, tick=tick, jpeg=jpeg)))
