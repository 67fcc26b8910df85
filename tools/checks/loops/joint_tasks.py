"""Check of tasks that several mechanisms hold: grasps, load, and force control at each grasp."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ....config.agree.agree import REQUIRED_POSTURES
from ....config.load import Cell, grasp_part
from ....config.schema.joint_task import JointTaskSection
from ....config.schema.section import PoseSection
from ....server.control.arm.arm import Arm
from ....server.control.grasps.load_shares import load_shares
from ....server.control.joint_task.joint_task import FIT_M, JointTask
from ....server.control.mechanism.kinematics import Mechanism
from ....server.control.rigid_body import rotate_twist, wrench_to
from ....server.control.spatial import GRAVITY, Array, Pose
from ..findings import Finding, Severity, graded
from ..holding import (
    ROOM,
    dynamics_of,
    most_torques,
    placed,
    reading_finding,
    sensor_up,
    weight_map,
)
from .stability import stability


def joint_tasks(cell: Cell) -> Iterator[Finding]:
    """Judge every joint task of a cell; none in a cell without any."""
    for section in cell.joint_tasks:
        yield _fit(cell, section)
        yield from _load(cell, section)
        for i, name in enumerate(section.by):
            for finding in stability(grasp_part(cell, section, i)):
                if finding.check.startswith("force"):
                    yield replace(finding, check=f"{section.name}.{name}.{finding.check}")


def _fit(cell: Cell, section: JointTaskSection) -> Finding:
    """Judge how far the grasps are from fitting each other at the posture `start`."""
    names = [part.config.mechanism.name for part in cell.parts]
    members = [names.index(name) for name in section.by]
    start = [np.array(cell.parts[i].config.mechanism.postures["start"]) for i in members]
    task = JointTask(section, [Arm.of(part) for part in cell.parts], members)
    off = task.grips.misfit(start)
    fits = Severity.OK if off <= FIT_M else Severity.ERROR if section.at_start else Severity.WARN
    return Finding(
        f"{section.name}.grasps",
        fits,
        f"{1e3 * off:.2g} mm from fitting each other at start, at most {1e3 * FIT_M:g} mm",
        {"misfit_m": off, "bound_m": FIT_M},
    )


def _load(cell: Cell, section: JointTaskSection) -> Iterator[Finding]:
    """Judge what each arm bears of the payload: its weight, its joints' torques, its sensor.

    At the postures that all arms have by one name, as the shares are there.
    """
    by = {part.config.mechanism.name: part for part in cell.parts}
    parts = [by[name] for name in section.by]
    tools, views = (
        _poses([part.config.mechanism.T_wrist_mrf for part in parts]),
        _poses(section.T_wrist_mrf),
    )
    grasps = [view.inverse() @ tool for view, tool in zip(views, tools, strict=True)]
    weights = np.array(section.shares or [(1.0,) * 6] * len(parts))
    weight = weight_map(section.payload)
    p = np.array([grasp.p for grasp in grasps])
    # Of a unit vertical along each axis of the MRF: (3, k, 6).
    shares = np.array([load_shares(p, weights, column) for column in weight.T])
    for i, part in enumerate(parts):
        name, mechanism = f"{section.name}.{section.by[i]}", part.config.mechanism
        postures = {key: np.array(mechanism.postures[key]) for key in REQUIRED_POSTURES}
        wrist = Mechanism.from_cell(part)
        ups = {key: (wrist.pose_wrist(q).R @ views[i].R)[2] for key, q in postures.items()}
        share = shares[:, i].T
        yield from _weight(name, mechanism.rated_payload, share, ups["start"])
        in_tool = np.array([rotate_twist(grasps[i].R.T, column) for column in share.T]).T
        yield _torque(name, part, postures, ups, in_tool)
        sensor = mechanism.force_torque
        if sensor is None:
            continue
        T_sensor_tool, R_mrf_sensor = (
            placed(sensor).inverse() @ tools[i],
            views[i].R.T @ (placed(sensor).R),
        )
        at_sensor = np.array([wrench_to(T_sensor_tool, column) for column in in_tool.T]).T
        held = at_sensor @ R_mrf_sensor + weight_map(sensor.payload)
        at = {key: sensor_up(part, q) for key, q in postures.items()}
        yield reading_finding(f"{name}.reading", sensor, held, at)


def _poses(sections: Sequence[PoseSection]) -> list[Pose]:
    return [Pose.from_xyz_rpy(T.xyz, T.rpy) for T in sections]


def _weight(name: str, rated: float | None, share: Array, up: Array) -> Iterator[Finding]:
    """Judge the mass that an arm bears against its rating; `share` (6, 3) is of the vertical."""
    if rated is None:
        return
    mass = float(up @ share[:3] @ up) / -float(GRAVITY[2])
    yield Finding(
        f"{name}.payload",
        Severity.OK if mass <= rated else Severity.ERROR,
        f"its share is {mass:.3g} kg, it is rated for {rated:g} kg",
        {"mass_kg": mass, "rated_kg": rated},
    )


def _torque(
    name: str, part: Cell, postures: dict[str, Array], ups: dict[str, Array], share: Array
) -> Finding:
    """Judge the torques that hold an arm with its `share` (6, 3), at and in its own MRF."""
    mechanism, dynamics, most = part.config.mechanism, dynamics_of(part), most_torques(part)
    if mechanism.force_torque is not None:
        payload = mechanism.force_torque.payload
        dynamics.carry(payload.mass, np.array(payload.com))
    model = Mechanism.from_cell(part)
    (tool,) = _poses([mechanism.T_wrist_mrf])
    worst, j, at = 0.0, 0, ""
    for key, q in postures.items():
        k = model.kinematics(q, tool)
        wrench = rotate_twist(k.T_world_mrf.R, share @ ups[key])
        used = np.abs(dynamics.bias(q, np.zeros(model.n)) + k.J.T @ wrench) / most
        if used.max() >= worst:
            worst, j, at = float(used.max()), int(used.argmax()), key
    return Finding(
        f"{name}.holding",
        graded(worst, ROOM, 1.0),
        f"with its share {model.joints[j]} takes {worst * most[j]:.3g} of {most[j]:g} N·m at {at}",
        {"share": worst, "joint": model.joints[j]},
    )
