"""Torques that hold the arm still, against those that its motors have."""

from collections.abc import Iterator

import numpy as np

from ...config.load import Cell
from ...config.schema.mechanism.mechanism import PayloadSection
from ...server.control.mechanism.dynamics import Dynamics
from ...server.control.mechanism.kinematics import Mechanism
from ...server.control.spatial import Pose
from .findings import Finding, graded

ROOM = 0.5
"""Part of a motor's torque that holding still may take before it is worth a word [1]."""


def holding(cell: Cell) -> Iterator[Finding]:
    """Judge each posture of the cell under the heaviest of its payloads, by the URDF's masses."""
    section = cell.config.mechanism
    mechanism = Mechanism.from_cell(cell)
    by_joint = {d.joint: d for d in section.drives}
    drives = [by_joint[j] for j in mechanism.joints]
    sensor = section.force_torque
    place = None if sensor is None else sensor.T_wrist_sensor
    T_wrist_sensor = None if place is None else Pose.from_xyz_rpy(place.xyz, place.rpy)
    dynamics = Dynamics(mechanism, np.array([d.rotor_inertia for d in drives]), T_wrist_sensor)
    payloads: dict[str, PayloadSection | None] = {"the URDF's tool": None}
    if sensor is not None:
        payloads |= {"its payload": sensor.payload} if sensor.payload.mass else {}
        payloads |= {f"payload {name}": p for name, p in section.payloads.items()}
    most = np.array([d.max_torque for d in drives])
    worst: dict[str, tuple[float, int, str]] = {}
    for load, payload in payloads.items():
        if payload is not None:
            dynamics.carry(payload.mass, np.array(payload.com))
        for name, posture in section.postures.items():
            share = np.abs(dynamics.bias(np.array(posture), np.zeros(mechanism.n))) / most
            j = int(np.argmax(share))
            worst[name] = max(worst.get(name, (0.0, 0, load)), (float(share[j]), j, load))
    for name, (taken, j, load) in worst.items():
        joint = mechanism.joints[j]
        yield Finding(
            f"holding {name}",
            graded(taken, ROOM, 1.0),
            f"{joint} takes {taken * most[j]:.3g} of {most[j]:g} N·m with {load}",
            {"share": taken, "joint": joint},
        )
