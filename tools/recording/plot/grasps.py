"""A payload that several arms hold: its outline with grasp forces, and what presses it."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from mpl_toolkits.mplot3d.axes3d import Axes3D

from ....server.control.spatial import rotation_rpy
from .reader import RecordedRun

METRES_PER_N = 0.005
"""Length of an arrow [m/N]."""


def draw_payload(run: RecordedRun, truth: dict[str, Any], ax: Axes3D) -> None:
    """Draw the payload's edges, and an arrow for the force of each arm on it."""
    beam, rig = truth.get("beam"), run.cell.config.rig
    if beam is None or rig is None or rig.beam is None:
        return
    at, R = np.array(beam["pose"][:3]), rotation_rpy(*beam["pose"][3:])
    half = np.array(rig.beam.half_size)
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1)
    corners = at[:, None] + R @ (half[:, None] * corners)
    for i in range(8):
        for bit in (1, 2, 4):
            if not i & bit:
                ax.plot(*corners[:, [i, i | bit]], color="tab:blue", lw=1.0)
    task = run.cell.joint_tasks[0]
    parts = {part.config.mechanism.name: part for part in run.cell.parts}
    for name, seen, wrench in zip(task.by, task.T_wrist_mrf, beam["grasps"], strict=True):
        tool = np.array(parts[name].config.mechanism.T_wrist_mrf.xyz)
        grasp = at + R @ rotation_rpy(*seen.rpy).T @ (tool - np.array(seen.xyz))
        force = METRES_PER_N * (R @ np.array(wrench[:3]))
        ax.quiver(*grasp, *force, color="tab:red", lw=1.6)


def internal_force(run: RecordedRun, ax: Axes) -> bool:
    """Internal force of a payload that several arms hold, and what it pushes on."""
    beams = [truth.get("beam") for truth in run.truths]
    held = [beam for beam in beams if beam is not None]
    drawn = bool(held) and len(held) == len(beams)
    if drawn:
        ax.plot(run.true_time, [beam["internal_force"] for beam in held], label="internal force")
        push = np.linalg.norm([beam["push"] for beam in held], axis=1)
        if push.any():
            ax.plot(run.true_time, push, "tab:red", lw=0.8, label="push on what it touches")
        ax.legend(fontsize="x-small")
    ax.set_xlabel("time [s]")
    ax.set_ylabel("force [N]")
    ax.margins(x=0.0)
    return drawn
