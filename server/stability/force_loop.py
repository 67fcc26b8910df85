"""Stability bounds of the sampled force and position loops with the delay of a cell.

A sampled integrator with `d` periods of delay is stable iff K T < 2 sin(π / (2(2d + 1))), where K
is K_F k_e for force control against a wall (Williams 1997, section 2.5, sampled) and K_P for the
position source.
"""

import math
from dataclasses import dataclass

import numpy as np

from ...config.load import Cell
from ..control.mechanism.contact_wrench import INERTIA_PERIODS
from ..control.mechanism.kinematics import Mechanism
from ..control.spatial import Pose

BUS_PERIODS = 2.0
"""From what a SYNC samples to what a later SYNC applies [periods]."""
DRIVE_PERIODS = 1.0
"""Interpolation (half a period) and servo lag: the upper end of what trials gave [periods]."""
CORRECTION = (5.0, 0.5)
"""Change of force [N] and of moment [N·m] whose correction must not come late."""
POSTURE = "ready"
"""The posture at which the jerk limiter's lag is judged."""


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


def force_axis(cell: Cell, axis: int, gain: float) -> ForceAxis | None:
    """Return the force loop along an axis (0 to 5) at a gain K_F, None without a sensor.

    None also for an axis along which a short arm cannot move.
    """
    sensor = cell.config.mechanism.force_torque
    if sensor is None:
        return None
    reach = tool_bounds(cell)[axis]
    if reach is None:
        return None
    period = cell.config.timing.period_s
    linear = axis < 3
    step = abs(gain) * CORRECTION[0 if linear else 1]
    return ForceAxis(
        sensor.stiffest_environment if linear else sensor.stiffest_environment_rotation,
        {
            "bus": BUS_PERIODS,
            "drive": DRIVE_PERIODS,
            "sensor": 0.5 / (sensor.rate_hz * period),
            "inertia": INERTIA_PERIODS if sensor.inertia else 0.0,
            "filter": filter_periods(sensor.filter_hz, period),
            "jerk limit": jerk_lag_s(step, *reach) / period,
        },
    )


def tool_bounds(cell: Cell) -> list[tuple[float, float] | None]:
    """Return the tool's acceleration and jerk bounds along each axis that the arm can move.

    Six of ([m/s²], [m/s³]) or ([rad/s²], [rad/s³]), in MRF axes at the posture `ready`, as far as
    the joints' own bounds allow; None for an axis that a short arm lacks.
    """
    mechanism = cell.config.mechanism
    tool = Pose.from_xyz_rpy(mechanism.T_wrist_mrf.xyz, mechanism.T_wrist_mrf.rpy)
    k = Mechanism.from_cell(cell).kinematics(np.array(mechanism.postures[POSTURE]), tool)
    J = np.kron(np.eye(2), k.T_world_mrf.R.T) @ k.J
    if np.linalg.matrix_rank(J, tol=1e-6) == len(J):
        inverse = np.linalg.pinv(J)
    else:  # a short arm turns where it will while it moves, and the other way round
        inverse = np.hstack([np.linalg.pinv(J[:3], rcond=1e-6), np.linalg.pinv(J[3:], rcond=1e-6)])
    drives = {d.joint: d for d in mechanism.drives}
    ordered = [drives[j.name] for j in cell.robot.joints]
    accelerations = np.array([d.max_acceleration for d in ordered])
    jerks = np.array([d.max_jerk for d in ordered])
    found: list[tuple[float, float] | None] = []
    for i in range(6):
        rates = np.abs(inverse[:, i])
        if J[i] @ inverse[:, i] < 0.5:
            found.append(None)
            continue
        rates = np.maximum(rates, 1e-12)
        found.append((float((accelerations / rates).min()), float((jerks / rates).min())))
    return found


def vision_periods(cell: Cell) -> float:
    """Return the delay that the view's loop is judged with [periods].

    A picture's lateness is taken out by the pose that the arm had when it was exposed; what is
    left is the drives' delay, and an error of the stamp, of which a whole interval between two
    pictures of the slowest camera is allowed for.
    """
    slowest = min((c.rate_hz for c in cell.config.cameras), default=math.inf)
    stamp_s = 1.0 / slowest
    return BUS_PERIODS + DRIVE_PERIODS + stamp_s / cell.config.timing.period_s
