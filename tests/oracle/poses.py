"""Poses as homogeneous matrices (4, 4), rotations by vector: the oracle's own mathematics."""

import math
import xml.etree.ElementTree as ET

import numpy as np
from numpy.typing import NDArray
from telerobot.config.schema.section import PoseSection

Array = NDArray[np.float64]


def rotation(vector: Array) -> Array:
    """Return the rotation (3, 3) about a vector (3,) by its length [rad] (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.eye(3)
    K = skew(vector / angle)
    return np.asarray(np.eye(3) + math.sin(angle) * K + (1.0 - math.cos(angle)) * (K @ K))


def skew(vector: Array) -> Array:
    """Return the matrix (3, 3) of `vector ×`."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_vector(R: Array) -> Array:
    """Return the vector (3,) [rad] of a rotation (3, 3), through its unit quaternion."""
    # The eigenvector of this matrix's greatest eigenvalue is the quaternion (Bar-Itzhack 2000).
    (a, b, c), (d, e, f), (g, h, i) = R.tolist()
    N = np.array(
        [
            [a - e - i, d + b, g + c, h - f],
            [d + b, e - a - i, h + f, c - g],
            [g + c, h + f, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    quaternion = np.linalg.eigh(N / 3.0)[1][:, -1]
    if quaternion[3] < 0.0:
        quaternion = -quaternion
    sine = float(np.linalg.norm(quaternion[:3]))
    angle = 2.0 * math.atan2(sine, float(quaternion[3]))
    return np.asarray(quaternion[:3] * (angle / sine if sine > 1e-12 else 2.0))


def difference(T_to: Array, T_from: Array) -> Array:
    """Return the twist (6,) in World axes that leads from one pose to another in one second."""
    turn = rotation_vector(T_to[:3, :3] @ T_from[:3, :3].T)
    return np.concatenate([T_to[:3, 3] - T_from[:3, 3], turn])


def matrix(pose: PoseSection) -> Array:
    """Return a pose of the cell file as a homogeneous matrix (4, 4)."""
    return matrix_of(np.array(pose.xyz), np.array(pose.rpy))


def matrix_of(xyz: Array, rpy: Array) -> Array:
    """Return the pose (4, 4) of a translation [m] and fixed-axis roll, pitch, yaw [rad]."""
    T = np.eye(4)
    x, y, z = np.eye(3)
    T[:3, :3] = rotation(z * rpy[2]) @ rotation(y * rpy[1]) @ rotation(x * rpy[0])
    T[:3, 3] = xyz
    return T


def origin_of(element: ET.Element) -> Array:
    """Return the pose (4, 4) that a URDF element's <origin> gives."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    return matrix_of(numbers(origin, "xyz"), numbers(origin, "rpy"))


def numbers(element: ET.Element, name: str) -> Array:
    """Return the numbers of an attribute, three zeros where it is missing."""
    return np.array([float(word) for word in element.get(name, "0 0 0").split()])
