"""Cameras of a simulation: pictures in virtual time, at each camera's rate and latency.

What a picture shows is found by the same code that looks at real ones. The pictures themselves
are rendered, so that this needs OpenCV and something to render with.
"""

import numpy as np

from ...config.load import Cell
from ...config.schema.surroundings import CameraSection
from ...drivers.rig.physics.camera import RigCameras
from ...drivers.rig.rig import Rig
from ...drivers.vision.detector import Detector
from ...drivers.vision.process import told
from ...protocols.messages.perception import Sighting
from .sensors import Put, SimulatedCameras


class RenderedCameras(SimulatedCameras):
    """All rendered cameras of a simulated cell. Raises `DeviceError` where none can be rendered."""

    def __init__(self, cell: Cell, rig: Rig, put: Put) -> None:
        super().__init__([c for c in cell.cameras if c.device is None], put)
        self._rig, self._pictures = rig, RigCameras(cell)
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
        return told(camera, tick, self._detectors[camera.name].look(picture)), 0.0

    def close(self) -> None:
        self._pictures.close()
