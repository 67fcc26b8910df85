"""`telerobot vision CELL`: finds tags in the cameras' pictures and sends sightings to the daemon.

A process of its own, so that no picture ever delays the control loop or the physics. Cameras with
a `device` are read through OpenCV; the others are rendered from the joint angles that the virtual
hardware tells. Either way the same code looks at the picture.
"""

import argparse
from functools import partial
from typing import TYPE_CHECKING

from ...config.load import ConfigError
from ...config.schema.surroundings import CameraSection
from ...drivers.network.identity import identity_of
from ...drivers.network.sensor_session import dial
from ...drivers.vision.device import VideoCamera
from ...drivers.vision.process import Eye, Looker, PictureWork
from ...protocols import topics as t
from ...protocols.topics import Role
from ..host.address import cell_from
from ..host.local_plant import until_told

if TYPE_CHECKING:
    from ...drivers.rig.physics.camera import ToldCameras


def run(args: argparse.Namespace) -> int:
    """Look until told to end. Raises `ConfigError`, `DeviceError`."""
    cell = cell_from(args)
    cameras = [c for c in cell.cameras if args.camera in (None, c.name)]
    if not cameras:
        wanted = "cameras" if args.camera is None else f"camera {args.camera!r}"
        raise ConfigError(f"{cell.path}: cameras: the cell has no {wanted}")
    identity = identity_of(cell, Role.SENSOR, "vision", t.SIGHTING.key)
    over = until_told(args.seconds)
    world = None
    if any(c.device is None for c in cameras):
        from ...drivers.rig.physics.camera import ToldCameras  # not needed for real cameras

        world = ToldCameras(cell)
    on_truth = None if world is None else world.on_truth
    lookers = [Looker(c, _eye(c, world), cell.config.timing.period_s) for c in cameras]
    if args.pictures is not None:
        args.pictures.mkdir(parents=True, exist_ok=True)
    session = dial(cell, identity, over, f"the cameras of {cell.config.name} are looking")
    if session is not None:
        try:
            PictureWork(session, lookers, on_truth, args.pictures).run(over)
        finally:
            session.close()
    for looker in lookers:
        print(f"{looker.camera.name}: {looker.pictures} pictures, tag in {looker.seen}")
    return 0


def _eye(camera: CameraSection, world: "ToldCameras | None") -> Eye:
    if world is None or camera.device:
        return VideoCamera(camera).picture
    return partial(world.seen, camera.name)
