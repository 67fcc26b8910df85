"""Joint bounds: the limits of the robot description, less the margin of each drive."""

from collections.abc import Iterable
from typing import NamedTuple

from ..schema.mechanism.mechanism import DriveSection
from ..urdf.robot import UrdfJoint


class JointBounds(NamedTuple):
    """Least and greatest angle that joints may be commanded to, in their order [rad]."""

    lower: tuple[float, ...]
    upper: tuple[float, ...]


def joint_bounds(
    joints: Iterable[UrdfJoint], drives: Iterable[DriveSection], further: float = 0.0
) -> JointBounds:
    """Return the bounds of joints, `further` [rad] inside what they may be commanded to."""
    margins = {drive.joint: drive.position_margin + further for drive in drives}
    bounds = [(j.lower + margins[j.name], j.upper - margins[j.name]) for j in joints]
    return JointBounds(tuple(b[0] for b in bounds), tuple(b[1] for b in bounds))
