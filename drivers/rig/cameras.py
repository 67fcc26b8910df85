"""Virtual cameras in physics time, each at its rate and latency: rendered, or a subclass's."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from ...config.load import Cell
from ...config.schema.surroundings import CameraSection
from ...protocols.codec import encode
from ...protocols.messages.perception import Sighting
from ...protocols.topics import SIGHTING, Topic
from .rig import Rig

Put = Callable[[Topic, bytes], None]


@dataclass
class _Eye:
    camera: CameraSection
    due_s: float = 0.0
    underway: deque[tuple[float, bytes]] = field(default_factory=deque)
    """Arrival of each sighting [s], and its bytes."""


class SimulatedCameras(ABC):
    """Base of a simulated cell's cameras."""

    def __init__(self, cameras: Iterable[CameraSection], put: Put) -> None:
        self._eyes = [_Eye(camera) for camera in cameras]
        self._put = put

    def run(self, now_s: float, tick: int) -> None:
        """Hand over what has arrived by `now_s`, and look at what is exposed at SYNC `tick`."""
        for eye in self._eyes:
            while eye.underway and eye.underway[0][0] <= now_s + 1e-9:
                self._put(SIGHTING, eye.underway.popleft()[1])
            if now_s < eye.due_s - 1e-9:
                continue
            eye.due_s = now_s + 1.0 / eye.camera.rate_hz
            sighting, late_s = self._look(eye.camera, tick)
            eye.underway.append((now_s + eye.camera.latency_s + late_s, encode(sighting)))

    def close(self) -> None:  # noqa: B027  most hold nothing
        """Let go of what makes the pictures, if anything does."""

    @abstractmethod
    def _look(self, camera: CameraSection, tick: int) -> tuple[Sighting, float]:
        """Return what a camera sees, and how much later than its latency that is told [s]."""


class RenderedCameras(SimulatedCameras):
    """All rendered cameras of a simulated cell, looked at by the code that looks at real ones.

    Raises `DeviceError` where none can be rendered.
    """

    def __init__(self, cell: Cell, rig: Rig, put: Put) -> None:
        # Who computes what is seen does without OpenCV.
        from ..vision.detector import Detector, told
        from .physics.camera import RigCameras

        super().__init__([c for c in cell.cameras if c.device is None], put)
        self._rig, self._pictures = rig, RigCameras(cell)
        self._told = told
        self._detectors = {eye.camera.name: Detector(eye.camera) for eye in self._eyes}

    def _look(self, camera: CameraSection, tick: int) -> tuple[Sighting, float]:
        rig = self._rig
        picture = self._pictures.picture(
            camera.name,
            np.array(rig.world.q),
            rig.tags.covered,
            rig.tags.poses,
            rig.frames.get("base"),
        )
        return self._told(camera, tick, self._detectors[camera.name].look(picture)), 0.0

    def close(self) -> None:
        self._pictures.close()
