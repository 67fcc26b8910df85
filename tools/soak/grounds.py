"""Moving grounds: an arm on a swaying platform, beside a conveyor, and the news of both.

In the end the platform is back in its place and the CRF in World, so that goals are judged as ever.
The news is an encoder's: noise that is worse would show in goals, which are judged to a millimetre.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from ...config.load import Cell
from ...config.schema.section import PoseSection
from ...config.schema.surroundings import FramesSection, MovingFrameSection
from .steps import Draw

Pair = tuple[dict[str, Any], dict[str, Any]]
"""An act and its sequel a moment later; each may be empty."""

NOISE = (2e-5, 2e-5)
"""Standard deviation of each axis of a told pose [m], [rad]."""
SWAY, TURN = 0.05, 0.05
"""Greatest amplitude of the platform's sway along and about each axis [m], [rad]."""
PERIODS_S = (2.0, 6.0)
"""Range of the sway's period [s]."""
SPEED = 0.2
"""Greatest speed of the conveyor along each axis [m/s]."""
DOUBLED = 3
"""Frequency of these disturbances, relative to each of the others [1]."""


def with_moving(draw: Draw, cell: Cell) -> Cell:
    """Return the cell with a Base or a Carrier that may move, or both; as it is without a rig."""
    rig = cell.config.rig
    if rig is None:
        return cell
    which = int(draw.integers(3))
    x, y, z = draw.uniform(-0.5, 0.5, 3).tolist()
    frames = FramesSection(
        base=MovingFrameSection() if which != 1 else None,
        carrier=MovingFrameSection() if which != 0 else None,
        T_world_carrier=PoseSection(xyz=(x, y, z)),
    )
    told = rig.frames.model_copy(update={"noise": NOISE, "twists": bool(draw.random() < 0.5)})
    changed = {"frames": frames, "rig": rig.model_copy(update={"frames": told})}
    return replace(cell, config=cell.config.model_copy(update=changed))


def disturbances(draw: Draw, cell: Cell) -> tuple[Pair, ...]:
    """Return how the grounds move, and how news of them stops and comes back."""
    found: list[Pair] = []
    period_s = float(draw.uniform(*PERIODS_S))
    if cell.config.frames.base is not None:
        sway = np.repeat([SWAY, TURN], 3) * draw.uniform(-1.0, 1.0, 6)
        swaying = {"target": "platform", "sway": sway.tolist(), "period_s": period_s}
        found.append(({"rig/motion": swaying}, {}))
    if cell.config.frames.carrier is not None:
        twist = [*draw.uniform(-SPEED, SPEED, 3).tolist(), *draw.uniform(-0.2, 0.2, 3).tolist()]
        riding = {"operator/frame": {"frame": "crf", "moves_with": "carrier", "relative_to": "mrf"}}
        found += [
            ({"rig/motion": {"target": "carrier", "twist": twist}}, {}),
            (riding, {"rig/motion": {"target": "carrier", "twist": twist}}),
        ]
    for name in cell.config.frames.moving:
        silence = {"kind": "silence", "target": name}
        found.append(({"rig/fault": silence}, {"rig/fault": {**silence, "on": False}}))
    return tuple(found) * DOUBLED


def order(cell: Cell) -> list[dict[str, Any]]:
    """Return what brings order back, one step each."""
    frames, crf = cell.config.frames, cell.config.T_world_crf
    found: list[dict[str, Any]] = [
        {"rig/fault": {"kind": "silence", "target": name, "on": False}} for name in frames.moving
    ]
    if frames.base is not None:
        found.append({"rig/motion": {"target": "platform"}})
    if frames.carrier is not None:
        found.append({"rig/motion": {"target": "carrier"}})
    if found:
        at = {"xyz": crf.xyz, "rpy": crf.rpy, "relative_to": "world", "moves_with": "world"}
        found.append({"operator/frame": {"frame": "crf", **at}})
    return found
