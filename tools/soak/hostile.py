"""What hostile operators do to a cell, seed by seed, and how order is restored after them."""

from dataclasses import replace
from typing import Any

import numpy as np

from ...config.load import Cell
from ..scripts.script import Script
from ..scripts.step import Step
from . import equipment, grounds
from .equipment import OPENING_S, opening, segments
from .segments import SEGMENTS, disturbance
from .steps import Draw, step

RESTORE_S = 1.3
"""Restoring lease, mode, gains and frames takes this long [s]."""
SLOWED = 0.4
"""Part of the segments that begin with a reduced speed, until the next one that does [1]."""
HOSTILE_S = (7.0, 8.6)
"""Length of the hostile part [s]."""


def script(cell: Cell, seed: int) -> Script:
    """Return a seed's script: hostile operators, then order; equal seeds give equal scripts."""
    draw = np.random.default_rng([seed, *cell.config.name.encode()])
    end_s = float(draw.uniform(*HOSTILE_S)) + (OPENING_S if cell.config.cameras else 0.0)
    steps = hostile(draw, cell, end_s) + restored(cell, end_s)
    return Script(
        description=f"hostile operators, seed {seed}",
        duration_s=end_s + RESTORE_S,
        step=tuple(steps),
    )


def opened(cell: Cell) -> Cell:
    """Return the cell with nothing around the arm."""
    rig = cell.config.rig
    if rig is None:
        return cell
    bare = rig.model_copy(update={"wall": None, "boxes": ()})
    return replace(cell, config=cell.config.model_copy(update={"rig": bare}))


def hostile(draw: Draw, cell: Cell, end_s: float) -> list[Step]:
    """Return what hostile operators do to a cell until then [s]."""
    steps = opening(cell)
    at_s = OPENING_S if steps else 0.1
    known = (*SEGMENTS, *segments(cell))
    while at_s < end_s - 0.4:
        until_s = min(end_s, at_s + float(draw.uniform(0.5, 1.1)))
        if draw.random() < SLOWED:
            factor = float(draw.choice([0.1, 0.25, 0.5, 1.0]))
            steps.append(step(at_s, {"operator/speed": {"factor": factor}}))
        segment = known[int(draw.integers(len(known)))]
        steps += segment(draw, cell, at_s, until_s)
        if draw.random() < 0.35:
            steps += disturbance(draw, cell, float(draw.uniform(at_s, until_s)))
        at_s = until_s
    return [s for s in steps if s.at_s < end_s]


def restored(cell: Cell, at_s: float) -> list[Step]:
    """Return what brings order back, whatever state the hostile part has left behind."""
    sources, mrf = cell.config.sources, cell.config.mechanism.T_wrist_mrf
    whats: list[dict[str, Any]] = [
        {"operator/lease": {}},
        {"operator/protective_clear": {}},
        {"operator/speed": {"factor": 1.0}},
        {"operator/frame": {"frame": "mrf", "xyz": mrf.xyz, "rpy": mrf.rpy}},
    ]
    for name, gain in (
        ("joystick", sources.joystick.gain),
        ("position", sources.position.gain),
        ("force", sources.force.gain),
    ):
        whats.append({"operator/gain": {"source": name, "gain": gain}})
        whats.append({"operator/switch": {"source": name, "on": True}})
    for name, pull in cell.config.redundancy.gains.items():
        whats.append({"operator/redundancy": {"objective": name, "gain": pull}})
    whats += grounds.order(cell) + equipment.order(cell)
    whats.append({"operator/clutch": {"engaged": True, "translation": 1.0, "rotation": 1.0}})
    whats += [{"operator/mode": {"action": "enable"}}] * 3
    whats.append({"cmd/cancel": {}})
    times = np.linspace(at_s + 0.1, at_s + RESTORE_S - 0.1, len(whats)).tolist()
    return [
        step(at_s, {"link": {}}),
        step(at_s, {"rig/fault": {"kind": "silence", "target": "force_torque", "on": False}}),
        step(at_s + 0.02, {"silence": ["cmd/joystick", "cmd/jog", "cmd/master_pose"]}),
        *(step(when_s, what) for when_s, what in zip(times, whats, strict=True)),
    ]
