"""Stability bounds of the sampled force and position loops with the delay of a cell.

A sampled integrator with `d` periods of delay is stable iff K T < 2 sin(π / (2(2d + 1))), where K
is K_F k_e for force control against a wall (Williams 1997, section 2.5, sampled) and K_P for the
position source.

A contact that is not at the MRF turns the tool as well. With r from the MRF to the contact, a force
f there is the wrench [f; r × f] at the MRF, and the twist [v; ω] moves the contact by v + ω × r. So
the tool gives way there by X G Xᵀ, with X = [I −r̂; 0 I] and G the gains K_F: across r, by
K_F + K_R r². The loop gains are the eigenvalues of that times the stiffness of what is touched.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...config.load import Cell
from ..control.mechanism.contact_wrench import INERTIA_PERIODS
from ..control.mechanism.kinematics import Mechanism, at_mrf
from ..control.spatial import Array, Pose

GainVector = Sequence[float] | Array
"""One gain for each axis (6,)."""

BUS_PERIODS = 2.0
"""From what a SYNC samples to what a later SYNC applies [periods]."""
DRIVE_PERIODS = 1.0
"""Interpolation (half a period) and servo lag: the upper end of what trials gave [periods]."""
CORRECTION = (5.0, 0.5)
"""Change of force [N] and of moment [N·m] whose correction must not come late."""
POSTURE = "ready"
"""The posture at which the jerk limiter's lag is judged."""
_HALVINGS = 10
"""Bisections of the greatest distance between MRF and tool [1]."""


@dataclass(frozen=True)
class ForceAxis:
    """The force loop along one axis of the MRF."""

    stiffness: float
    """Stiffest environment [N/m] or [N·m/rad]."""
    delays: dict[str, float]
    """Delay of each part of the loop [periods]."""

    @property
    def delay_periods(self) -> float:
        """Delay of the whole loop [periods]."""
        return sum(self.delays.values())

    @property
    def bound(self) -> float:
        """Greatest stable K_F k_e T [1]."""
        return bound(self.delay_periods)


def bound(delay_periods: float) -> float:
    """Return the greatest stable K T of a sampled integrator behind a delay [1]."""
    return 2.0 * math.sin(math.pi / (2.0 * (2.0 * delay_periods + 1.0)))


def filter_periods(cutoff_hz: float, period_s: float) -> float:
    """Return the delay of the tick's first-order low-pass for slow signals [periods]."""
    return 1.0 / math.expm1(2.0 * math.pi * cutoff_hz * period_s)


def jerk_lag_s(step: float, acceleration: float, jerk: float) -> float:
    """Return the mean lag of a rate step behind acceleration and jerk bounds, same units [s]."""
    if step * jerk <= acceleration**2:
        return math.sqrt(step / jerk)
    return 0.5 * (step / acceleration + acceleration / jerk)


@dataclass(frozen=True)
class ToolContact:
    """The force loop where a point of the tool touches: of its modes, the nearest to its bound."""

    lever: float
    """From the MRF to the point [m]."""
    loop_gain: float
    """K_F k_e T of the mode [1]."""
    bound: float
    """Greatest stable one with the mode's delay [1]."""

    @property
    def share(self) -> float:
        """Loop gain over its bound: unstable from 1 on [1]."""
        return self.loop_gain / self.bound


