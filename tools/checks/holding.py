"""What holds an arm and its load still, against what its motors and its sensor are made for."""

from collections.abc import Iterator, Mapping

import numpy as np

from ...config.load import Cell
from ...config.schema.mechanism import ForceTorqueSection, PayloadSection
from ...protocols.canopen.robotous import AXES
from ...server.control.mechanism.model import Dynamics, Mechanism
from ...server.control.spatial import GRAVITY, Array, Pose, skew
from .findings import Finding, Severity, graded

ROOM = 0.5
"""Part of a motor's torque, or a sensor's range, that holding still may take before it is worth a
word [1]."""


def holding(cell: Cell) -> Iterator[Finding]:
    """Judge each posture of the cell under the heaviest of its payloads, by the URDF's masses.

    And what the sensor reads of each payload, there and at any other attitude.
    """
    section, dynamics = cell.config.mechanism, dynamics_of(cell)
    joints, sensor = Mechanism.from_cell(cell).joints, section.force_torque
    payloads: dict[str, PayloadSection | None] = {"the URDF's tool": None}
    if sensor is not None:
        payloads |= {"its payload": sensor.payload} if sensor.payload.mass else {}
        payloads |= {f"payload {name}": p for name, p in section.payloads.items()}
    most = most_torques(cell)
    worst: dict[str, tuple[float, int, str]] = {}
    for load, payload in payloads.items():
        if payload is not None:
            dynamics.carry(payload.mass, np.array(payload.com))
        for name, posture in section.postures.items():
            share = np.abs(dynamics.bias(np.array(posture), np.zeros(len(joints)))) / most
            j = int(np.argmax(share))
            worst[name] = max(worst.get(name, (0.0, 0, load)), (float(share[j]), j, load))
    for name, (taken, j, load) in worst.items():
        yield Finding(
            f"holding {name}",
            graded(taken, ROOM, 1.0),
            f"{joints[j]} takes {taken * most[j]:.3g} of {most[j]:g} N·m with {load}",
            {"share": taken, "joint": joints[j]},
        )
    if sensor is not None:
        at = {name: sensor_up(cell, np.array(q)) for name, q in section.postures.items()}
        found = [
            reading_finding(f"reading with {load}", sensor, weight_map(payload), at)
            for load, payload in payloads.items()
            if payload is not None
        ]
        # The heaviest reading stands for all that are well.
        found.sort(key=lambda f: float(f.values["share"] or 0.0), reverse=True)
        yield from (f for i, f in enumerate(found) if i == 0 or f.status is not Severity.OK)


def dynamics_of(cell: Cell) -> Dynamics:
    """Return the dynamics of one arm, with the links of the URDF for its tool."""
    mechanism, sensor = Mechanism.from_cell(cell), cell.config.mechanism.force_torque
    by_joint = {d.joint: d for d in cell.config.mechanism.drives}
    rotors = np.array([by_joint[joint].rotor_inertia for joint in mechanism.joints])
    return Dynamics(mechanism, rotors, None if sensor is None else placed(sensor))


def most_torques(cell: Cell) -> Array:
    """Return what each joint's motor has (n,) [N·m]."""
    by_joint = {d.joint: d for d in cell.config.mechanism.drives}
    return np.array([by_joint[j].max_torque for j in Mechanism.from_cell(cell).joints])


def placed(sensor: ForceTorqueSection) -> Pose:
    """Return where a sensor is in the Wrist."""
    return Pose.from_xyz_rpy(sensor.T_wrist_sensor.xyz, sensor.T_wrist_sensor.rpy)


def sensor_up(cell: Cell, q: Array) -> Array:
    """Return the vertical (3,) in the axes of the arm's sensor at q (n,)."""
    R_wrist_sensor = Pose.identity().R
    if cell.config.mechanism.force_torque is not None:
        R_wrist_sensor = placed(cell.config.mechanism.force_torque).R
    up: Array = (Mechanism.from_cell(cell).pose_wrist(q).R @ R_wrist_sensor)[2]
    return up


def weight_map(payload: PayloadSection) -> Array:
    """Return (6, 3): the wrench [N, N·m] that holds a payload, of the vertical in Sensor axes."""
    weight = -payload.mass * float(GRAVITY[2])
    return np.vstack([weight * np.eye(3), weight * skew(np.array(payload.com))])


def reading_finding(
    check: str, sensor: ForceTorqueSection, held: Array, at: Mapping[str, Array]
) -> Finding:
    """Judge what a sensor reads of a load against its measuring range.

    `held` (6, 3) is the wrench that holds it, of the vertical in Sensor axes, which `at` has by the
    names of postures.
    """
    reading_of = np.eye(6)
    if sensor.calibration is not None:
        reading_of = np.linalg.inv(np.array(sensor.calibration))
    bias, most = np.abs(sensor.bias), np.array(sensor.measuring_range)
    share, axis, where = 0.0, 0, ""
    for name, up in at.items():
        used = (np.abs(reading_of @ held @ up) + bias) / most
        if used.max() >= share:
            share, axis, where = float(used.max()), int(used.argmax()), f"at {name}"
    status = graded(share, ROOM, 1.0)
    turned = (np.linalg.norm(reading_of @ held, axis=1) + bias) / most
    if turned.max() > 1.0 and status is not Severity.ERROR:
        status, where = Severity.WARN, "at some attitude"
        share, axis = float(turned.max()), int(turned.argmax())
    unit = "N" if axis < 3 else "N·m"
    return Finding(
        check,
        status,
        f"{AXES[axis]} reads {share * most[axis]:.3g} of {most[axis]:.4g} {unit} {where}",
        {"share": share, "axis": AXES[axis], "range": float(most[axis])},
    )
