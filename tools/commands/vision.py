"""`telerobot vision CELL`: finds tags in the cameras' pictures and sends sightings to the daemon.

A process of its own, so that no picture ever delays the control loop or the physics. Cameras with
a `device` are read through OpenCV; the others are rendered from the joint angles that the virtual
hardware tells. Either way the same code looks at the picture.
"""

import argparse
import time
from pathlib import Path
from typing import Protocol

from ...config.load import Cell, ConfigError
from ...config.schema.sensors.cameras import CameraSection
from ...drivers.network.identity import identity_of
from ...drivers.network.sensor_session import Over, dial, newest
from ...drivers.network.session import Session
from ...drivers.vision.detector import Detection, Detector, Picture
from ...drivers.vision.device import VideoCamera
from ...drivers.vision.opencv import save, small_jpeg
from ...protocols import topics as t
from ...protocols.codec import encode
from ...protocols.messages import messages as m
from ...protocols.messages.perception.camera_picture import LARGEST_JPEG, CameraPicture
from ...protocols.messages.rig import RigTruth
from ...protocols.messages.telemetry import State
from ...protocols.topics import Role
from ..host.address import add_cell_arguments, cell_from, duration
from ..host.ending import until_told
from ..simulation.pictures import told

SAVE_EVERY_S = 1.0
"""Pictures are saved at most this often [s]."""

SHOW_EVERY_S = 0.2
"""People are shown a camera's picture at most this often, while somebody looks [s]."""


class _PictureSource(Protocol):
    """Source of pictures."""

    def picture(self) -> Picture | None:
        """Return a picture, None where there is none yet. Raises `DeviceError`."""
        ...


class _Rendered:
    """A camera of the virtual world."""

    def __init__(self, world: "_World", camera: CameraSection) -> None:
        self._world, self._name = world, camera.name

    def picture(self) -> Picture | None:
        """Return what the camera would see now."""
        return self._world.picture(self._name)


class _World:
    """The rig's copy, kept up to date by what the rig tells."""

    def __init__(self, cell: Cell) -> None:
        from ...drivers.rig.physics.sensors.camera import (
            RigCameras,  # not needed, nor MuJoCo, for real cameras
        )

        self._cameras = RigCameras(cell)
        self.truth: RigTruth | None = None

    def picture(self, camera: str) -> Picture | None:
        """Return what a camera would see, None before the rig has told anything."""
        if self.truth is None:
            return None
        truth = self.truth
        base = truth.frames.get("base")
        return self._cameras.picture(camera, truth.q, truth.covered, truth.tags, base)


class Looker:
    """Looks through one camera at its rate, and sends what it sees."""

    def __init__(self, camera: CameraSection, eye: _PictureSource, period_s: float) -> None:
        self.camera = camera
        self.due_s = 0.0
        self.pictures = self.seen = 0
        self._eye = eye
        self._detector = Detector(camera)
        # A rendered picture is as old as the joint angles that made it; a real one is older than
        # the newest telemetry by what the cell says.
        self._late_ticks = 0 if camera.device is None else round(camera.latency_s / period_s)

    def look(self, newest_tick: int, now_s: float) -> tuple[m.Message, Picture, Detection] | None:
        """Return the message of one picture, with what it is about; None without a picture."""
        self.due_s = max(self.due_s + 1.0 / self.camera.rate_hz, now_s)
        picture = self._eye.picture()
        if picture is None:
            return None
        sight = self._detector.look(picture)
        self.pictures += 1
        self.seen += bool(sight.candidates)
        return told(self.camera, max(0, newest_tick - self._late_ticks), sight), picture, sight


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    add_cell_arguments(parser)
    parser.add_argument("--camera", metavar="NAME", help="only this camera; all by default")
    parser.add_argument("--seconds", type=duration, help="end by itself after this long")
    parser.add_argument(
        "--pictures", metavar="FOLDER", type=Path, help="save what is seen there, once a second"
    )


def run(args: argparse.Namespace) -> int:
    """Look until told to end. Raises `ConfigError`, `DeviceError`."""
    cell = cell_from(args)
    cameras = [c for c in cell.cameras if args.camera in (None, c.name)]
    if not cameras:
        wanted = "cameras" if args.camera is None else f"camera {args.camera!r}"
        raise ConfigError(f"{cell.path}: cameras: the cell has no {wanted}")
    identity = identity_of(cell, Role.SENSOR, "vision", t.SIGHTING.key)
    over = until_told(args.seconds)
    world = _World(cell) if any(c.device is None for c in cameras) else None
    lookers = [Looker(c, _eye(c, world), cell.config.timing.period_s) for c in cameras]
    if args.pictures is not None:
        args.pictures.mkdir(parents=True, exist_ok=True)
    session = dial(cell, identity, over, f"the cameras of {cell.config.name} are looking")
    if session is not None:
        try:
            _PictureWork(session, lookers, world, args.pictures).run(over)
        finally:
            session.close()
    for looker in lookers:
        print(f"{looker.camera.name}: {looker.pictures} pictures, tag in {looker.seen}")
    return 0


class _PictureWork:
    """The process's loop: hear the daemon and the rig, look, tell."""

    def __init__(
        self, session: Session, lookers: list[Looker], world: _World | None, folder: Path | None
    ) -> None:
        self._session, self._lookers, self._world, self._folder = session, lookers, world, folder
        self._states = session.subscribe(t.STATE, 1)
        self._truths = session.subscribe(t.RIG_TRUTH, 1)
        self._tick: int | None = None
        self._saved: dict[str, float] = {}
        self._shown: dict[str, float] = {}

    def run(self, over: Over) -> None:
        """Look through every camera when it is due. Raises `DeviceError`."""
        while not over():
            looker = min(self._lookers, key=lambda each: each.due_s)
            time.sleep(min(0.1, max(0.0, looker.due_s - time.monotonic())))
            self._hear()
            now_s = time.monotonic()
            if self._tick is None:
                time.sleep(0.01)
            elif now_s >= looker.due_s:
                self._look(looker, self._tick, now_s)

    def _hear(self) -> None:
        state = newest(self._states, State, t.STATE.max_bytes)
        if state is not None:
            self._tick = state.tick
        truth = newest(self._truths, RigTruth, t.RIG_TRUTH.max_bytes)
        if truth is not None and self._world is not None:
            self._world.truth = truth

    def _look(self, looker: Looker, tick: int, now_s: float) -> None:
        looked = looker.look(tick, now_s)
        if looked is None:
            return
        sighting, picture, sight = looked
        self._session.put(t.SIGHTING, encode(sighting))
        name = looker.camera.name
        due = now_s - self._shown.get(name, -1e9) >= SHOW_EVERY_S
        if due and self._session.heard(t.PICTURE):
            self._shown[name] = now_s
            self._show(name, tick, picture)
        if self._folder is not None and now_s - self._saved.get(name, -1e9) >= SAVE_EVERY_S:
            self._saved[name] = now_s
            save(self._folder / f"{name}.png", picture, sight.corners)

    def _show(self, name: str, tick: int, picture: Picture) -> None:
        """Tell people what a camera sees; a picture that stays too large is left out."""
        jpeg = small_jpeg(picture, LARGEST_JPEG)
        if jpeg is not None:
            self._session.put(t.PICTURE, encode(CameraPicture(camera=name, tick=tick, jpeg=jpeg)))


def _eye(camera: CameraSection, world: _World | None) -> _PictureSource:
    return VideoCamera(camera) if world is None or camera.device else _Rendered(world, camera)