class ForceLoop:
    """The force loop of one arm with any MRF and gains."""

    def __init__(self, cell: Cell) -> None:
        """Build it; raises `ValueError` for a cell without a force/torque sensor."""
        mechanism, period = cell.config.mechanism, cell.config.timing.period_s
        sensor = mechanism.force_torque
        if sensor is None:
            raise ValueError(f"cell {cell.config.name}: no force/torque sensor, so no force loop")
        self.period_s = period
        self.tip = Pose.from_xyz_rpy(mechanism.T_wrist_mrf.xyz, mechanism.T_wrist_mrf.rpy)
        """The MRF of the cell: the point of the tool that touches."""
        place = sensor.T_wrist_sensor
        self.T_wrist_sensor = Pose.from_xyz_rpy(place.xyz, place.rpy)
        k, k_rotation = sensor.stiffest_environment, sensor.stiffest_environment_rotation
        self.stiffness = np.array([k] * 3 + [k_rotation] * 3)
        """Of the stiffest environment (6,) [N/m, N·m/rad]."""
        back = self.T_wrist_sensor.p - self.tip.p
        length = float(np.linalg.norm(back))
        touching = sensor.contact_length
        share = 1.0 if touching is None or length <= touching else touching / length
        # What touches the tool beside its tip is a point, about which it may turn.
        self._touching = (
            (self.tip.p, self.stiffness),
            (self.tip.p + share * back, np.array([k] * 3 + [0.0] * 3)),
        )
        """Ends of the part of the tool that may touch, in the Wrist, and the stiffness there."""
        self._parts = {
            "bus": BUS_PERIODS,
            "drive": DRIVE_PERIODS,
            "sensor": 0.5 / (sensor.rate_hz * period),
            "inertia": INERTIA_PERIODS if sensor.inertia else 0.0,
            "filter": filter_periods(sensor.filter_hz, period),
        }
        model = Mechanism.from_cell(cell)
        drives = {d.joint: d for d in mechanism.drives}
        ordered = [drives[j.name] for j in cell.robot.joints]
        self._accelerations = np.array([d.max_acceleration for d in ordered])
        self._jerks = np.array([d.max_jerk for d in ordered])
        self._wrist = model.wrist(np.array(mechanism.postures[POSTURE]))

    def axes(self, gains: GainVector, mrf: Pose | None = None) -> list[ForceAxis | None]:
        """Return the loop along each axis of an MRF at gains K_F (6,), by default the cell's MRF.

        None for an axis along which a short arm cannot move.
        """
        found: list[ForceAxis | None] = []
        for i, reach in enumerate(self._tool_bounds(self.tip if mrf is None else mrf)):
            if reach is None:
                found.append(None)
                continue
            step = abs(gains[i]) * CORRECTION[0 if i < 3 else 1]
            lag = jerk_lag_s(step, *reach) / self.period_s
            found.append(ForceAxis(float(self.stiffness[i]), {**self._parts, "jerk limit": lag}))
        return found

    def touching(self, gains: GainVector, mrf: Pose | None = None) -> ToolContact:
        """Return the loop at the point of the tool that is nearest to its bound, or beyond it.

        Loop gains are convex along a straight tool: one of the ends of what touches is the worst.
        """
        at = self.tip if mrf is None else mrf
        return self._worst(gains, at, self.axes(gains, at))

    def _worst(self, gains: GainVector, mrf: Pose, axes: list[ForceAxis | None]) -> ToolContact:
        return max((self._contact(*c, gains, mrf, axes) for c in self._touching), key=_share)

    def reach(self, gains: GainVector, mrf: Pose) -> float:
        """Return how far from the tool's tip the MRF may be, on the way to a pose [m].

        Judged by the delays there, which grow on the way; 0 where the gains are too high at the tip
        itself.
        """
        low, high, axes = 0.0, 1.0, self.axes(gains, mrf)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            there = Pose(mrf.R, self.tip.p + middle * (mrf.p - self.tip.p))
            stable = self._worst(gains, there, axes).share < 1.0
            low, high = (middle, high) if stable else (low, middle)
        return low * float(np.linalg.norm(mrf.p - self.tip.p))

    def gives(self, gains: GainVector, com: Array, mrf: Pose | None = None) -> float:
        """Return K_F where a payload's centre of mass com (3,) is, Sensor axes [m/s/N]."""
        at = self.tip if mrf is None else mrf
        point = self.T_wrist_sensor.R @ com + self.T_wrist_sensor.p
        X = _to_point(at.R.T @ (point - at.p))[:3]
        G = _able(self.axes(gains, at)) * np.array(gains)
        return float(np.linalg.eigvalsh(X @ (G[:, None] * X.T))[-1])

    def lever(self, mrf: Pose | None = None) -> float:
        """Return how far from an MRF, by default the cell's, the tool may be touched [m]."""
        at = self.tip.p if mrf is None else mrf.p
        return max(float(np.linalg.norm(point - at)) for point, _ in self._touching)

    def _contact(
        self,
        point: Array,
        stiffness: Array,
        gains: GainVector,
        mrf: Pose,
        axes: list[ForceAxis | None],
    ) -> ToolContact:
        """Return the loop of a contact at a point (3,) in the Wrist."""
        r = mrf.R.T @ (point - mrf.p)
        delays = np.array([0.0 if axis is None else axis.delay_periods for axis in axes])
        G, root = _able(axes) * np.array(gains), np.sqrt(stiffness)
        X = root[:, None] * _to_point(r)
        values, modes = np.linalg.eigh(X @ (G[:, None] * X.T))
        lever, found = float(np.linalg.norm(r)), []
        for value, mode in zip(values * self.period_s, modes.T, strict=True):
            # By how much each axis takes part in the mode.
            parts = np.abs(G) * (X.T @ mode) ** 2
            if parts.sum() > 0.0:
                late = float(parts @ delays / parts.sum())
                found.append(ToolContact(lever, float(value), bound(late)))
        return max(found, key=_share, default=ToolContact(lever, 0.0, 2.0))

    def _tool_bounds(self, mrf: Pose) -> list[tuple[float, float] | None]:
        """Return the tool's acceleration and jerk bounds along each axis that the arm can move.

        Six of ([m/s²], [m/s³]) or ([rad/s²], [rad/s³]), in MRF axes at the posture `ready`, as far
        as the joints' own bounds allow; None for an axis that a short arm lacks.
        """
        k = at_mrf(*self._wrist, mrf)
        J = np.kron(np.eye(2), k.T_world_mrf.R.T) @ k.J
        if np.linalg.matrix_rank(J, tol=1e-6) == len(J):
            inverse = np.linalg.pinv(J)
        else:  # a short arm turns where it will while it moves, and the other way round
            halves = np.linalg.pinv(J[:3], rcond=1e-6), np.linalg.pinv(J[3:], rcond=1e-6)
            inverse = np.hstack(halves)
        found: list[tuple[float, float] | None] = []
        for i in range(6):
            rates = np.abs(inverse[:, i])
            if J[i] @ inverse[:, i] < 0.5:
                found.append(None)
                continue
            rates = np.maximum(rates, 1e-12)
            a, j = self._accelerations / rates, self._jerks / rates
            found.append((float(a.min()), float(j.min())))
        return found


def _share(contact: ToolContact) -> float:
    return contact.share


def _able(axes: list[ForceAxis | None]) -> Array:
    """Return 1 for each axis (6,) that the arm can move along, 0 for the others."""
    return np.array([0.0 if axis is None else 1.0 for axis in axes])


def _to_point(r: Array) -> Array:
    """Return X (6, 6), which maps the twist of a frame to that of a point at r (3,) in it."""
    x, y, z = r
    X = np.eye(6)
    X[:3, 3:] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]
    return X


def vision_periods(cell: Cell) -> float:
    """Return the delay that the view's loop is judged with [periods].

    A picture's lateness is taken out by the pose that the arm had when it was exposed; what is
    left is the drives' delay, and an error of the stamp, of which a whole interval between two
    pictures of the slowest camera is allowed for.
    """
    slowest = min((c.rate_hz for c in cell.config.cameras), default=math.inf)
    stamp_s = 1.0 / slowest
    return BUS_PERIODS + DRIVE_PERIODS + stamp_s / cell.config.timing.period_s
