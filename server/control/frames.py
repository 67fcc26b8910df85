"""Poses, twists and wrenches, and how they change with frame and point.

A pose `T_a_b` maps coordinates in frame b to frame a. Twists are `[v; ω]`, wrenches `[f; m]`.
Rotations by logarithm (Williams 1997, section 2.3, with the geodesic in place of Euler rates).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_SMALL = 1e-7


class Pose(NamedTuple):
    """A rigid placement: rotation `R` (3, 3) and translation `p` (3,) [m]."""

    R: Array
    p: Array

    def __matmul__(self, other: "Pose") -> "Pose":
        """Compose: `T_a_b @ T_b_c` is `T_a_c`."""
        return Pose(self.R @ other.R, self.R @ other.p + self.p)

    def inverse(self) -> "Pose":
        """Return `T_b_a` of `T_a_b`."""
        return Pose(self.R.T, -(self.R.T @ self.p))

    def to_xyz_rpy(self) -> tuple[float, float, float, float, float, float]:
        """Return x, y, z [m] and fixed-axis roll, pitch, yaw [rad]."""
        R = self.R
        pitch = math.asin(min(1.0, max(-1.0, -float(R[2, 0]))))
        if abs(R[2, 0]) < 1.0 - 1e-12:
            roll = math.atan2(R[2, 1], R[2, 2])
            yaw = math.atan2(R[1, 0], R[0, 0])
        else:
            roll = 0.0
            yaw = math.atan2(-R[0, 1], R[1, 1])
        x, y, z = self.p.tolist()
        return (x, y, z, roll, pitch, yaw)

    @staticmethod
    def from_xyz_rpy(xyz: tuple[float, ...], rpy: tuple[float, ...]) -> "Pose":
        """Build from a translation [m] and fixed-axis roll, pitch, yaw [rad]."""
        return Pose(rotation_rpy(*rpy), np.array(xyz, dtype=float))

    @staticmethod
    def identity() -> "Pose":
        """Return the pose of a frame in itself."""
        return Pose(np.eye(3), np.zeros(3))


def rotation_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Return R (3, 3) of a roll, pitch, yaw about the fixed x, y, z axes [rad] (as in URDF)."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def skew(a: Array) -> Array:
    """Return the matrix (3, 3) of `a ×`."""
    x, y, z = a.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def cross(a: Array, b: Array) -> Array:
    """Return a × b (3,); several times quicker than numpy's for one pair."""
    ax, ay, az = a.tolist()
    bx, by, bz = b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def rotation_log(R: Array) -> Array:
    """Return the rotation vector (3,) [rad] of R (3, 3), norm at most π."""
    axis2 = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    sine = 0.5 * math.sqrt(float(axis2 @ axis2))
    cosine = 0.5 * (float(R[0, 0] + R[1, 1] + R[2, 2]) - 1.0)
    angle = math.atan2(sine, cosine)
    if angle < _SMALL:
        return 0.5 * axis2
    if cosine > -0.99:
        return axis2 * (0.5 * angle / sine)
    # Near a half turn the skew part vanishes: take the axis from the symmetric part, which is
    # (1 − cos θ) a aᵀ + cos θ I, and its sign from what is left of the skew part.
    S = 0.5 * (R + R.T) - cosine * np.eye(3)
    k = int(np.argmax(np.diag(S)))
    axis = S[:, k] / math.sqrt(float(S[:, k] @ S[:, k]))
    if float(axis @ axis2) < 0.0:
        axis = -axis
    return np.asarray(axis * angle)


def rotation_exp(r: Array) -> Array:
    """Return R (3, 3) of a rotation vector (3,) [rad] (Rodrigues)."""
    x, y, z = r.tolist()
    angle2 = x * x + y * y + z * z
    if angle2 < _SMALL**2:
        return np.array([[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]])
    angle = math.sqrt(angle2)
    s, c = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2
    xy, xz, yz = c * x * y, c * x * z, c * y * z
    return np.array(
        [
            [1.0 - c * (y * y + z * z), xy - s * z, xz + s * y],
            [xy + s * z, 1.0 - c * (x * x + z * z), yz - s * x],
            [xz - s * y, yz + s * x, 1.0 - c * (x * x + y * y)],
        ]
    )


def right_jacobian(r: Array) -> Array:
    """Return Jr (3, 3) with body rate ω = Jr(r) dr/dt for R = exp(r)."""
    x, y, z = r.tolist()
    angle2 = x * x + y * y + z * z
    if angle2 < 1e-8:
        s, c = 0.5, 1.0 / 6.0
    else:
        angle = math.sqrt(angle2)
        s, c = (1.0 - math.cos(angle)) / angle2, (angle - math.sin(angle)) / (angle2 * angle)
    xy, xz, yz = c * x * y, c * x * z, c * y * z
    return np.array(
        [
            [1.0 - c * (y * y + z * z), xy + s * z, xz - s * y],
            [xy - s * z, 1.0 - c * (x * x + z * z), yz + s * x],
            [xz + s * y, yz - s * x, 1.0 - c * (x * x + y * y)],
        ]
    )


def rotate_twist(R: Array, twist: Array) -> Array:
    """Return the same twist (6,) (or wrench), same point, in the axes that R (3, 3) maps to."""
    return np.asarray((twist.reshape(2, 3) @ R.T).ravel())


def twist_at_wrist(twist_mrf: Array, R_k_j: Array, R_k_wrist: Array, p_wrist_mrf: Array) -> Array:
    """Return the Wrist's twist in axes k for a twist of the MRF in axes j (Williams 1997, eq. 1).

    `p_wrist_mrf` (3,) is the MRF origin seen from Wrist, in Wrist axes [m].
    """
    v, w = R_k_j @ twist_mrf[:3], R_k_j @ twist_mrf[3:]
    return np.concatenate([v + cross(R_k_wrist @ p_wrist_mrf, w), w])


def wrench_to(T_a_b: Pose, wrench_b: Array) -> Array:
    """Return a wrench (6,) given at b's origin in b's axes, at a's origin in a's axes.

    Williams 1997, eq. 5, with a the MRF and b the Sensor.
    """
    out = rotate_twist(T_a_b.R, wrench_b)
    out[3:] += cross(T_a_b.p, out[:3])
    return out


def pose_error(T_target: Pose, T: Pose) -> Array:
    """Return the twist (6,) in World axes that leads from T to T_target in one second.

    Translation difference and rotation logarithm, both poses in World.
    """
    out = np.empty(6)
    out[:3] = T_target.p - T.p
    out[3:] = T.R @ rotation_log(T.R.T @ T_target.R)
    return out
