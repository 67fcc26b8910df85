"""What hostile operators do to a cell and its equipment, and how order is restored."""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from ...config.load import Cell
from ...config.schema.null_space import OBJECTIVES
from ...protocols.messages.messages import Frame
from ..scripts.script import Script, Step

# --- Steps of hostile scripts, and the draw that decides them --------------------------------
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
    rig = cell.config.rig
    tags = () if rig is None else rig.tags
    homes = {t.name: t.T_world_tag.xyz for t in tags if t.T_world_tag is not None}
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


# --- Hostile acts of operators: each returns the steps of one segment of a script -----------------
#
# Directions are drawn so that sticks turn back on themselves within a second or so: asked rates
# are far beyond every bound, but the arm is not led far into itself or its surroundings.
FRAMES = tuple(Frame)
SPEEDS = (0.4, 2.5)  # range of asked tool speeds [m/s]
ANGULAR_SPEEDS = (1.0, 8.0)  # range of asked tool rates [rad/s]


def moments(draw: Draw, at_s: float, end_s: float, low_s: float, high_s: float) -> Iterator[float]:
    """Yield times of a segment [s]; the way to the next is drawn once all is done at one."""
    while at_s < end_s:
        yield at_s
        at_s += float(draw.uniform(low_s, high_s))


def constant(draw: Draw, cell: Cell, at_s: float, end_s: float) -> list[Step]:
    """One way, then back."""
    twist, middle = _twist(draw), 0.5 * (at_s + end_s)
    axes = _axes(draw)
    return [_stick(at_s, twist, axes), _stick(middle, [-x for x in twist], axes)]


def bang_bang(draw: Draw, cell: Cell, at_s: float, end_s: float) -> list[Step]:
    """Full speed to and fro."""
    twist, axes, steps = _twist(draw), _axes(draw), []
    for now_s in moments(draw, at_s, end_s, 0.1, 0.4):
        steps.append(_stick(now_s, twist, axes))
        twist = [-x for x in twist]
    return steps


def noise(draw: Draw, cell: Cell, at_s: float, end_s: float) -> list[Step]:
    """A new direction several times a second."""
    times = moments(draw, at_s, end_s, 0.03, 0.15)
    return [_stick(at_s, _twist(draw), _axes(draw)) for at_s in times]


def aimed(draw: Draw, cell: Cell, at_s: float, end_s: float) -> list[Step]:
    """Away from the base, towards full stretch, with a slow turn of the tool."""
    twist = [0.0, 0.0, float(draw.uniform(0.5, 1.5)), *draw.uniform(-0.5, 0.5, 3).tolist()]
    axes = {"expressed_in": Frame.MRF if draw.random() < 0.5 else Frame.BASE}
    return [
        _stick(at_s, twist, axes),
        _stick(at_s + 0.7 * (end_s - at_s), [-x for x in twist], axes),
    ]


def jog_to_limit(draw: Draw, cell: Cell, at_s: float, end_s: float) -> list[Step]:
    """Some joints, the last among them, full speed towards a limit; half of the time slowed."""
    drives = cell.config.mechanism.drives
    n = len(drives)
    rates = [0.0] * n
    for joint in (n - 1, int(draw.choice([n - 1, n - 2, n - 3, 0]))):
        rates[joint] = float(draw.choice([-1.0, 1.0])) * drives[joint].max_velocity
    factor = float(draw.choice([0.3, 1.0]))
    return [
        step(at_s, {"operator/speed": {"factor": factor}}),
        step(at_s, {"silence": ["cmd/joystick"]}),
        step(at_s, {"cmd/jog": {"rates": rates}}),
        step(end_s - 0.02, {"operator/speed": {"factor": 1.0}}),
        step(end_s - 0.02, {"silence": ["cmd/jog"]}),
    ]


def goals(draw: Draw, cell: Cell, at_s: float, end_s: float) -> list[Step]:
    """Target poses, each replaced on the way, with a stick in between."""
    steps = []
    for now_s in moments(draw, at_s, end_s, 0.3, 0.7):
        position = {
            "xyz": draw.uniform(-0.6, 0.6, 3).tolist(),
            "rpy": draw.uniform(-1.5, 1.5, 3).tolist(),
            "relative_to": Frame.MRF,
            "expressed_in": _frame(draw),
        }
        steps.append(step(now_s, {"cmd/position": position}))
        steps.append(_stick(now_s + 0.15, _twist(draw), _axes(draw)))
    steps.append(step(end_s - 0.01, {"cmd/cancel": {}}))
    return steps


