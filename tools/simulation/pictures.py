"""Cameras of a simulation: pictures in virtual time, at each camera's rate and latency.

What a picture shows is found by the same code that looks at real ones. The pictures themselves
are rendered, so that this needs OpenCV and something to render with.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ...config.load import Cell
from ...config.schema.surroundings import CameraSection
from ...drivers.rig.physics.camera import RigCameras
from ...drivers.rig.rig import Rig
from ...drivers.vision.detector import Detector
from ...drivers.vision.process import told
from ...protocols.codec import encode
from ...protocols.topics import SIGHTING, Topic

Put = Callable[[Topic, bytes], None]


@dataclass
class _RenderedCamera:
    """One camera at work."""

    camera: CameraSection
    detector: Detector
    due_s: float = 0.0
    underway: deque[tuple[float, bytes]] = field(default_factory=deque)
    """Arrival of each sighting [s], and its bytes."""


class SimulatedCameras:
    """All rendered cameras of a simulated cell. Raises `DeviceError` where none can be rendered."""

    def __init__(self, cell: Cell, rig: Rig, put: Put) -> None:
        self._rig, self._put = rig, put
        self._pictures = RigCameras(cell)
        self._eyes = [_RenderedCamera(c, Detector(c)) for c in cell.cameras if c.device is None]

    def run(self, now_s: float, tick: int) -> None:
        """Hand over what has arrived by `now_s`, and take the pictures due at SYNC `tick`."""
        rig = self._rig
        for eye in self._eyes:
            while eye.underway and eye.underway[0][0] <= now_s + 1e-9:
                self._put(SIGHTING, eye.underway.popleft()[1])
            if now_s < eye.due_s - 1e-9:
                continue
            eye.due_s = now_s + 1.0 / eye.camera.rate_hz
            picture = self._pictures.picture(
                eye.camera.name,
                np.array(rig.world.q),
                rig.tags.covered,
                rig.tags.poses,
                rig.frames.get("base"),
            )
            sighting = told(eye.camera, tick, eye.detector.look(picture))
            eye.underway.append((now_s + eye.camera.latency_s, encode(sighting)))

    def close(self) -> None:
        self._pictures.close()
