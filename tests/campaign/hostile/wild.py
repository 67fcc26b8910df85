"""Wild operators: careless but legal, with all that a cell has, from a cell and a seed.

Nothing here is forged, and nothing of the hardware fails. Sticks, targets, postures, routes and
masters are far beyond what the arm can do; gains stay inside their bounds; switches, frames,
speeds, payloads, views and obstacles change while it moves; it is held, resumed, disabled and
enabled at any time, and meets the walls and tables of its cell. It may be told of collisions and
limits, and stop for them: it has no reason for a fault.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from telerobot.config.load import Cell
from telerobot.config.schema.null_space import OBJECTIVES
from telerobot.config.schema.sources import SOURCES
from telerobot.protocols.messages.messages import Frame
from telerobot.tools.scripts.script import Script, Step
from telerobot.tools.soak import segments
from telerobot.tools.soak.segments import Draw, step

from .cells import with_gripper, with_moving

WILD_S = 12.0
"""Length of a run [s]."""
SEGMENT_S = (0.2, 1.6)
"""Operators change what they do after so long [s]."""
BESIDES = 2.0
"""Mean number of other things that happen meanwhile [1]."""
NEAR = 0.5
"""Obstacles are told of within this of a place that the tool may be at [m]."""

Happening = Callable[[Draw, Cell], dict[str, Any]]


def wild(cell: Cell, seed: int) -> Script:
    """Return the script of a seed; equal seeds give equal runs."""
    draw = np.random.default_rng([seed, *b"wild", *cell.config.name.encode()])
    known = (*segments.SEGMENTS, *segments.segments(cell), _creep, _creep)
    happenings = _happenings(cell)
    steps: list[Step] = []
    at_s = 0.1
    while at_s < WILD_S:
        until_s = at_s + float(draw.uniform(*SEGMENT_S))
        steps += known[int(draw.integers(len(known)))](draw, cell, at_s, until_s)
        for _ in range(int(draw.poisson(BESIDES))):
            what = happenings[int(draw.integers(len(happenings)))](draw, cell)
            steps.append(step(float(draw.uniform(at_s, until_s)), what))
        # Whatever has stopped the arm, its operator wants it to go on.
        for wish in ("resume", "enable"):
            steps.append(
                step(until_s - 0.05 * float(draw.random()), {"operator/mode": {"action": wish}})
            )
        at_s = until_s
    done = tuple(s for s in steps if s.at_s < WILD_S)
    return Script(description=f"wild seed {seed}", duration_s=WILD_S, step=done)


def equipped(cell: Cell, seed: int) -> Cell:
    """Return the cell, with a gripper or on moving ground every now and then."""
    draw = np.random.default_rng([seed, *b"equipped"])
    if draw.random() < 0.3:
        cell = with_gripper(draw, cell)
    if draw.random() < 0.2 and not cell.config.frames.moving:
        cell = with_moving(draw, cell)
    return replace(cell)


def _creep(draw: Draw, cell: Cell, at_s: float, end_s: float) -> list[Step]:
    """One slow way for long, whatever stands there."""
    twist = [*(0.15 * draw.normal(size=3)).tolist(), *(0.3 * draw.normal(size=3)).tolist()]
    return [step(at_s, {"cmd/joystick": {"twist": twist, "expressed_in": _frame(draw)}})]


def _happenings(cell: Cell) -> tuple[Happening, ...]:
    found: list[Happening] = [
        _mode, _mode, _speed, _gain, _gain, _switch, _switch, _frames, _frames, _force, _clutch,
        _objective, _path_control, _cancel, _stick_off, _protective_stop, _payload, _avoidance,
        _obstacle, _obstacle, _obstacle, _posture, _target,
    ]  # fmt: skip
    if cell.config.mechanism.gripper is not None:
        found.append(_gripper)
    if cell.config.cameras:
        found += [_store_view, _watch]
    if cell.config.frames.moving:
        found += [_ground, _ground]
    return tuple(found)


def _frame(draw: Draw) -> Frame:
    return segments.FRAMES[int(draw.integers(len(segments.FRAMES)))]


def _mode(draw: Draw, cell: Cell) -> dict[str, Any]:
    action = str(draw.choice(["hold", "resume", "enable", "enable", "disable"]))
    return {"operator/mode": {"action": action}}


def _speed(draw: Draw, cell: Cell) -> dict[str, Any]:
    return {"operator/speed": {"factor": float(draw.choice([0.01, 0.1, 0.5, 1.0, 1.0]))}}


def _gain(draw: Draw, cell: Cell) -> dict[str, Any]:
    """Up to three times the cell's own; what is beyond a bound is refused."""
    name = str(draw.choice(SOURCES))
    own = np.array(getattr(cell.config.sources, name).gain)
    return {"operator/gain": {"source": name, "gain": (own * draw.uniform(0.0, 3.0, 6)).tolist()}}


def _switch(draw: Draw, cell: Cell) -> dict[str, Any]:
    name = str(draw.choice(SOURCES))
    return {"operator/switch": {"source": name, "on": bool(draw.random() < 0.7)}}


def _frames(draw: Draw, cell: Cell) -> dict[str, Any]:
    frame = str(draw.choice(["mrf", "crf"]))
    reach = 0.3 if frame == "mrf" else 1.0
    found: dict[str, Any] = {
        "frame": frame,
        "xyz": draw.uniform(-reach, reach, 3).tolist(),
        "rpy": draw.uniform(-3.0, 3.0, 3).tolist(),
    }
    if draw.random() < 0.5:
        found["relative_to"] = _frame(draw)
    return {"operator/frame": found}


