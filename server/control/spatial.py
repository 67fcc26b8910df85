"""Poses, rotations, twists, wrenches and motions, and how they change with frame and point."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .compiled import MATRIX, NUMBER, ROW, TABLE, VECTOR, compiled

# --- Poses, rotations and twists, and how they change with frame ----------------------------------
#
# A pose `T_a_b` maps coordinates in frame b to frame a. Twists are `[v; ω]`, wrenches `[f; m]`.
# Rotations by logarithm (Williams 1997, section 2.3, with the geodesic in place of Euler
# rates).

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
        return Pose(self.R.T, -product(self.R.T, self.p))

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
        return Pose(_UNTURNED.copy(), np.zeros(3))


_UNTURNED = np.eye(3)


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


class Kinematics(NamedTuple):
    """Where the chain is at one posture; all in World."""

    T_world_wrist: Pose
    T_world_mrf: Pose
    J: Array
    """Jacobian (6, n) of the MRF: joint rates to `[v; ω]` at its origin, World axes, as seen from
    Base; of a Base that rolls, as seen from World."""


# --- Position, velocity and acceleration of several degrees of freedom ----------------------------


class Motion(NamedTuple):
    """Position, velocity and acceleration of n degrees of freedom."""

    q: Array
    dq: Array
    ddq: Array

    @staticmethod
    def at_rest(q: Array) -> "Motion":
        """Return rest at q (n,)."""
        return Motion(q.copy(), np.zeros_like(q), np.zeros_like(q))

    def of(self, part: slice | NDArray[np.int64]) -> "Motion":
        """Return that of some freedoms."""
        return Motion(self.q[part], self.dq[part], self.ddq[part])

    def stands(self, below: float = 0.0) -> bool:
        """Return whether no speed and no acceleration is as large as `below`, or any at all."""
        return _stands(self.dq, self.ddq, below)


@compiled(VECTOR, VECTOR, NUMBER)
def _stands(dq: Array, ddq: Array, below: float) -> bool:
    for i in range(len(dq)):
        for size in (abs(dq[i]), abs(ddq[i])):
            if not (size == 0.0 or size < below):  # nor what is not a number
                return False
    return True


Part = slice | NDArray[np.int64]
"""Some of the freedoms."""


def arriving(
    n: int, parts: Sequence[slice], groups: Sequence[NDArray[np.int64]]
) -> tuple[tuple[Part, bool], ...]:
    """Return which freedoms arrive together, and whether they always do; none for all of n.

    A group takes the place of its parts; of one inside of a part, all of that part do.
    """
    if len(parts) < 2:
        return ()
    places = [set(range(n)[part]) for part in parts]
    inside = [any(set(group.tolist()) < own for own in places) for group in groups]
    whole = {int(i) for group, part in zip(groups, inside, strict=True) if not part for i in group}
    some = {int(i) for group, part in zip(groups, inside, strict=True) if part for i in group}
    found: tuple[tuple[Part, bool], ...] = tuple(
        (group, True) for group, part in zip(groups, inside, strict=True) if not part
    )
    for part, own in zip(parts, places, strict=True):
        if not own & whole:
            found += ((part, bool(own & some)),)
    return found if len(found) > 1 else ()


# --- Twists and wrenches of one rigid body in other axes and at another of its points -------------
#
# Williams 1997, eqs. 1 and 5.


NO_TWIST: Final[Array] = np.zeros(6)
"""Twist of what asks for nothing (6,); one array, which a sum leaves out."""
NO_TWIST.flags.writeable = False


def differ(a: Pose, b: Pose) -> bool:
    """Return whether two poses are not the same to the last bit."""
    return a is not b and not (np.array_equal(a.p, b.p) and np.array_equal(a.R, b.R))


def rotate_twist(R: Array, twist: Array) -> Array:
    """Return the same twist (6,) (or wrench), same point, in the axes that R (3, 3) maps to."""
    out = np.empty(6)
    _rotate(R, twist, out)
    return out


@compiled(MATRIX, VECTOR, ROW)
def _rotate(R: Array, twist: Array, out: Array) -> None:
    for i in range(3):
        out[i] = R[i, 0] * twist[0] + R[i, 1] * twist[1] + R[i, 2] * twist[2]
        out[3 + i] = R[i, 0] * twist[3] + R[i, 1] * twist[4] + R[i, 2] * twist[5]


def twist_at(twist: Array, lever: Array) -> Array:
    """Return a body's twist (6,) at a point that is `lever` (3,) [m] away, in the same axes."""
    moved = np.empty(6)
    _at(twist, lever, moved)
    return moved


@compiled(VECTOR, VECTOR, ROW)
def _at(twist: Array, lever: Array, out: Array) -> None:
    out[0] = twist[0] + (twist[4] * lever[2] - twist[5] * lever[1])
    out[1] = twist[1] + (twist[5] * lever[0] - twist[3] * lever[2])
    out[2] = twist[2] + (twist[3] * lever[1] - twist[4] * lever[0])
    for i in range(3, 6):
        out[i] = twist[i]


