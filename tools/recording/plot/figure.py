"""Pictures of recorded runs: panels over time, stills, several runs side by side."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.axes3d import Axes3D
from numpy.typing import NDArray

from ....config.load import Cell, ConfigError, load_cell
from ....config.schema.surroundings import CameraSection, ObstacleSection
from ....drivers.device import DeviceError
from ....drivers.rig.physics.camera import RigCameras
from ....server.control.proximity.capsules import Capsules
from ....server.control.spatial import rotation_rpy
from ..run_file import RecordError, read_about, read_run

# --- Reads a recorded run as arrays over time -----------------------------------------------------
Array = NDArray[np.float64]


@dataclass
class RecordedRun:
    """Contents of a run's file."""

    path: Path
    cell: Cell
    states: list[dict[str, Any]] = field(default_factory=list)
    truths: list[dict[str, Any]] = field(default_factory=list)
    events: list[dict[str, Any]] = field(default_factory=list)
    scans: list[dict[str, Any]] = field(default_factory=list)
    """Points of a laser scanner, each with its `time_s`."""
    contours: list[dict[str, Any]] = field(default_factory=list)
    """Contours that the scans gave, likewise."""

    @cached_property
    def capsules(self) -> Capsules:
        """The arms' shape. Raises `ConfigError` for links without one."""
        return Capsules(self.cell)

    @cached_property
    def time(self) -> Array:
        """Time of the states (t,) [s]."""
        return self.of_states(lambda s: s["time_s"])

    @cached_property
    def true_time(self) -> Array:
        """Time of the truths (t,) [s]."""
        return np.array([truth["time_s"] for truth in self.truths])

    @cached_property
    def tool_paths(self) -> dict[str, Array]:
        """Where the MRF of each arm was (t, 3) [m], by the mechanism's name."""
        arms = [truth.get("arms") or {"": truth} for truth in self.truths]
        return {name: np.array([arm[name]["pose_mrf"][:3] for arm in arms]) for name in arms[0]}

    def of_states(self, value: Callable[[dict[str, Any]], Any]) -> Array:
        """Return a value of every state, as an array over time."""
        return np.array([value(state) for state in self.states], dtype=float)

    def of_truths(self, value: Callable[[dict[str, Any]], Any]) -> Array:
        """Return a value of every truth, as an array over time."""
        return np.array([value(truth) for truth in self.truths], dtype=float)

    def sight_distances(self) -> dict[str, dict[str, Array]]:
        """Return each camera's true distance from each link over time [m]."""
        cameras: dict[str, dict[str, Array]] = {}
        for camera, links in (self.truths[0].get("sight") or {}).items():
            rows = [truth["sight"][camera] for truth in self.truths]
            cameras[camera] = {link: np.array([row[link] for row in rows]) for link in links}
        return cameras

    def closest_sight(self) -> float:
        """Return when an arm came closest to a line of sight [s], or the middle of the run."""
        distances = [d for of in self.sight_distances().values() for d in of.values()]
        if not distances:
            return float(self.true_time[len(self.true_time) // 2])
        return float(self.true_time[int(np.argmin(np.min(distances, axis=0)))])

    def truth_at(self, time_s: float) -> dict[str, Any]:
        return self.truths[int(np.argmin(np.abs(self.true_time - time_s)))]

    def sight_lines(self, truth: dict[str, Any]) -> list[tuple[Array, Array]]:
        """Return from where to where standing cameras look for their standing tags, at a truth."""
        rig = self.cell.config.rig
        tags = {} if rig is None else {tag.tag: tag.name for tag in rig.tags}
        found = []
        for camera in self.cell.cameras:
            pose = (truth.get("tags") or {}).get(tags.get(camera.tag, ""))
            if camera.T_world_lens is not None and pose is not None:
                found.append((np.array(camera.T_world_lens.xyz), np.array(pose[:3])))
        return found

    def camera(self, name: str) -> CameraSection:
        """Return a camera of the cell. Raises `ConfigError`."""
        for camera in self.cell.cameras:
            if camera.name == name:
                return camera
        known = ", ".join(c.name for c in self.cell.cameras) or "none"
        raise ConfigError(f"{self.cell.path}: cameras: the cell has no camera '{name}'; {known}")


def load_recording(path: Path, cell: str | None = None) -> RecordedRun:
    """Read a run's file; `cell` names its cell where the file does not.

    Raises `RecordError` for a file that is no recorded run, `ConfigError` for a cell that is wrong.
    """
    name = cell or read_about(path).get("cell")
    if name is None:
        raise RecordError(f"{path}: does not say which cell was run: name it with --cell")
    run = RecordedRun(path, load_cell(Path(name) if name.endswith(".toml") else name))
    rows = {
        "state": run.states, "truth": run.truths, "event": run.events, "scan": run.scans,
        "contour": run.contours,
    }  # fmt: skip
    for message in read_run(path, tuple(rows)):
        rows[message.topic].append({"time_s": message.stamp_ns / 1e9} | message.json())
    if not run.states or not run.truths:
        raise RecordError(f"{path}: holds no simulated run: no states, or no truth")
    if len(run.truths[0]["q"]) != len(run.cell.joints):
        has, wants = len(run.truths[0]["q"]), len(run.cell.joints)
        raise RecordError(f"{path}: its arm has {has} joints, that of {run.cell.path} {wants}")
    return run


# --- A payload that several arms hold: its outline with grasp forces, and what presses it ---------
METRES_PER_N = 0.005  # length of an arrow [m/N]


def draw_payload(run: RecordedRun, truth: dict[str, Any], ax: Axes3D) -> None:
    """Draw the payload's edges, and an arrow for the force of each arm on it."""
    beam, rig = truth.get("beam"), run.cell.config.rig
    if beam is None or rig is None or rig.beam is None:
        return
    at, R = np.array(beam["pose"][:3]), rotation_rpy(*beam["pose"][3:])
    half = np.array(rig.beam.half_size)
    _box(ax, at, R, half, color="tab:blue", lw=1.0)
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


# --- Panels of a run over time, as in the papers --------------------------------------------------
NAMED_LINKS = 4  # number of closest links drawn in colour and named [1]


def distances(run: RecordedRun, ax: Axes) -> bool:
    """Distance of each link to each line of sight, and of the arm to what is fixed (fig. 10)."""
    every = [
        (values, f"{link}, {camera}" if len(run.cell.cameras) > 1 else link)
        for camera, links in run.sight_distances().items()
        for link, values in links.items()
    ]
    every.sort(key=lambda row: float(row[0].min()))
    for i, (values, name) in enumerate(every):
        if i < NAMED_LINKS:
            ax.plot(run.true_time, values, label=name)
        else:
            ax.plot(run.true_time, values, color="0.8", lw=0.8, zorder=0)
    clear = [truth["clearance_m"] for truth in run.truths]
    fixed = all(value is not None for value in clear)
    if fixed:
        ax.plot(run.true_time, clear, "k", label="arm, fixed things")
    between = [t["between_arms_m"] for t in run.truths if t.get("between_arms_m") is not None]
    several = len(between) == len(run.truths)
    if several:
        ax.plot(run.true_time, between, "tab:red", label="arm, arm")
    ax.axhline(0.0, color="0.6", lw=0.8)
    return _named(
        ax,
        "sight line to housing [m]" if every else "distance [m]",
        bool(every) or fixed or several,
    )


def potentials(run: RecordedRun, ax: Axes) -> bool:
    """The potential's parts, each from its least on."""
    felt = [state.get("potential") for state in run.states]
    names = next(([k for k in f if k != "slope"] for f in felt if f is not None), [])
    for name in names:
        values = np.array([np.nan if f is None else f.get(name, np.nan) for f in felt])
        ax.plot(run.time, values - np.nanmin(values), label=name.replace("_", " "))
    return _named(ax, "potential above its least [J]", bool(names))


def slope(run: RecordedRun, ax: Axes) -> bool:
    """Slope of the potential that is left in the self-motions."""
    felt = [state.get("potential") for state in run.states]
    values = np.array([np.nan if f is None else f["slope"] for f in felt])
    drawn = bool((values > 0.0).any())
    if drawn:
        ax.semilogy(run.time, values)
    return _named(ax, "slope |Pτ| [N·m]", drawn, legend=False)


def priority(run: RecordedRun, ax: Axes) -> bool:
    """α, the part of a hand's force that avoiding takes away; and how far each sphere is."""
    values = run.of_states(lambda s: _or_nan(s.get("priority")))
    drawn = bool(np.isfinite(values).any())
    if drawn:
        ax.plot(run.time, values, "k", label="priority α")
        away = [state.get("spheres") or {} for state in run.states]
        for name in sorted({name for spheres in away for name in spheres}):
            distance = [spheres.get(name, np.nan) for spheres in away]
            ax.plot(run.time, distance, lw=0.8, label=f"{name}: distance [m]")
        ax.set_ylim(-0.05, 1.05)
    return _named(ax, "priority of avoiding [1]", drawn)


def rates(run: RecordedRun, ax: Axes) -> bool:
    """Commanded joint rates."""
    values = run.of_states(lambda s: s["dq_command"])
    for i, joint in enumerate(run.cell.joints):
        ax.plot(run.time, values[:, i], label=joint)
    return _named(ax, "joint rates [rad/s]", True)


def self_motion(run: RecordedRun, ax: Axes) -> bool:
    """Joint rates asked of the null space."""
    values = run.of_states(lambda s: np.linalg.norm(s["self_motion"]))
    ax.plot(run.time, values, label="self-motion")
    ax.plot(run.time, run.of_states(lambda s: np.linalg.norm(s["dq_command"])), label="all joints")
    return _named(ax, "size of joint rates [rad/s]", bool(values.any()))


def arm_angle(run: RecordedRun, ax: Axes) -> bool:
    """Where each arm's elbow is on its circle about the line from shoulder to wrist."""
    for name, values in _of_tasks(run, "arm_angle"):
        ax.plot(run.time, np.degrees(values), label=name)
    return _named(ax, "arm angle φ [°]", bool(ax.lines), legend=len(ax.lines) > 1)


def view(run: RecordedRun, ax: Axes) -> bool:
    """How far corners are from where the stored picture has them, as the daemon told."""
    for name, values in _of_tasks(run, "view_error_px"):
        ax.plot(run.time, values, label=name)
    if ax.lines:
        ax.set_yscale("log")
    return _named(ax, "off the stored picture [px]", bool(ax.lines), legend=len(ax.lines) > 1)


def granted(run: RecordedRun, ax: Axes) -> bool:
    """Share of the asked motion that was granted."""
    ax.plot(run.time, run.of_states(lambda s: s["scale"]))
    ax.set_ylim(-0.05, 1.05)
    return _named(ax, "granted share of the motion", True, legend=False)


def off_path(run: RecordedRun, ax: Axes) -> bool:
    """Displacement of the tool from its path, and along each virtual link."""
    ways = [state.get("off_path") or (0.0, 0.0, 0.0) for state in run.states]
    values = np.linalg.norm(ways, axis=1)
    ax.plot(run.time, 1e3 * values, label="in all")
    offs = [state.get("link_offs") or () for state in run.states]
    for i in range(max(map(len, offs), default=0)):
        along = np.array([off[i] if i < len(off) else np.nan for off in offs])
        ax.plot(run.time, 1e3 * along, label=f"link {i + 1}", lw=1.0)
    return _named(ax, "off the path [mm]", bool(values.any()), legend=len(ax.lines) > 1)


def tool_path(run: RecordedRun, ax: Axes) -> bool:
    """The tool's true path, from above and from the side."""
    for name, at in run.tool_paths.items():
        whose = f"{name} " if len(run.tool_paths) > 1 else ""
        ax.plot(at[:, 0], at[:, 1], label=f"{whose}from above: y")
        ax.plot(at[:, 0], at[:, 2], label=f"{whose}from the side: z")
        ax.plot(at[0, 0], at[0, 1], "ko", ms=3)
        ax.plot(at[0, 0], at[0, 2], "ko", ms=3)
    ax.set_xlabel("x [m]")
    ax.set_ylabel("tool path [m]")
    ax.legend(fontsize="x-small")
    return True


PANELS: dict[str, Callable[[RecordedRun, Axes], bool]] = {
    panel.__name__: panel
    for panel in (
        distances, potentials, slope, priority, rates, self_motion, arm_angle, view, granted,
        off_path, tool_path, internal_force,
    )
}  # fmt: skip
"""Panels by name; each returns whether there was anything to draw."""


def _of_tasks(run: RecordedRun, figure: str) -> Iterator[tuple[str, Array]]:
    """Yield a figure of each task that tells it, tick by tick."""
    own = {run.cell.parts[0].task: run.states}
    for name in run.states[0].get("tasks") or {}:
        own[name] = [state["tasks"].get(name, {}) for state in run.states]
    for name, states in own.items():
        values = np.array([_or_nan(state.get(figure)) for state in states])
        if np.isfinite(values).any():
            yield name, values


def _or_nan(value: float | None) -> float:
    return np.nan if value is None else value


def _named(ax: Axes, what: str, drawn: bool, legend: bool = True) -> bool:
    ax.set_xlabel("time [s]")
    ax.set_ylabel(what)
    ax.margins(x=0.0)
    if drawn and legend:
        ax.legend(fontsize="x-small", ncols=2)
    return drawn


# --- Line drawings of the arm and its obstacles, at moments of a run ------------------------------
FROM = (22.0, -50.0)  # elevation and azimuth that the scene is looked at from [°]
POINTS_PER_M = 260.0  # line width of a link, by its diameter [pt/m]


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
        half = np.array(obstacle.half_size)
        _box(ax, at, rotation_rpy(*obstacle.rpy), half, color="tab:orange", lw=0.8)
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


def _box(ax: Axes3D, at: Array, R: Array, half: Array, **how: Any) -> None:
    """Draw the edges of a box of half sizes (3,) about a place (3,) [m], turned by R (3, 3)."""
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1)
    corners = at[:, None] + R @ (half[:, None] * corners)
    for i in range(8):
        for bit in (1, 2, 4):
            if not i & bit:
                _line(ax, corners[:, i], corners[:, i | bit], **how)


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


# --- Composes panels and stills: one run in full, or several side by side -------------------------
COLUMNS = 2
WIDTH_IN = 11.0
ROW_IN = 2.6
STILL_IN = 3.0


def drawn(run: RecordedRun, panels: Sequence[str], stills: int) -> Figure:
    """Return one run: its panels in two columns, then moments of it; empty panels are left out."""
    names = [name for name in panels if name in PANELS]
    shown = [name for name in names if PANELS[name](run, Figure().add_subplot())]
    rows = math.ceil(len(shown) / COLUMNS)
    still_rows = 1 if "stills" in panels else 0
    height = max(ROW_IN, rows * ROW_IN + still_rows * STILL_IN)
    figure = Figure(figsize=(WIDTH_IN, height), layout="constrained")
    figure.suptitle(f"{run.cell.config.name}: {run.path.name}", fontsize="medium")
    heights = [ROW_IN] * rows + [STILL_IN] * still_rows
    grid = figure.add_gridspec(max(1, len(heights)), 1, height_ratios=heights or None)
    for row in range(rows):
        inner = grid[row].subgridspec(1, COLUMNS)
        for column, name in enumerate(shown[COLUMNS * row : COLUMNS * (row + 1)]):
            PANELS[name](run, figure.add_subplot(inner[column]))
    if still_rows:
        inner = grid[rows].subgridspec(1, stills)
        for i, time_s in enumerate(np.linspace(run.true_time[0], run.true_time[-1], stills)):
            truth = run.truth_at(float(time_s))
            ax = figure.add_subplot(inner[i], projection="3d")
            draw(run, truth, ax)
            ax.set_title(f"{truth['time_s']:.1f} s", fontsize="small")
    return figure


def compared(runs: Sequence[RecordedRun], at_s: float | None, camera: str | None) -> Figure:
    """Return runs side by side: the scene at one moment, as the camera saw it, the distances."""
    moment = runs[0].closest_sight() if at_s is None else at_s
    cameras = runs[0].cell.cameras
    name = camera or (cameras[0].name if cameras else None)
    if camera is not None:
        runs[0].camera(camera)
    rows = [3.6, 2.7, 2.3] if name else [3.6, 2.3]
    figure = Figure(figsize=(4.2 * len(runs), sum(rows)), layout="constrained")
    grid = figure.add_gridspec(len(rows), len(runs), height_ratios=rows)
    shared = None
    for column, run in enumerate(runs):
        truth = run.truth_at(moment)
        ax = figure.add_subplot(grid[0, column], projection="3d")
        draw(run, truth, ax, width=1.6)
        ax.set_title(run.path.stem.replace("_", " "), fontsize="medium")
        if name:
            picture = figure.add_subplot(grid[1, column])
            picture.imshow(seen(run, name, moment))
            picture.set_title(f"what '{name}' sees at {truth['time_s']:.1f} s", fontsize="small")
            picture.set_axis_off()
        over_time = figure.add_subplot(grid[-1, column], sharey=shared)
        shared = shared or over_time
        (internal_force if run.truths[0].get("beam") else distances)(run, over_time)
        over_time.axvline(truth["time_s"], color="0.7", lw=0.8, zorder=0)
    return figure


def seen(
    run: RecordedRun, camera: str, time_s: float
) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
    """Return the picture (h, w, 3) that a camera of the virtual world had at a time.

    Raises `DeviceError` where pictures cannot be rendered.
    """
    if run.camera(camera).device is not None:
        raise DeviceError(f"camera {camera} is a real one: its pictures are not in the recording")
    truth = run.truth_at(time_s)
    cameras = RigCameras(run.cell)
    try:
        return np.array(
            cameras.picture(
                camera,
                truth["q"],
                truth["covered"],
                truth["tags"],
                truth.get("frames", {}).get("base"),
            ),
            dtype=np.uint8,
        )
    finally:
        cameras.close()
