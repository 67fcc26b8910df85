"""Cameras that take no pictures, for cells whose pictures do not matter."""

from telerobot.config.schema.surroundings import CameraSection
from telerobot.drivers.rig.cameras import SimulatedCameras
from telerobot.protocols.messages.perception import Sighting


class Blind(SimulatedCameras):
    """No cameras at all, of any simulation."""

    def __init__(self, _simulation: object = None) -> None:
        super().__init__((), lambda _topic, _payload: None)

    def _look(self, camera: CameraSection, tick: int) -> tuple[Sighting, float]:
        raise NotImplementedError(f"{camera.name} looks at nothing")
