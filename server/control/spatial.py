"""Poses, rotations and twists, and how they change with frame.

A pose `T_a_b` maps coordinates in frame b to frame a. Twists are `[v; ω]`, wrenches `[f; m]`.
Rotations by logarithm (Williams 1997, section 2.3, with the geodesic in place of Euler rates).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .compiled import MATRIX, NUMBER, ROW, TABLE, VECTOR, compiled

Array = NDArray[np.float64]

GRAVITY = np.array([0.0, 0.0, -9.81])
"""Free-fall acceleration in World (3,) [m/s²]."""

_SMALL = 1e-7


class Pose(NamedTuple):
    """A rigid placement: rotation `R` (3, 3) and translation `p` (3,) [m]."""

    R: Array
    p: Array

    def __matmul__(self, other: "Pose") -> "Pose":
        """Compose: `T_a_b @ T_b_c` is `T_a_c`."""
        R, p = np.empty((3, 3)), np.empty(3)
        _compose(self.R, self.p, other.R, other.p, R, p)
        return Pose(R, p)

    def inverse(self) -> "Pose":
        """Return `T_b_a` of `T_a_b`."""
        return Pose(self.R.T, -(self.R.T.dot(self.p)))

    def to_xyz_rpy(self) -> tuple[float, float, float, float, float, float]:
        """Return x, y, z [m] and fixed-axis roll, pitch, yaw [rad]."""
        (a, b, _), (c, d, _), (e, f, g) = self.R.tolist()
        pitch = math.asin(min(1.0, max(-1.0, -e)))
        if abs(e) < 1.0 - 1e-12:
            roll, yaw = math.atan2(f, g), math.atan2(c, a)
        else:
            roll, yaw = 0.0, math.atan2(-b, d)
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


@compiled(VECTOR, VECTOR)
def cross(a: Array, b: Array) -> Array:
    """Return a × b (3,); several times quicker than numpy's for one pair."""
    out = np.empty(3)
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out


@compiled(VECTOR)
def sizes(twist: Array) -> tuple[float, float]:
    """Return the sizes of a twist's (6,) velocity [m/s] and angular velocity [rad/s]."""
    v2, w2 = 0.0, 0.0
    for i in range(3):
        v2 += twist[i] ** 2
        w2 += twist[3 + i] ** 2
    return math.sqrt(v2), math.sqrt(w2)


@compiled(MATRIX)
def rotation_log(R: Array) -> Array:
    """Return the rotation vector (3,) [rad] of R (3, 3), norm at most π."""
    axis = np.empty(3)
    axis[0], axis[1], axis[2] = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    sine = 0.5 * math.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    cosine = 0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    if angle < _SMALL:
        return 0.5 * axis
    if cosine > -0.99:
        return axis * (0.5 * angle / sine)
    # Near a half turn the skew part vanishes: take the axis from the symmetric part, which is
    # (1 − cos θ) a aᵀ + cos θ I, and its sign from what is left of the skew part.
    k = 0
    for i in range(1, 3):
        if R[i, i] > R[k, k]:
            k = i
    column, size, sign = np.empty(3), 0.0, 0.0
    for i in range(3):
        column[i] = 0.5 * (R[i, k] + R[k, i]) - (cosine if i == k else 0.0)
        size += column[i] ** 2
        sign += column[i] * axis[i]
    return column * (math.copysign(angle, sign) / math.sqrt(size))


@compiled(VECTOR)
def rotation_exp(r: Array) -> Array:
    """Return R (3, 3) of a rotation vector (3,) [rad] (Rodrigues)."""
    x, y, z = r[0], r[1], r[2]
    angle2 = x * x + y * y + z * z
    s, c = 1.0, 0.0
    if angle2 >= _SMALL**2:
        angle = math.sqrt(angle2)
        s, c = math.sin(angle) / angle, (1.0 - math.cos(angle)) / angle2
    R = np.empty((3, 3))
    R[0, 0], R[1, 1], R[2, 2] = (
        1.0 - c * (y * y + z * z),
        1.0 - c * (x * x + z * z),
        1.0 - c * (x * x + y * y),
    )
    R[0, 1], R[1, 0] = c * x * y - s * z, c * x * y + s * z
    R[0, 2], R[2, 0] = c * x * z + s * y, c * x * z - s * y
    R[1, 2], R[2, 1] = c * y * z - s * x, c * y * z + s * x
    return R


@compiled(VECTOR)
def right_jacobian(r: Array) -> Array:
    """Return Jr (3, 3) with body rate ω = Jr(r) dr/dt for R = exp(r)."""
    x, y, z = r[0], r[1], r[2]
    angle2 = x * x + y * y + z * z
    s, c = 0.5, 1.0 / 6.0
    if angle2 >= 1e-8:
        angle = math.sqrt(angle2)
        s, c = (1.0 - math.cos(angle)) / angle2, (angle - math.sin(angle)) / (angle2 * angle)
    Jr = np.empty((3, 3))
    Jr[0, 0], Jr[1, 1], Jr[2, 2] = (
        1.0 - c * (y * y + z * z),
        1.0 - c * (x * x + z * z),
        1.0 - c * (x * x + y * y),
    )
    Jr[0, 1], Jr[1, 0] = c * x * y + s * z, c * x * y - s * z
    Jr[0, 2], Jr[2, 0] = c * x * z - s * y, c * x * z + s * y
    Jr[1, 2], Jr[2, 1] = c * y * z + s * x, c * y * z - s * x
    return Jr