def product(A: Array, x: Array) -> Array:
    """Return A x (m,) of a matrix A (m, n)."""
    out = np.empty(len(A))
    _multiply(A, x, out)
    return out


@compiled(MATRIX, VECTOR, ROW)
def _multiply(A: Array, x: Array, out: Array) -> None:
    for i in range(len(out)):
        total = 0.0
        for j in range(max(A.shape[1], len(x))):  # one that does not fit is an error, either way
            total += A[i, j] * x[j]
        out[i] = total


@compiled(VECTOR, VECTOR)
def dot(a: Array, b: Array) -> float:
    """Return a · b of two vectors (n,)."""
    total = 0.0
    for i in range(max(len(a), len(b))):
        total += a[i] * b[i]
    return total


@compiled(VECTOR)
def nonzero(vector: Array) -> bool:
    """Return whether any part of a vector (n,) is not zero: NaN is not, either."""
    count = 0
    for i in range(len(vector)):
        count += vector[i] != 0.0
    return count > 0


@compiled(VECTOR)
def largest(vector: Array) -> float:
    """Return the size of the largest part of a vector (n,): NaN where one is not a number."""
    found = 0.0
    for i in range(len(vector)):
        size = abs(vector[i])
        if not size <= found:
            found = size
            if size != size:
                break
    return found


@compiled(VECTOR, VECTOR)
def exceeds(vector: Array, bounds: Array) -> bool:
    """Return whether any part of a vector (n,) is larger than its bound, or not a number."""
    count = 0
    for i in range(len(vector)):
        count += not abs(vector[i]) <= bounds[i]
    return count > 0


def wrench_to(T_a_b: Pose, wrench_b: Array) -> Array:
    """Return a wrench (6,) given at b's origin in b's axes, at a's origin in a's axes.

    Williams 1997, eq. 5, with a the MRF and b the Sensor.
    """
    out = np.empty(6)
    _wrench_to(T_a_b.R, T_a_b.p, wrench_b, out)
    return out


def skew(a: Array) -> Array:
    """Return the matrix (3, 3) of `a ×`."""
    x, y, z = a.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def jacobian_at(J: Array, lever: Array) -> Array:
    """Return the Jacobian (6, n) of a point `lever` (3,) [m] away from the one whose this is."""
    moved = J.copy()
    moved[:3] -= skew(lever) @ J[3:]
    return moved


def motion_at(
    motion: Motion, lever: Array, most: tuple[float, float], acceleration: Array
) -> Motion:
    """Return a body's twist and how it changes, at a point that is `lever` (3,) [m] away.

    A far point of a body that turns is quick: the twist is slowed as a whole to `most` [m/s],
    [rad/s], and its change to `acceleration` (6,), unless they were beyond that before.
    """
    if not (motion.dq.any() or motion.ddq.any()):
        return motion
    bounds = np.maximum(acceleration, np.abs(motion.ddq))
    ddq = twist_at(motion.ddq, lever)
    ddq[:3] += cross(motion.dq[3:], cross(motion.dq[3:], lever))
    beyond = max(1.0, float((np.abs(ddq) / bounds).max()))
    return Motion(motion.q, slowed_at(motion.dq, lever, most), ddq / beyond)


def slowed_at(twist: Array, lever: Array, most: tuple[float, float]) -> Array:
    """Return a body's twist (6,) at a point that is `lever` (3,) [m] away, inside `most`.

    The whole of it is slowed to those bounds [m/s], [rad/s], unless it was beyond them before.
    """
    v, w = sizes(twist)
    return within(twist_at(twist, lever), (max(v, most[0]), max(w, most[1])))


def within(twist: Array, most: tuple[float, float]) -> Array:
    """Return a twist (6,), slowed as a whole to at most `most` [m/s], [rad/s]."""
    v, w = sizes(twist)
    share = min(1.0, most[0] / max(v, 1e-12), most[1] / max(w, 1e-12))
    return twist if share == 1.0 else share * twist


@compiled(MATRIX, VECTOR, VECTOR, ROW)
def _wrench_to(R: Array, p: Array, wrench: Array, out: Array) -> None:
    for i in range(3):
        out[i] = R[i, 0] * wrench[0] + R[i, 1] * wrench[1] + R[i, 2] * wrench[2]
        out[3 + i] = R[i, 0] * wrench[3] + R[i, 1] * wrench[4] + R[i, 2] * wrench[5]
    out[3] += p[1] * out[2] - p[2] * out[1]
    out[4] += p[2] * out[0] - p[0] * out[2]
    out[5] += p[0] * out[1] - p[1] * out[0]
