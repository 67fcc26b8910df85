"""Line drawings of the arm and its obstacles, at moments of a run."""

from typing import Any

import numpy as np
from mpl_toolkits.mplot3d.axes3d import Axes3D

from ....config.schema.surroundings import ObstacleSection
from ....server.control.spatial import rotation_rpy
from .grasps import draw_payload
from .reader import Array, RecordedRun

FROM = (22.0, -50.0)
"""Elevation and azimuth that the scene is looked at from [°]."""
POINTS_PER_M = 260.0
"""Line width of a link, by its diameter [pt/m]."""


def draw(run: RecordedRun, truth: dict[str, Any], ax: Axes3D, width: float = 1.0) -> None:
    """Draw the arm at a truth, its tool's path so far, and the obstacles of the cell."""
    ends = run.capsules.place(np.array([truth["q"]])).ends[0]
    for (a, b), radius in zip(ends, run.capsules.radius, strict=True):
        _line(ax, a, b, color="0.35", lw=width * POINTS_PER_M * 0.2 * radius, alpha=0.9)
    for name, obstacle in ((o.name, o) for o in run.cell.config.obstacles):
        if obstacle.shape != "sight_line":
            _obstacle(ax, obstacle, label=name)
    draw_payload(run, truth, ax)
    for start, end in run.sight_lines(truth):
        _line(ax, start, end, color="tab:red", lw=1.4)
        ax.scatter(*end, color="tab:red", s=16)
        ax.scatter(*start, color="tab:red", marker="s", s=16)
    upto = run.true_time <= truth["time_s"]
    for path in run.tool_paths.values():
        ax.plot(*path[upto].T, lw=1.0)
    _frame(ax, run)


def _obstacle(ax: Axes3D, obstacle: ObstacleSection, label: str) -> None:
    at = np.array(obstacle.xyz)
    if obstacle.shape == "box" and obstacle.half_size is not None:
        corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1)
        corners = at[:, None] + rotation_rpy(*obstacle.rpy) @ (
            np.array(obstacle.half_size)[:, None] * corners
        )
        for i in range(8):
            for bit in (1, 2, 4):
                if not i & bit:
                    _line(ax, corners[:, i], corners[:, i | bit], color="tab:orange", lw=0.8)
    elif obstacle.radius:
        u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 13), np.linspace(0, np.pi, 9))
        ball = np.array([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)])
        for centre in {obstacle.xyz or (0.0, 0.0, 0.0), obstacle.to or obstacle.xyz}:
            x, y, z = np.array(centre)[:, None, None] + obstacle.radius * ball
            ax.plot_wireframe(x, y, z, color="tab:orange", lw=0.4)
        if obstacle.to is not None:
            _line(ax, at, np.array(obstacle.to), color="tab:orange", lw=2.0)
    else:
        ax.scatter(*at, color="tab:orange", label=label)


def _line(ax: Axes3D, a: Array, b: Array, **how: Any) -> None:
    ax.plot(*np.stack([a, b], axis=1), solid_capstyle="round", **how)


def _frame(ax: Axes3D, run: RecordedRun) -> None:
    """Choose one cube for all moments of a run, so that they can be compared."""
    nodes = run.capsules.place(run.of_truths(lambda t: t["q"])[::20]).ends.reshape(-1, 3)
    lines = [np.array(line) for line in run.sight_lines(run.truths[0])]
    every = np.vstack([nodes, *lines])
    low, high = every.min(axis=0), every.max(axis=0)
    half = 0.5 * (high - low).max()
    for low_i, high_i, limit in zip(
        low, high, (ax.set_xlim, ax.set_ylim, ax.set_zlim), strict=True
    ):
        middle = 0.5 * (low_i + high_i)
        limit(middle - half, middle + half)
    ax.set_box_aspect((1, 1, 1), zoom=1.25)
    ax.view_init(*FROM)
    ax.tick_params(labelsize="xx-small", pad=-2)