def turned(R_target: Array, r: Array, rates: Array) -> tuple[Array, Array]:
    """Return the attitude R (3, 3) at a rotation vector r (3,) from a target's, and the twist (6,).

    `rates` (6,) are velocity in World and the rate of r, which is in the target's axes.
    """
    R, twist = np.zeros((3, 3)), np.zeros(6)
    _turn(R_target, r, rates, R, twist)
    return R, twist


@compiled(MATRIX, VECTOR, VECTOR, TABLE, ROW)
def _turn(R_target: Array, r: Array, rates: Array, R: Array, twist: Array) -> None:
    Jr, turn = right_jacobian(r), rotation_exp(r)
    for i in range(3):
        twist[i] = rates[i]
        for j in range(3):
            for k in range(3):
                R[i, j] += R_target[i, k] * turn[k, j]
    for i in range(3):
        for j in range(3):
            for k in range(3):
                twist[3 + i] += R[i, j] * Jr[j, k] * rates[3 + k]


@compiled(VECTOR, VECTOR)
def vector_rate(r: Array, w: Array) -> Array:
    """Return the rate (3,) of a rotation vector r (3,), |r| < 2π, at a body rate w (3,) [rad/s].

    Jr(r)⁻¹ w in closed form: w + r × w / 2 + c r × (r × w).
    """
    angle2 = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    c = 1.0 / 12.0 + angle2 / 720.0
    if angle2 >= 1e-4:
        half = 0.5 * math.sqrt(angle2)
        c = (1.0 - half / math.tan(half)) / angle2
    once = cross(r, w)
    rate: Array = w + 0.5 * once + c * cross(r, once)
    return rate


@compiled(MATRIX, MATRIX, VECTOR)
def from_target(R_target: Array, R: Array, w: Array) -> tuple[Array, Array]:
    """Return an attitude R (3, 3) as a rotation vector (3,) in a target's axes, and its rate (3,).

    `w` (3,) is the angular velocity [rad/s]; it and both attitudes are in World.
    """
    between, body = np.zeros((3, 3)), np.zeros(3)
    for i in range(3):
        for j in range(3):
            body[i] += R[j, i] * w[j]
            for k in range(3):
                between[i, j] += R_target[k, i] * R[k, j]
    r = rotation_log(between)
    return r, vector_rate(r, body)


def pose_error(T_target: Pose, T: Pose) -> Array:
    """Return the twist (6,) in World axes that leads from T to T_target in one second.

    Translation difference and rotation logarithm, both poses in World.
    """
    out = np.empty(6)
    _way_to(T_target.R, T_target.p, T.R, T.p, out)
    return out


def moved(T: Pose, step: Array) -> Pose:
    """Return where a step (6,) [m, rad] in World axes leads T."""
    R, p = np.empty((3, 3)), np.empty(3)
    _move(T.R, T.p, step, R, p)
    return Pose(R, p)


def moved_near(T: Pose, step: Array, T_near: Pose, slack: tuple[float, float]) -> Pose:
    """Return where a step (6,) [m, rad] in World axes leads T, near another pose in World.

    It stays at most `slack` [m, rad] away from that.
    """
    R, p = np.empty((3, 3)), np.empty(3)
    _move_near(T.R, T.p, step, T_near.R, T_near.p, *slack, R, p)
    return Pose(R, p)


@compiled(MATRIX, VECTOR, MATRIX, VECTOR, TABLE, ROW)
def _compose(R_a_b: Array, p_a_b: Array, R_b_c: Array, p_b_c: Array, R: Array, p: Array) -> None:
    for i in range(3):
        x, y, z = R_a_b[i, 0], R_a_b[i, 1], R_a_b[i, 2]
        for j in range(3):
            R[i, j] = x * R_b_c[0, j] + y * R_b_c[1, j] + z * R_b_c[2, j]
        p[i] = x * p_b_c[0] + y * p_b_c[1] + z * p_b_c[2] + p_a_b[i]


@compiled(MATRIX, VECTOR, MATRIX, VECTOR, ROW)
def _way_to(R_target: Array, p_target: Array, R: Array, p: Array, out: Array) -> None:
    turn = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                turn[i, j] += R[k, i] * R_target[k, j]
    r = rotation_log(turn)
    for i in range(3):
        out[i] = p_target[i] - p[i]
        out[3 + i] = R[i, 0] * r[0] + R[i, 1] * r[1] + R[i, 2] * r[2]


@compiled(MATRIX, VECTOR, VECTOR, TABLE, ROW)
def _move(R: Array, p: Array, step: Array, R_moved: Array, p_moved: Array) -> None:
    turn = rotation_exp(step[3:])
    for i in range(3):
        p_moved[i] = p[i] + step[i]
        for j in range(3):
            R_moved[i, j] = turn[i, 0] * R[0, j] + turn[i, 1] * R[1, j] + turn[i, 2] * R[2, j]


@compiled(MATRIX, VECTOR, VECTOR, MATRIX, VECTOR, NUMBER, NUMBER, TABLE, ROW)
def _move_near(
    R: Array,
    p: Array,
    step: Array,
    R_near: Array,
    p_near: Array,
    slack_m: float,
    slack_rad: float,
    R_moved: Array,
    p_moved: Array,
) -> None:
    _move(R, p, step, R_moved, p_moved)
    away = np.empty(6)
    _way_to(R_moved, p_moved, R_near, p_near, away)
    distance, angle = sizes(away)
    if distance > slack_m or angle > slack_rad:
        for i in range(3):
            away[i] /= max(1.0, distance / slack_m)
            away[3 + i] /= max(1.0, angle / slack_rad)
        _move(R_near, p_near, away, R_moved, p_moved)