def _force(draw: Draw, cell: Cell) -> dict[str, Any]:
    wrench = [*draw.uniform(-40.0, 40.0, 3).tolist(), *draw.uniform(-4.0, 4.0, 3).tolist()]
    return {"cmd/force": {"wrench": wrench, "expressed_in": _frame(draw)}}


def _clutch(draw: Draw, cell: Cell) -> dict[str, Any]:
    scale = float(draw.uniform(0.0, 10.0))
    return {"operator/clutch": {"engaged": bool(draw.random() < 0.6), "translation": scale}}


def _objective(draw: Draw, cell: Cell) -> dict[str, Any]:
    name = str(draw.choice(OBJECTIVES))
    most = 1.0 if name == "least_energy" else 10.0
    found: dict[str, Any] = {"objective": name, "gain": most * float(draw.random())}
    if name == "posture":
        found["posture"] = str(draw.choice(sorted(cell.config.mechanism.postures)))
    return {"operator/redundancy": found}


def _path_control(draw: Draw, cell: Cell) -> dict[str, Any]:
    return {"operator/path": {"action": str(draw.choice(["pause", "resume", "abort"]))}}


def _cancel(draw: Draw, cell: Cell) -> dict[str, Any]:
    return {"cmd/cancel": {}}


def _stick_off(draw: Draw, cell: Cell) -> dict[str, Any]:
    return {"silence": ["cmd/joystick", "cmd/jog"]}


def _protective_stop(draw: Draw, cell: Cell) -> dict[str, Any]:
    return {f"operator/protective_{'stop' if draw.random() < 0.4 else 'clear'}": {}}


def _gripper(draw: Draw, cell: Cell) -> dict[str, Any]:
    return {"operator/gripper": {"closed": str(draw.choice(["close", "open"])) == "close"}}


def _payload(draw: Draw, cell: Cell) -> dict[str, Any]:
    """A declaration that may well be wrong."""
    mass = float(draw.uniform(0.0, 3.0))
    return {"operator/payload": {"mass": mass, "com": draw.uniform(-0.05, 0.05, 3).tolist()}}


def _avoidance(draw: Draw, cell: Cell) -> dict[str, Any]:
    return {"operator/avoidance": {"on": bool(draw.random() < 0.7)}}


def _obstacle(draw: Draw, cell: Cell) -> dict[str, Any]:
    """News of things that may be anywhere, on the arm itself too, and may be there or not."""
    told = [o for o in cell.config.obstacles if o.max_speed > 0.0]
    name = f"wild_{int(draw.integers(4))}"
    if told and draw.random() < 0.3:
        name = told[int(draw.integers(len(told)))].name
        return {"obstacle": {"name": name, "physical": False, "xyz": _place(draw)}}
    if draw.random() < 0.25:
        return {"obstacle": {"name": name, "physical": False, "remove": True}}
    shape = str(draw.choice(["sphere", "capsule", "box"]))
    xyz, size = _place(draw), float(draw.uniform(0.02, 0.2))
    found: dict[str, Any] = {"name": name, "shape": shape, "xyz": xyz, "physical": False}
    if shape == "box":
        found["half_size"], found["rpy"] = (size,) * 3, draw.uniform(-1.5, 1.5, 3).tolist()
    else:
        found["radius"] = size
    if shape == "capsule":
        found["to"] = (np.array(xyz) + draw.uniform(-0.4, 0.4, 3)).tolist()
    if draw.random() < 0.5:
        found["max_speed"] = float(draw.uniform(0.1, 1.0))
        found["velocity"] = draw.uniform(-0.3, 0.3, 3).tolist()
        found["stale"] = str(draw.choice(["keep", "grow", "stop"]))
    return {"obstacle": found}


def _place(draw: Draw) -> list[float]:
    x, y, z = (np.array([0.4, 0.0, 0.5]) + draw.uniform(-NEAR, NEAR, 3)).tolist()
    return [x, y, z]


def _posture(draw: Draw, cell: Cell) -> dict[str, Any]:
    joints = cell.robot.joints
    q = [float(draw.uniform(max(j.lower, -2.5), min(j.upper, 2.5))) for j in joints]
    return {"cmd/posture": {"q": tuple(q)}}


def _target(draw: Draw, cell: Cell) -> dict[str, Any]:
    pose = {"xyz": draw.uniform(-0.8, 0.8, 3).tolist(), "rpy": draw.uniform(-3, 3, 3).tolist()}
    return {"cmd/position": {**pose, "relative_to": _frame(draw), "expressed_in": _frame(draw)}}


def _store_view(draw: Draw, cell: Cell) -> dict[str, Any]:
    cameras = cell.config.cameras
    return {"operator/store_view": {"camera": cameras[int(draw.integers(len(cameras)))].name}}


def _watch(draw: Draw, cell: Cell) -> dict[str, Any]:
    return {"operator/switch": {"source": "vision", "on": True}}


def _ground(draw: Draw, cell: Cell) -> dict[str, Any]:
    found = segments.ground_disturbances(draw, cell)
    return found[int(draw.integers(len(found)))][0]
