"""What hostile operators do with a cell's equipment, and how grounds move."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ...config.load import Cell
from ...protocols.messages.messages import Frame
from ..scripts.script import Step

# --- Steps of a campaign's scripts, and the draw that decides them --------------------------------
Draw = np.random.Generator

Act = dict[str, Any]  # one topic with its fields, or one generator, as in a script's file


def step(at_s: float, act: Mapping[str, Any]) -> Step:
    """Return a step of a script, checked like one from a file."""
    return Step.model_validate({"at_s": at_s, **act})


# --- Moving grounds: an arm on a swaying platform, beside a conveyor, and the news of both --------
#
# In the end the platform is back in its place and the CRF in World, so that goals are judged as
# ever.
Pair = tuple[dict[str, Any], dict[str, Any]]
"""An act and its sequel a moment later; each may be empty."""

SWAY, TURN = 0.05, 0.05
"""Greatest amplitude of the platform's sway along and about each axis [m], [rad]."""
PERIODS_S = (2.0, 6.0)  # range of the sway's period [s]
SPEED = 0.2  # greatest speed of the conveyor along each axis [m/s]
DOUBLED = 3  # frequency of these disturbances, relative to each of the others [1]


def ground_disturbances(draw: Draw, cell: Cell) -> tuple[Pair, ...]:
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


def ground_order(cell: Cell) -> list[dict[str, Any]]:
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


# --- Equipment of an arm and its use: a gripper that picks things up, cameras ---------------------
Segment = Callable[[Draw, Cell, float, float], list[Step]]


def segments(cell: Cell) -> tuple[Segment, ...]:
    """Return what operators do with the equipment for a while."""
    return (_watch, _watch, _watch, _watch) if cell.config.cameras else ()


def opening(cell: Cell) -> list[Step]:
    """Return how a run begins: where there are cameras, with the tag in sight and the view kept."""
    if not cell.config.cameras:
        return []
    return [
        step(0.05, {"cmd/posture": {"posture": "ready"}}),
        *_keep_view(cell.config.cameras[0].name, 2.4),
    ]


OPENING_S = 2.6  # the opening of a cell with cameras takes this long [s]


def equipment_disturbances(draw: Draw, cell: Cell) -> tuple[Pair, ...]:
    """Return what happens to the equipment besides."""
    found: list[Pair] = []
    gripper = cell.config.mechanism.gripper
    if gripper is not None:
        wrong = {"mass": float(draw.uniform(0.0, 2.0)), "com": [0.0, 0.0, 0.05]}
        found += [
            ({"operator/gripper": {"closed": True}}, {"operator/gripper": {"closed": False}}),
            ({"operator/gripper": {"closed": True}}, {}),
            ({"operator/payload": wrong}, _payload(gripper.open_payload)),
            (_payload(gripper.closed_payload), {"operator/gripper": {"closed": True}}),
        ]
    tags = _tags(cell)
    if cell.config.cameras and tags:
        tag = tags[int(draw.integers(len(tags)))]
        gain = [g * float(draw.choice([0.0, 0.5, 1.5])) for g in cell.config.sources.vision.gain]
        found += [
            (
                {"rig/fault": {"kind": "cover", "target": tag}},
                {"rig/fault": {"kind": "cover", "target": tag, "on": False}},
            ),
            ({"rig/fault": {"kind": "cover", "target": tag}}, {}),
            ({"operator/gain": {"source": "vision", "gain": gain}}, {}),
            ({"operator/switch": {"source": "vision", "on": False}}, {}),
        ]
    return tuple(found)


def _payload(name: str | None) -> dict[str, Any]:
    """Return the switch to one of the cell's payloads; nothing for none."""
    return {"operator/payload": {"name": name}} if name else {}


def equipment_order(cell: Cell) -> list[dict[str, Any]]:
    """Return what brings order back, one step each."""
    found: list[dict[str, Any]] = []
    gripper = cell.config.mechanism.gripper
    if gripper is not None:
        found.append({"operator/gripper": {"closed": False}})
        if gripper.open_payload is not None:
            found.append(_payload(gripper.open_payload))
    if cell.config.cameras:
        found.append({"operator/switch": {"source": "vision", "on": False}})
        gain = cell.config.sources.vision.gain
        found.append({"operator/gain": {"source": "vision", "gain": gain}})
        found += [
            {"rig/fault": {"kind": "cover", "target": tag, "on": False}} for tag in _tags(cell)
        ]
    return found


def _watch(draw: Draw, cell: Cell, at_s: float, end_s: float) -> list[Step]:
    """Views stored and kept, of a tag that moves and is covered, while a stick pulls away."""
    camera = cell.config.cameras[int(draw.integers(len(cell.config.cameras)))].name
    steps = [
        step(at_s, {"silence": ["cmd/joystick"]}),
        step(at_s, {"cmd/cancel": {}}),
        *_keep_view(camera, at_s + 0.02),
    ]
    homes = _standing(cell)
    while at_s < end_s - 0.1:
        at_s += float(draw.uniform(0.1, 0.3))
        tag = str(draw.choice(_tags(cell)))
        twist = [*draw.normal(0.0, 0.3, 3).tolist(), *draw.normal(0.0, 0.6, 3).tolist()]
        things: list[dict[str, Any]] = [
            {"cmd/joystick": {"twist": twist, "expressed_in": Frame.MRF}},
            {"silence": ["cmd/joystick"]},
            {"rig/fault": {"kind": "cover", "target": tag}},
            {"rig/fault": {"kind": "cover", "target": tag, "on": False}},
            {"operator/store_view": {"camera": camera}},
            {"operator/switch": {"source": "vision", "on": bool(draw.random() < 0.7)}},
        ]
        for name, home in homes.items():
            place = (np.array(home) + draw.uniform(-0.05, 0.05, 3)).tolist()
            things.append({"rig/fault": {"kind": "move", "target": name, "vector": place}})
        steps.append(step(at_s, things[int(draw.integers(len(things)))]))
    return steps


def _keep_view(camera: str, at_s: float) -> list[Step]:
    return [
        step(at_s, {"operator/store_view": {"camera": camera}}),
        step(at_s + 0.05, {"operator/switch": {"source": "vision", "on": True}}),
    ]


def _tags(cell: Cell) -> list[str]:
    rig = cell.config.rig
    return [] if rig is None else [t.name for t in rig.tags]


def _standing(cell: Cell) -> dict[str, tuple[float, float, float]]:
    rig = cell.config.rig
    tags = () if rig is None else rig.tags
    return {t.name: t.T_world_tag.xyz for t in tags if t.T_world_tag is not None}
