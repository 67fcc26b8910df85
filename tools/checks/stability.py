"""Do the gains stay stable against the stiffest environment, with the delay that the loop has?

A sampled integrator with `d` periods of delay is stable iff K T < 2 sin(π / (2(2d + 1))), where K
is K_F k_e for force control against a wall (Williams 1997, section 2.5, sampled) and K_P for the
position source.
"""

import math
from collections.abc import Iterator

import numpy as np

from ...config.load import Cell
from ...server.control.frames import Pose
from ..findings import Finding, Status, Value, graded
from .chain import mechanism_of

BUS_PERIODS = 2.0
"""From what a SYNC samples to what a later SYNC applies [periods]."""
DRIVE_PERIODS = 1.0
"""Interpolation (half a period) and servo lag: the upper end of what trials gave [periods]."""
CORRECTION = (5.0, 0.5)
"""Change of force [N] and of moment [N·m] whose correction must not come late."""
COMFORT = 0.5
"""Part of the bound above which contact overshoots noticeably [1]."""
AXES = ("x", "y", "z", "rx", "ry", "rz")
POSTURE = "ready"


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


def stability(cell: Cell) -> Iterator[Finding]:
    """Judge the force gains per axis, with the delay stated part by part, and K_P."""
    period = cell.config.timing.period_s
    position_bound = bound(BUS_PERIODS + DRIVE_PERIODS)
    worst = max(cell.config.sources.position.gain) * period
    yield Finding(
        "position gain",
        _grade(min(cell.config.sources.position.gain), worst, position_bound),
        f"K_P T = {worst:.3g}, stable below {position_bound:.3g} at d = "
        f"{BUS_PERIODS + DRIVE_PERIODS:g} periods",
        {"loop_gain": worst, "bound": position_bound},
    )
    sensor = cell.config.mechanism.force_torque
    if sensor is None:
        yield Finding("force gain", Status.OK, "no force/torque sensor, so no force loop")
        return
    stiffness = (sensor.stiffest_environment,) * 3 + (sensor.stiffest_environment_rotation,) * 3
    fixed: dict[str, float] = {
        "bus": BUS_PERIODS,
        "drive": DRIVE_PERIODS,
        "sensor": 0.5 / (sensor.rate_hz * period),
        "filter": filter_periods(sensor.filter_hz, period),
    }
    reach = _tool_bounds(cell)
    for i, (axis, gain, k_e) in enumerate(
        zip(AXES, cell.config.sources.force.gain, stiffness, strict=True)
    ):
        step = abs(gain) * CORRECTION[i // 3]
        tool_bounds = reach[i]
        if tool_bounds is None:
            yield Finding(f"force gain {axis}", Status.OK, "the arm cannot move along this axis")
            continue
        acceleration, jerk = tool_bounds
        delays = fixed | {"jerk limit": jerk_lag_s(step, acceleration, jerk) / period}
        d = sum(delays.values())
        loop_gain = gain * k_e * period
        values: dict[str, Value] = {"loop_gain": loop_gain, "bound": bound(d), "delay_periods": d}
        yield Finding(
            f"force gain {axis}",
            _grade(gain, loop_gain, bound(d)),
            f"K_F k_e T = {gain:g} · {k_e:g} · {period:g} = {loop_gain:.3g}, stable below "
            f"{bound(d):.3g} at d = {d:.2f} periods ("
            + ", ".join(f"{name} {delay:.2f}" for name, delay in delays.items())
            + ")",
            values | {f"delay_{n.replace(' ', '_')}": v for n, v in delays.items()},
        )


def _grade(gain: float, loop_gain: float, limit: float) -> Status:
    # A negative gain drives the arm away from its target or further into the wall.
    return Status.ERROR if gain < 0.0 else graded(loop_gain, COMFORT * limit, limit)


def _tool_bounds(cell: Cell) -> list[tuple[float, float] | None]:
    """Return the tool's acceleration and jerk bounds along each axis that the arm can move.

    Six of ([m/s²], [m/s³]) or ([rad/s²], [rad/s³]), in MRF axes at the posture `ready`, as far as
    the joints' own bounds allow; None for an axis that a short arm lacks.
    """
    mechanism = cell.config.mechanism
    tool = Pose.from_xyz_rpy(mechanism.T_wrist_mrf.xyz, mechanism.T_wrist_mrf.rpy)
    q = np.array(mechanism.postures[POSTURE])
    k = mechanism_of(cell).kinematics(q, tool)
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