def postures(draw: Draw, cell: Cell, at_s: float, end_s: float) -> list[Step]:
    """Joint postures, each replaced on the way."""
    known = cell.config.mechanism.postures
    steps = []
    for now_s in moments(draw, at_s, end_s, 0.3, 0.8):
        q = np.array(known[str(draw.choice(sorted(known)))])
        q = q + draw.uniform(-0.3, 0.3, len(q))
        steps.append(step(now_s, {"silence": ["cmd/joystick"]}))
        steps.append(step(now_s, {"cmd/posture": {"q": tuple(q.tolist())}}))
    return steps


def paths(draw: Draw, cell: Cell, at_s: float, end_s: float) -> list[Step]:
    """Routes and timed twists, paused, resumed, aborted and replaced, with a stick in between."""
    steps = [step(at_s, {"silence": ["cmd/joystick"]})]
    for now_s in moments(draw, at_s, end_s, 0.25, 0.7):
        count = int(draw.integers(1, 6))
        if draw.random() < 0.5:
            reach, turn = draw.uniform(-0.3, 0.3, (count, 3)), draw.uniform(-0.9, 0.9, (count, 3))
            path: dict[str, Any] = {
                "waypoints": np.hstack([reach, turn]).tolist(),
                "blend": float(draw.choice([0.0, 0.02, 0.2])),
                "relative_to": Frame.MRF,
            }
            if draw.random() < 0.5:
                path["speeds"] = draw.uniform(0.02, 3.0, count).tolist()
        else:
            path = {
                "twists": [[0.6 * x for x in _twist(draw)] for _ in range(count)],
                "durations_s": draw.uniform(0.03, 0.4, count).tolist(),
            }
        steps.append(step(now_s, {"cmd/path": {**path, "expressed_in": _frame(draw)}}))
        if draw.random() < 0.4:
            steps.append(_stick(now_s + 0.1, _twist(draw), _axes(draw)))
        action = str(draw.choice(["pause", "abort", "resume"]))
        steps.append(step(now_s + 0.15, {"operator/path": {"action": action}}))
        if action == "pause" and draw.random() < 0.7:
            steps.append(step(now_s + 0.35, {"operator/path": {"action": "resume"}}))
    steps.append(step(end_s - 0.01, {"cmd/cancel": {}}))
    return steps


def master(draw: Draw, cell: Cell, at_s: float, end_s: float) -> list[Step]:
    """A master's pose, clutched, scaled, silent and resumed while it moves, beside a stick."""
    steps = [
        step(at_s, {"operator/clutch": {"engaged": True}}),
        step(at_s, {"silence": ["cmd/joystick"]}),
    ]
    axes = _frame(draw)
    for now_s in moments(draw, at_s, end_s, 0.2, 0.5):
        twist = [float(draw.choice([0.5, 2.0])) * x for x in _twist(draw)]
        steps.append(step(now_s, {"master": {"twist": twist, "expressed_in": axes}}))
        changes: tuple[dict[str, Any], ...] = (
            {"operator/clutch": {"engaged": False}},
            {"operator/clutch": {"engaged": True}},
            {"operator/clutch": {"translation": float(draw.uniform(0, 5)), "rotation": 0.5}},
            {"operator/clutch": {"rotation": float(draw.uniform(0, 5))}},
            {"silence": ["cmd/master_pose"]},
            {"cmd/joystick": {"twist": _twist(draw), **_axes(draw)}},
        )
        steps.append(step(now_s + 0.1, changes[int(draw.integers(len(changes)))]))
        steps.append(step(now_s + 0.2, {"operator/clutch": {"engaged": True}}))
    steps.append(step(end_s - 0.02, {"cmd/cancel": {}}))
    steps.append(step(end_s - 0.02, {"silence": ["cmd/master_pose"]}))
    steps.append(step(end_s - 0.01, {"operator/clutch": {"translation": 1.0, "rotation": 1.0}}))
    return steps


SEGMENTS: tuple[Segment, ...] = (
    constant, bang_bang, bang_bang, noise, noise, aimed, jog_to_limit, goals, postures,
    paths, paths, master, master,
)  # fmt: skip


