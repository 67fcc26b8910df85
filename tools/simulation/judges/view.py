"""Judge of the view: its true distance from the stored one, by physics, never by pictures."""

import math
from dataclasses import dataclass
from typing import Self

from ....config.load import Cell
from ....config.schema.surroundings import CameraSection, RigTagSection
from ....protocols.messages.rig import RigTruth
from ....protocols.messages.telemetry import Event
from ....server.control.spatial import Pose, rotation_log


@dataclass(frozen=True)
class _JudgedCamera:
    """A camera, and the arm whose task it is for."""

    camera: CameraSection
    arm: str
    T_mrf_wrist: Pose
    T_world_base: Pose

    @classmethod
    def of(cls, part: Cell, camera: CameraSection) -> Self:
        mechanism = part.config.mechanism
        mrf, base = mechanism.T_wrist_mrf, mechanism.T_world_base
        T_mrf_wrist = Pose.from_xyz_rpy(mrf.xyz, mrf.rpy).inverse()
        return cls(camera, mechanism.name, T_mrf_wrist, Pose.from_xyz_rpy(base.xyz, base.rpy))


class ViewJudge:
    """Remembers the true view when one is stored, and compares."""

    def __init__(self, cell: Cell) -> None:
        self._eyes = {
            c.name: _JudgedCamera.of(part, c) for part in cell.parts for c in part.config.cameras
        }
        tags = () if cell.config.rig is None else cell.config.rig.tags
        self._tags = {tag.tag: tag for tag in tags}
        kept = (part.config.sources.vision.camera for part in cell.parts)
        self._camera = next((name for name in kept if name), None) or next(iter(self._eyes), "")
        self._stored: Pose | None = None

    def view(self, truth: RigTruth, camera: str | None = None) -> Pose | None:
        """Return the true pose of a camera's tag in its Lens, None where there is no such tag."""
        eye = self._eyes.get(camera or self._camera)
        tag = None if eye is None else self._tags.get(eye.camera.tag)
        if eye is None or tag is None:
            return None
        pose = truth.arms[eye.arm].pose_mrf
        T_world_wrist = Pose.from_xyz_rpy(pose[:3], pose[3:]) @ eye.T_mrf_wrist
        base = truth.frames.get("base")
        T_world_base = eye.T_world_base if base is None else Pose.from_xyz_rpy(base[:3], base[3:])
        return _lens(eye.camera, T_world_wrist, T_world_base).inverse() @ _tag(
            tag, T_world_wrist, truth
        )

    def on_event(self, event: Event, truth: RigTruth) -> None:
        """Take in an event, with the truth at its time."""
        if event.name == "view_stored":
            self._camera = event.detail or self._camera
            self._stored = self.view(truth)

    def error(self, truth: RigTruth) -> tuple[float, float] | None:
        """Return how far the Lens is from the stored view [m, rad], None before one is stored.

        Of a camera beside the arm: how far the target is.
        """
        now = self.view(truth)
        if self._stored is None or now is None:
            return None
        carried = self._eyes[self._camera].camera.on == "wrist"
        a, b = (self._stored.inverse(), now.inverse()) if carried else (self._stored, now)
        turn = rotation_log(a.R.T @ b.R)
        way = b.p - a.p
        return math.sqrt(float(way @ way)), math.sqrt(float(turn @ turn))


def _lens(camera: CameraSection, T_world_wrist: Pose, T_world_base: Pose) -> Pose:
    stands = {"wrist": T_world_wrist, "base": T_world_base, "world": Pose.identity()}
    return stands[camera.on] @ Pose.from_xyz_rpy(camera.place.xyz, camera.place.rpy)


def _tag(tag: RigTagSection, T_world_wrist: Pose, truth: RigTruth) -> Pose:
    if tag.T_wrist_tag is not None:
        return T_world_wrist @ Pose.from_xyz_rpy(tag.T_wrist_tag.xyz, tag.T_wrist_tag.rpy)
    pose = truth.tags[tag.name]
    return Pose.from_xyz_rpy(pose[:3], pose[3:])
