"""Reads a recorded run as arrays over time."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....config.load import Cell, ConfigError, load_cell
from ....config.schema.surroundings import CameraSection
from ....server.control.proximity.capsules import Capsules
from ..run_file import RecordError, read_about, read_run

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
    def joints(self) -> tuple[str, ...]:
        """Names of the joints."""
        return self.cell.joints

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
        """Return the truth nearest to a time."""
        return self.truths[int(np.argmin(np.abs(self.true_time - time_s)))]

    def sight_lines(self, truth: dict[str, Any]) -> list[tuple[Array, Array]]:
        """Return from where to where standing cameras look for their standing tags, at a truth."""
        rig = self.cell.config.rig
        tags = {} if rig is None else {tag.tag: tag.name for tag in rig.tags}
        found = []
        for camera in self.cell.config.cameras:
            pose = (truth.get("tags") or {}).get(tags.get(camera.tag, ""))
            if camera.T_world_lens is not None and pose is not None:
                found.append((np.array(camera.T_world_lens.xyz), np.array(pose[:3])))
        return found

    def camera(self, name: str) -> CameraSection:
        """Return a camera of the cell. Raises `ConfigError`."""
        for camera in self.cell.config.cameras:
            if camera.name == name:
                return camera
        known = ", ".join(c.name for c in self.cell.config.cameras) or "none"
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
    if len(run.truths[0]["q"]) != len(run.joints):
        has, wants = len(run.truths[0]["q"]), len(run.joints)
        raise RecordError(f"{path}: its arm has {has} joints, that of {run.cell.path} {wants}")
    return run