def disturbance(draw: Draw, cell: Cell, at_s: float) -> list[Step]:
    """Return something that happens besides: settings, stops, a bad line, bad bytes."""
    gains = {
        "joystick": cell.config.sources.joystick.gain,
        "position": cell.config.sources.position.gain,
        "force": cell.config.sources.force.gain,
    }
    source = str(draw.choice(sorted(gains)))
    later = at_s + float(draw.uniform(0.15, 0.4))
    choices: tuple[tuple[dict[str, Any], dict[str, Any]], ...] = (
        ({"operator/gain": {"source": source, "gain": _scaled(draw, gains[source])}}, {}),
        ({"operator/gain": {"source": "force", "gain": (50.0,) * 6}}, {}),
        (
            {"operator/switch": {"source": source, "on": False}},
            {"operator/switch": {"source": source, "on": True}},
        ),
        (
            {"operator/speed": {"factor": float(draw.uniform(0.1, 1.0))}},
            {"operator/speed": {"factor": 1.0}},
        ),
        ({"operator/mode": {"action": "hold"}}, {"operator/mode": {"action": "resume"}}),
        ({"operator/protective_stop": {}}, {"operator/protective_clear": {}}),
        ({"silence": ["cmd/joystick"]}, {}),
        ({"link": {"delay_s": float(draw.uniform(0.02, 0.3))}}, {"link": {}}),
        ({"link": {"cut": True}}, {"link": {}}),
        ({"raw": {"topic": "cmd/joystick", "hex": draw.bytes(24).hex()}}, {}),
        ({"cmd/jog": {"rates": [0.1]}}, {"silence": ["cmd/jog"]}),
        (
            {"cmd/force": {"wrench": draw.uniform(-10.0, 10.0, 6).tolist()}},
            {"cmd/force": {"wrench": [0.0] * 6}},
        ),
        ({"operator/redundancy": _objective(draw, cell)}, {}),
        (
            {"operator/redundancy": _objective(draw, cell)},
            {"operator/redundancy": _objective(draw, cell)},
        ),
        ({"operator/path": {"action": str(draw.choice(["pause", "resume", "abort"]))}}, {}),
        ({"operator/clutch": {"engaged": False}}, {"operator/clutch": {"engaged": True}}),
        ({"operator/frame": _redefined(draw, "crf")}, {}),
        ({"operator/frame": _redefined(draw, "mrf")}, {}),
        (
            {"rig/fault": {"kind": "silence", "target": "force_torque"}},
            {"rig/fault": {"kind": "silence", "target": "force_torque", "on": False}},
        ),
    )
    choices += equipment_disturbances(draw, cell) + ground_disturbances(draw, cell)
    first, second = choices[int(draw.integers(len(choices)))]
    steps = [step(at_s, first)]
    if second:
        steps.append(step(later, second))
    if second.keys() & {"operator/mode", "operator/protective_clear", "link"}:
        # A stop takes a moment to end in HOLD; asked again, it is refused or goes on.
        steps += [
            step(later + wait, {"operator/mode": {"action": "resume"}}) for wait in (0.3, 0.6)
        ]
    return steps


def _twist(draw: Draw) -> list[float]:
    linear, angular = draw.normal(size=3), draw.normal(size=3)
    linear *= draw.uniform(*SPEEDS) / np.linalg.norm(linear)
    angular *= draw.uniform(*ANGULAR_SPEEDS) / np.linalg.norm(angular)
    # One part alone, half of the time.
    kind = int(draw.integers(4))
    if kind == 0:
        linear *= 0.0
    elif kind == 1:
        angular *= 0.0
    return [*linear.tolist(), *angular.tolist()]


def _frame(draw: Draw) -> Frame:
    return FRAMES[int(draw.integers(len(FRAMES)))]


def _axes(draw: Draw) -> dict[str, Frame]:
    return {"expressed_in": _frame(draw), "relative_to": _frame(draw)}


def _stick(at_s: float, twist: list[float], axes: dict[str, Frame]) -> Step:
    return step(at_s, {"cmd/joystick": {"twist": twist, **axes}})


def _scaled(draw: Draw, gain: tuple[float, ...]) -> list[float]:
    return [g * float(draw.choice([0.0, 0.3, 1.0])) for g in gain]


def _redefined(draw: Draw, frame: str) -> dict[str, Any]:
    """Return a frame anew: from the numbers alone, or from where the arm and its frames are now."""
    reach = 0.05 if frame == "mrf" else 0.5
    found: dict[str, Any] = {
        "frame": frame,
        "xyz": draw.uniform(-reach, reach, 3).tolist(),
        "rpy": draw.uniform(-1.0, 1.0, 3).tolist(),
    }
    if draw.random() < 0.5:
        found["relative_to"] = Frame.MRF
        found["origin_only"] = bool(draw.random() < 0.3)
    if frame == "crf":
        found["moves_with"] = str(draw.choice(["world", "base"]))
    return found


def _objective(draw: Draw, cell: Cell) -> dict[str, Any]:
    name = str(draw.choice(OBJECTIVES))
    most = 1.0 if name == "least_energy" else 10.0
    found: dict[str, Any] = {"objective": name, "gain": float(draw.choice([0.0, 0.2, 1.0])) * most}
    if name == "posture":
        found["posture"] = str(draw.choice(sorted(cell.config.mechanism.postures)))
    return found


# --- What hostile operators do to a cell, seed by seed, and how order is restored after them ------
RESTORE_S = 1.3  # restoring lease, mode, gains and frames takes this long [s]
SLOWED = 0.4
"""Part of the segments that begin with a reduced speed, until the next one that does [1]."""
HOSTILE_S = (7.0, 8.6)  # length of the hostile part [s]


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
    whats += ground_order(cell) + equipment_order(cell)
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
