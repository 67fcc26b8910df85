"""Composes panels and stills: one run in full, or several side by side."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from ....drivers.device import DeviceError
from ....drivers.rig.physics.camera import RigCameras
from .grasps import internal_force
from .panels import PANELS, distances
from .reader import RecordedRun
from .stills import draw

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
    cameras = runs[0].cell.config.cameras
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
