"""Payload, bias and mounting of a force/torque sensor from readings at chosen attitudes."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...config.drives import joint_bounds
from ...config.errors import ConfigError
from ...config.load import Cell
from ..control.mechanism.model import Mechanism
from ..control.spatial import GRAVITY, Array, Pose, skew

# --- Attitudes for an identification: the wrist turns about a posture, the tool stays close by ----
WRIST_JOINTS = 3  # number of joints that turn, counted from the last [1]
CANDIDATES = 600
PATH_SAMPLES = 12
FROM_LIMIT = 0.05  # kept from the joint limits [rad]


@dataclass(frozen=True)
class AttitudeStop:
    """A posture (n,) [rad] on the way; only those that `measure` are averaged."""

    q: Array
    measure: bool


def attitudes(cell: Cell, posture: str, count: int, room: float) -> list[AttitudeStop]:
    """Return the way through `count` attitudes about a posture, the MRF never further than `room`.

    The directions of gravity are spread as far as that allows (D-optimal, greedily). Joints move
    straight between two stops. Raises `ConfigError` for a posture that the cell lacks or where the
    wrist has no room to turn.
    """
    mechanism = cell.config.mechanism
    if posture not in mechanism.postures:
        known = ", ".join(mechanism.postures)
        raise ConfigError(f"{cell.path}: mechanism.postures.{posture}: none of {known}")
    space = _Space(cell, np.array(mechanism.postures[posture]), room)
    candidates = list(space.candidates())
    if len(candidates) < count:
        raise ConfigError(
            f"{cell.path}: the wrist cannot turn within {room:g} m about posture {posture!r}: "
            "name another one, or more room"
        )
    up = np.array([space.up(q) for q in candidates])
    chosen = _spread(np.column_stack([up, np.ones(len(up))]), count)
    return list(space.way([candidates[i] for i in chosen]))


class _Space:
    """Room in which the tool may move."""

    def __init__(self, cell: Cell, home: Array, room: float) -> None:
        config = cell.config.mechanism
        self._mechanism = Mechanism.from_cell(cell)
        self._tool = Pose.from_xyz_rpy(config.T_wrist_mrf.xyz, config.T_wrist_mrf.rpy)
        self._home, self._room = home, room
        bounds = joint_bounds(cell.robot.joints, config.drives, FROM_LIMIT)
        self._lower, self._upper = np.array(bounds.lower), np.array(bounds.upper)
        self._centre = self._tip(home)

    def up(self, q: Array) -> Array:
        """Return the upward direction (3,) in the Wrist."""
        return np.asarray(self._mechanism.pose_wrist(q).R[2])

    def candidates(self) -> Iterator[Array]:
        """Yield postures (n,) that can be reached from home within the room."""
        draw = np.random.default_rng(1)
        turning = slice(max(0, len(self._home) - WRIST_JOINTS), None)
        low = np.maximum(self._lower, self._home - np.pi)[turning]
        high = np.minimum(self._upper, self._home + np.pi)[turning]
        for _ in range(CANDIDATES):
            q = self._home.copy()
            q[turning] = draw.uniform(low, high)
            if self.inside(self._home, q):
                yield q

    def inside(self, a: Array, b: Array) -> bool:
        """Return whether the tool stays within the room on the straight way from a to b (n,)."""
        shares = np.linspace(1.0, 0.0, PATH_SAMPLES)
        return all(
            float(np.linalg.norm(self._tip(a + s * (b - a)) - self._centre)) <= self._room
            for s in shares
        )

    def way(self, postures: list[Array]) -> Iterator[AttitudeStop]:
        """Yield the stops, always on to the nearest, by way of home where straight is too far."""
        at, left = self._home, list(postures)
        while left:
            nearest = min(range(len(left)), key=lambda i: float(np.abs(left[i] - at).max()))
            q = left.pop(nearest)
            if not self.inside(at, q):
                yield AttitudeStop(self._home, False)
            yield AttitudeStop(q, True)
            at = q
        yield AttitudeStop(self._home, False)

    def _tip(self, q: Array) -> Array:
        return (self._mechanism.pose_wrist(q) @ self._tool).p


def _spread(rows: Array, count: int) -> list[int]:
    """Return the indices of `count` rows (k, 4) whose information has the greatest determinant."""
    chosen: list[int] = []
    information = 1e-3 * np.eye(rows.shape[1])
    for _ in range(count):
        gain = np.einsum("ki,ij,kj->k", rows, np.linalg.inv(information), rows)
        gain[chosen] = -np.inf
        chosen.append(int(np.argmax(gain)))
        information = information + np.outer(rows[chosen[-1]], rows[chosen[-1]])
    return chosen


# --- Estimates payload, bias and mounting of a force/torque sensor from readings at rest ----------
#
# At rest a reading depends on the attitude alone, and linearly: with u = −R_world_wristᵀ g, the
# free-fall acceleration turned round, seen from the Wrist (3,),
#
#     force = A u + b,    moment = D u + d,    and without cross-talk    A = m R,    D = [c]× m R
#
# with the payload's mass m and centre c in the Sensor's axes and R = R_sensor_wrist. Least
# squares give A, b, D, d. A polar decomposition A = S (m R) with trace S = 3 then separates the
# rotation from a symmetric S: the cross-talk among forces. It is a definition as much as an
# estimate, for an antisymmetric cross-talk *is* a rotation. Of D (m R)⁻¹ the antisymmetric part
# is the centre of mass, the symmetric part K how forces leak into moments. Wrenches are those
# exerted by the arm.
WORST_CONDITION = 12.0  # attitudes whose directions of gravity are worse spread tell too little [1]
LEAST_WEIGHT = 2.0  # a payload that weighs less says nothing about the mounting [N]
NEEDED = 1.5
"""Cross-talk is worth correcting when the residual is so many times smaller with it [1]."""


class NotIdentified(Exception):
    """The readings do not tell what was asked: says why."""


@dataclass(frozen=True)
class Residual:
    """Residual of a model: root mean square over the attitudes."""

    force: float  # norm of the force [N]
    moment: float  # norm of the moment [N·m]


@dataclass(frozen=True)
class Estimate:
    """Estimate, in the terms of a cell file."""

    mass: float  # [kg]
    com: Array  # centre of mass in the Sensor frame (3,) [m]
    bias: Array  # the sensor's own reading without load (6,) [N, N·m], the load's sign
    R_wrist_sensor: Array  # mounting (3, 3)
    mounting_known: bool  # False where the payload is too light to show it: the cell's own is kept
    calibration: Array | None  # reading less bias to wrench (6, 6); None where it is not needed
    residual: Residual
    rigid_residual: Residual  # the same without a correction of cross-talk
    condition: float  # condition number of the least squares: 2 is as good as attitudes can be [1]
    attitudes: int

    def rpy(self) -> tuple[float, float, float]:
        """Return the mounting as fixed-axis roll, pitch, yaw [rad]."""
        return Pose(self.R_wrist_sensor, np.zeros(3)).to_xyz_rpy()[3:]


@dataclass
class AttitudeMean:
    """Means over one attitude."""

    q: Array  # measured joints (n,) [rad]
    wrench: Array  # the sensor's reading, exerted sign (6,) [N, N·m]


def judge(cell: Cell, samples: list[AttitudeMean]) -> Estimate:
    """Return what the samples tell. Raises `NotIdentified`."""
    sensor = cell.config.mechanism.force_torque
    if sensor is None:
        raise NotIdentified("the cell has no force/torque sensor")
    mechanism = Mechanism.from_cell(cell)
    nominal = Pose.from_xyz_rpy(sensor.T_wrist_sensor.xyz, sensor.T_wrist_sensor.rpy)
    attitudes = np.array([mechanism.pose_wrist(s.q).R for s in samples]).reshape(-1, 3, 3)
    readings = np.array([s.wrench for s in samples]).reshape(-1, 6)
    return estimate(attitudes, readings, nominal.R)


def estimate(R_world_wrist: Array, readings: Array, R_nominal: Array) -> Estimate:
    """Estimate from attitudes (k, 3, 3) and mean readings (k, 6) at rest, exerted sign.

    `R_nominal` (3, 3) is the mounting R_wrist_sensor that the cell assumes. Raises `NotIdentified`
    where the attitudes are too few or too alike, or the readings are no weight's.
    """
    up = -np.einsum("kji,j->ki", R_world_wrist, GRAVITY)
    regressor = np.column_stack([up / 9.81, np.ones(len(up))])
    condition = float(np.linalg.cond(regressor)) if len(up) >= 4 else np.inf
    if condition > WORST_CONDITION:
        raise NotIdentified(
            f"{len(up)} attitudes are too few or too alike: condition {condition:.1f}, at most "
            f"{WORST_CONDITION:g}"
        )
    found, *_ = np.linalg.lstsq(regressor, readings, rcond=None)
    A, D = found[:3, :3].T / 9.81, found[:3, 3:].T / 9.81
    U, sizes, Vt = np.linalg.svd(A)
    mass, R_sensor_wrist = float(sizes.mean()), U @ Vt
    known = bool(9.81 * sizes.min() > LEAST_WEIGHT)
    if not known:
        R_sensor_wrist = R_nominal.T
        mass = float(np.trace(R_sensor_wrist.T @ A) / 3.0)
    elif np.linalg.det(R_sensor_wrist) < 0.0:
        raise NotIdentified("the readings are mirrored: the sign of a sensor axis is wrong")
    if mass * 9.81 < 0.1 * LEAST_WEIGHT:
        # Nothing hangs on it: bias alone.
        mass, com, K = max(mass, 0.0), np.zeros(3), np.zeros((3, 3))
    else:
        B = D @ R_sensor_wrist.T / mass
        com = 0.5 * np.array([B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1]])
        K = 0.5 * (B + B.T)
    force = mass * up @ R_sensor_wrist.T
    ideal = np.hstack([force, force @ skew(com).T])
    rigid_bias = (readings - ideal).mean(axis=0)
    rigid = _residual(readings - ideal - rigid_bias, 13)
    full = _residual(readings - regressor @ found, 24)
    gain = max(rigid.force / full.force, rigid.moment / full.moment)
    needed = known and gain > NEEDED
    calibration = None
    if needed:
        S_inverse = np.linalg.inv(U @ np.diag(sizes) @ U.T / mass)
        calibration = np.block([[S_inverse, np.zeros((3, 3))], [-K @ S_inverse, np.eye(3)]])
    return Estimate(
        mass=mass,
        com=com,
        bias=-(found[3] if needed else rigid_bias),
        R_wrist_sensor=R_sensor_wrist.T,
        mounting_known=known,
        calibration=calibration,
        residual=full if needed else rigid,
        rigid_residual=rigid,
        condition=condition,
        attitudes=len(up),
    )


def _residual(rest: Array, parameters: int) -> Residual:
    """Return the residual of (k, 6) numbers that a fit of so many parameters left."""
    freedom = max(rest.size - parameters, 1) / 6.0
    force, moment = (np.sqrt(float((part**2).sum()) / freedom) for part in np.hsplit(rest, 2))
    return Residual(max(force, 1e-12), max(moment, 1e-12))
