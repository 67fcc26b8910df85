"""Check of tasks that several mechanisms hold: grasps, load, and force control at each grasp."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ....config.consistency import REQUIRED_POSTURES
from ....config.load import Cell, grasp_part
from ....config.schema.joint_task import JointTaskSection
from ....config.schema.section import PoseSection
from ....server.control.arm import Arm
from ....server.control.grasps.load_shares import load_shares
from ....server.control.grasps.views import mean_of
from ....server.control.joint_task.forces import Moving, weight_of
from ....server.control.joint_task.joint_task import FIT_M, JointTask
from ....server.control.mechanism.model import Mechanism
from ....server.control.spatial import GRAVITY, Array, Pose, rotate_twist, wrench_to
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

SLOW = 0.05
"""A payload that a fault's force leaves less than this part of the tool's speed is worth a word
[1]."""

DIRECTIONS = tuple(f"{sign}{axis}" for axis in "xyz" for sign in "+-")


def joint_tasks(cell: Cell) -> Iterator[Finding]:
    """Judge every joint task of a cell; none in a cell without any."""
    names = [part.config.mechanism.name for part in cell.parts]
    arms = [Arm.of(part) for part in cell.parts] if cell.joint_tasks else []
    for section in cell.joint_tasks:
        task = JointTask(section, arms, [names.index(name) for name in section.by])
        start = [np.array(cell.parts[i].config.mechanism.postures["start"]) for i in task.members]
        yield _fit(section, task, start)
        yield from _load(cell, section)
        yield _fault(cell, section, task, start)
        for i, name in enumerate(section.by):
            for finding in stability(grasp_part(cell, section, i)):
                if finding.check.startswith("force"):
                    yield replace(finding, check=f"{section.name}.{name}.{finding.check}")


def _fit(section: JointTaskSection, task: JointTask, start: list[Array]) -> Finding:
    """Judge how far the grasps are from fitting each other at the posture `start`."""
    off = task.grips.misfit(start)
    fits = Severity.OK if off <= FIT_M else Severity.ERROR if section.at_start else Severity.WARN
    return Finding(
        f"{section.name}.grasps",
        fits,
        f"{1e3 * off:.2g} mm from fitting each other at start, at most {1e3 * FIT_M:g} mm",
        {"misfit_m": off, "bound_m": FIT_M},
    )


def _fault(cell: Cell, section: JointTaskSection, task: JointTask, start: list[Array]) -> Finding:
    """Judge the force that a fault leaves at the posture `start`, and the speeds that it allows."""
    speed, bound = cell.config.limits.speed, section.most_internal_at_fault
    allowed, standing = {}, (0.0, "")
    for k, direction in enumerate(DIRECTIONS):
        twist = np.zeros(6)
        twist[k // 2] = speed if direction[0] == "+" else -speed
        moving, R_world_mrf = _moving(section, task, start, twist)
        allowed[direction] = speed * task.at_fault.slowed(moving, R_world_mrf).share
        standing = task.at_fault.standing(moving, R_world_mrf)
    slowest = min(allowed, key=lambda direction: allowed[direction])
    force, by = standing
    text = ", ".join(f"{direction} {v:.2g}" for direction, v in allowed.items())
    text = f"a fault at rest leaves {force:.2g} N ({by}), at most {bound:g} N; [m/s] {text}"
    slow = Severity.WARN if allowed[slowest] < SLOW * speed else Severity.OK
    return Finding(
        f"{section.name}.fault",
        Severity.ERROR if force > bound else slow,
        text,
        {"standing_n": force, "bound_n": bound, "slowest_m_s": allowed[slowest], "along": slowest},
    )


def _moving(
    section: JointTaskSection, task: JointTask, start: list[Array], twist: Array
) -> tuple[list[Moving], Array]:
    """Return arms at postures that move the payload by a twist (6,), and how it is turned."""
    views = [Pose.from_xyz_rpy(T.xyz, T.rpy) for T in section.T_wrist_mrf]
    tools = [arm.p.T_wrist_tool for arm in task.arms]
    wrists = [arm.mechanism.pose_wrist(q) for arm, q in zip(task.arms, start, strict=True)]
    R = mean_of([T @ view for T, view in zip(wrists, views, strict=True)]).R
    p = np.array([(view.inverse() @ tool).p for view, tool in zip(views, tools, strict=True)])
    payload = section.payload
    moment = payload.mass * np.array(payload.com)
    weight = weight_of(payload.mass, moment, Pose.identity(), R)
    shares = load_shares(p, np.array(section.shares or [(1.0,) * 6] * len(p)), weight)
    found = []
    for arm, q, view, at, share in zip(task.arms, start, views, p, shares, strict=True):
        J = arm.mechanism.kinematics(q, view).J
        dq: Array = np.linalg.pinv(J, rcond=1e-6) @ twist
        found.append(Moving(q, dq, J, R @ at, rotate_twist(R, share)))
    return found, R


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
