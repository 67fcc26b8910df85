"""Poses as the page has them: `[x, y, z, qx, qy, qz, qw]`, translation and unit quaternion."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence

from .....config.schema.section import PoseSection

Seven = list[float]
"""x, y, z [m] and the unit quaternion qx, qy, qz, qw of one frame in another."""

IDENTITY: Seven = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]


def seven(xyz: Sequence[float], rpy: Sequence[float]) -> Seven:
    """Return the pose of a translation [m] and fixed-axis roll, pitch, yaw [rad]."""
    (a, b, c), (d, e, f) = zip(*((math.cos(x / 2), math.sin(x / 2)) for x in rpy), strict=True)
    return [
        *(float(x) for x in xyz),
        d * b * c - a * e * f,
        a * e * c + d * b * f,
        a * b * f - d * e * c,
        a * b * c + d * e * f,
    ]


def of_pose(pose: PoseSection) -> Seven:
    """Return a pose of the cell file."""
    return seven(pose.xyz, pose.rpy)


def of_origin(element: ET.Element) -> Seven:
    """Return what a URDF element's `<origin>` gives."""
    origin = element.find("origin")
    if origin is None:
        return list(IDENTITY)
    return seven(three(origin, "xyz"), three(origin, "rpy"))


def three(element: ET.Element, name: str, default: str = "0 0 0") -> list[float]:
    """Return the numbers of an attribute."""
    return [float(word) for word in element.get(name, default).split()]


def along(normal: Sequence[float]) -> list[float]:
    """Return the quaternion that takes z to a direction (3,)."""
    length = math.sqrt(sum(x * x for x in normal))
    x, y, z = (component / length for component in normal)
    if z < -1.0 + 1e-9:
        return [1.0, 0.0, 0.0, 0.0]
    w = math.sqrt(0.5 * (1.0 + z))
    return [-y / (2.0 * w), x / (2.0 * w), 0.0, w]
