"""Parameters of the tick: a cell as arrays."""

from dataclasses import dataclass

import numpy as np

from ...config.drives import joint_bounds
from ...config.load import Cell
from ...config.schema.cell import CellConfig, LimitsSection, ResolveSection
from ...config.schema.mechanism import TorqueSection, TouchSection
from ...config.schema.null_space import PotentialFieldSection, RedundancySection
from ...config.schema.sources import ScheduleSection, SourcesSection
from ...config.schema.surroundings import AvoidanceSection
from .inputs import Payload
from .joints import Joints
from .mechanism.redundancy import Priority
from .proximity.capsules import Capsules
from .scene import Flags
from .spatial import Array, Pose
from .task.source import Shaping

HEADROOM = 0.1
"""Part of a joint's greatest speed that no command takes in CST: a hand may push beside it [1]."""


def _bounds(translation: float, rotation: float) -> Array:
    return np.array([translation] * 3 + [rotation] * 3)


def _shape_matters(c: CellConfig) -> bool:
    """Return whether anything in a cell may keep the arm's links away from something."""
    asked = c.redundancy.field > 0.0 or c.potential.virtual_link is not None
    return bool(c.obstacles) or c.avoidance.enabled or asked


@dataclass(frozen=True)
class Parameters:
    """Constants of one cell's control; joint arrays are (n,), Cartesian ones (6,)."""

    period_s: float
    joints: Joints
    limits: LimitsSection
    resolve: ResolveSection
    redundancy: RedundancySection
    pull_posture: Array
    """Posture (n,) that the posture objective pulls to [rad]."""
    schedules: tuple[ScheduleSection, ...]
    sources: SourcesSection
    shaping: Shaping
    """Bounds of the sources' rates."""
    T_wrist_tool: Pose
    """The MRF at start: singularities are judged there, whatever the MRF is later."""
    T_wrist_sensor: Pose | None
    payload: Payload
    """Payload on the sensor, unless an operator says otherwise."""
    rated_payload: float
    """No load is heavier [kg]; infinite where the cell says none."""
    wrench_calibration: Array
    """Reading without bias to wrench in the Sensor's axes (6, 6)."""
    wrench_inertia: bool
    wrench_smoothing: float
    """Share of the new sample in the filtered wrench, per tick [1]."""
    potential: PotentialFieldSection
    capsules: Capsules | None
    """The arm's shape; None where nothing asks for it."""
    priority: Priority | None
    """Virtual spheres; None where the cell has none."""
    operation_mode: str
    """Mode of the drives: "csp", "csv" or "cst"."""
    torque: TorqueSection
    rotor_inertia: Array
    """Inertia of the drives' rotors at the joints [kg·m²]."""
    friction: Array
    """Coulomb friction at the joints [N·m]."""
    max_torque: Array
    max_torque_rate: Array
    """Bound of what a torque changes by (n,) [N·m/s]; infinite where the cell says none."""
    avoidance: AvoidanceSection
    quick_stop_deceleration: Array
    """Ramps of the drives' quick stops (n,) [rad/s²]."""
    coasting_s: Array
    """A drive that hears no more setpoints goes on at its speed for so long (n,) [s]."""
    brake_closes_s: Array
    """Without power the joints' brakes hold after so long (n,) [s], by their torque."""
    brake_torque: Array
    """(n,) [N·m]."""
    retreat_leash: float | None
    """How far joints give way after a touch [rad]; None where nothing feels one."""
    gives_way: Flags
    """Joints that give way after a touch (n,): all but an axis that sweeps."""

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.joints.n

    @classmethod
    def from_cell(cls, cell: Cell) -> "Parameters":
        """Collect them from a loaded cell.

        Raises `ConfigError` for links whose shape is needed and not known, and for virtual spheres
        on none of the arm's links.
        """
        c: CellConfig = cell.config
        ordered = c.mechanism.drives
        kept = 1.0 - HEADROOM if c.mechanism.operation_mode == "cst" else 1.0
        bounds = joint_bounds(cell.robot.joints, ordered)
        sensor = c.mechanism.force_torque
        smoothing = 1.0
        if sensor is not None:
            smoothing = 1.0 - float(np.exp(-2 * np.pi * sensor.filter_hz * c.timing.period_s))
        mrf = c.mechanism.T_wrist_mrf
        return cls(
            period_s=c.timing.period_s,
            joints=Joints(
                names=cell.joints,
                lower=np.array(bounds.lower),
                upper=np.array(bounds.upper),
                velocity=kept * np.array([d.max_velocity for d in ordered]),
                acceleration=np.array([d.max_acceleration for d in ordered]),
                jerk=np.array([d.max_jerk for d in ordered]),
                leash=np.array([d.leash for d in ordered]),
                following_window=np.array([d.window for d in ordered]),
                rated_torque=np.array([d.rated_torque for d in ordered]),
            ),
            limits=c.limits,
            resolve=c.resolve,
            redundancy=c.redundancy,
            pull_posture=np.array(c.mechanism.postures[c.redundancy.posture_name]),
            schedules=c.schedules,
            sources=c.sources,
            shaping=Shaping(
                _bounds(c.limits.acceleration, c.limits.angular_acceleration),
                _bounds(c.limits.jerk, c.limits.angular_jerk),
                (c.limits.speed, c.limits.angular_speed),
                c.timing.period_s,
            ),
            T_wrist_tool=Pose.from_xyz_rpy(mrf.xyz, mrf.rpy),
            T_wrist_sensor=None
            if sensor is None
            else Pose.from_xyz_rpy(sensor.T_wrist_sensor.xyz, sensor.T_wrist_sensor.rpy),
            payload=Payload(0.0, np.zeros(3))
            if sensor is None
            else Payload(sensor.payload.mass, np.array(sensor.payload.com)),
            rated_payload=np.inf
            if c.mechanism.rated_payload is None
            else c.mechanism.rated_payload,
            wrench_calibration=np.eye(6)
            if sensor is None or sensor.calibration is None
            else np.array(sensor.calibration),
            wrench_inertia=sensor is not None and sensor.inertia,
            wrench_smoothing=smoothing,
            potential=c.potential,
            capsules=Capsules(cell) if _shape_matters(c) else None,
            priority=Priority.from_cell(cell),
            operation_mode=c.mechanism.operation_mode,
            torque=c.torque,
            rotor_inertia=np.array([d.rotor_inertia for d in ordered]),
            friction=np.array([d.friction for d in ordered]),
            max_torque=np.array([d.max_torque for d in ordered]),
            max_torque_rate=np.array([d.max_torque_rate or np.inf for d in ordered]),
            avoidance=c.avoidance,
            quick_stop_deceleration=np.array([d.quick_stop_deceleration for d in ordered]),
            coasting_s=np.array(
                [c.timing.period_s if d.coasting_s is None else d.coasting_s for d in ordered]
            ),
            brake_closes_s=np.array([d.brake_closes_s for d in ordered]),
            brake_torque=np.array([d.brake_torque or d.rated_torque for d in ordered]),
            retreat_leash=_retreat_leash(c),
            gives_way=np.array(
                [c.mechanism.sweep is None or d.joint != c.mechanism.sweep.joint for d in ordered]
            ),
        )


def _retreat_leash(c: CellConfig) -> float | None:
    """Return how far joints give way [rad]: without `[touch]` a sensor's tool is felt all the same.

    That is so while its load is not explained.
    """
    if c.touch is not None:
        return c.touch.leash
    return (
        None
        if c.mechanism.force_torque is None
        else float(TouchSection.model_fields["leash"].default)
    )
