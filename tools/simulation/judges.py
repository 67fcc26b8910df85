"""Judges of a simulated run, by the physics' truth."""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np

from ...config.load import Cell
from ...config.schema.mechanism import BackboneSection
from ...config.schema.section import PoseSection
from ...protocols import topics as t
from ...protocols.messages.messages import Frame
from ...protocols.messages.rig import RigTruth
from ...protocols.messages.telemetry import Event, State
from ...server.control.backbone.curve import centre_line
from ...server.control.backbone.fit import Chain
from ...server.control.spatial import (
    Array,
    Pose,
    moved,
    pose_error,
    rotation_log,
    rotation_rpy,
    sizes,
)
from ...server.perception.cameras import board_of
from ...server.perception.filters import pictured
from ..scripts.script import Script, Step


# --- Figures of a base on wheels, by the physics' truth -------------------------------------------
def base_figures(
    cell: Cell, states: Sequence[State], truths: Sequence[RigTruth]
) -> dict[str, object]:
    """Return the figures for a simulation's JSON; none of a cell where nothing rolls.

    How far the base has gone, along its way [m], and how far odometry is off at the end [m], [rad].
    """
    if cell.config.mechanism.base is None or not truths or not states:
        return {}
    places = [truth.frames["base"] for truth in truths]
    travel = sum(math.dist(a[:2], b[:2]) for a, b in pairwise(places))
    true, told = places[-1], states[-1].frames["base"]
    return {
        "base_travel_m": travel,
        "odometry_error_m": math.dist(true[:2], told[:2]),
        "odometry_error_rad": abs(math.remainder(true[5] - told[5], 2.0 * math.pi)),
    }


# --- Figures of a payload that several arms hold, by the physics' truth ---------------------------
LAST_S = 1.0  # the mean internal force is that of so long before the end [s]


def beam_figures(truths: Sequence[RigTruth], period_s: float) -> dict[str, object]:
    """Return the figures for a simulation's JSON; none where the arms hold nothing.

    Internal force (the most, and the mean of the last second) and greatest push [N], greatest
    stretch and each peg's depth at the end [m].
    """
    beams = [truth.beam for truth in truths if truth.beam is not None]
    if not beams:
        return {}
    last = beams[-max(1, round(LAST_S / period_s)) :]
    return {
        "internal_force_n": {
            "max": max(beam.internal_force for beam in beams),
            "last_mean": math.fsum(beam.internal_force for beam in last) / len(last),
        },
        "stretch_m": max(beam.stretch for beam in beams),
        "peg_depth_m": list(beams[-1].peg_depth),
        "push_n": max(beam.push_peak for beam in beams),
    }


# --- Judge of postures: how far joints truly are from the posture that a script asked for last ----
def posture_figures(cell: Cell, script: Script, truth: RigTruth) -> dict[str, object]:
    """Return the figure for a simulation's JSON; none where the last motion is to no posture.

    The farthest joint of all arms whose last command of motion is a posture [rad].
    """
    last: dict[str, tuple[float, ...] | None] = {}
    parts = {part.config.mechanism.name: part.config.mechanism for part in cell.parts}
    for step in script.steps:
        if step.message is None or step.message.topic.flow is not t.Flow.COMMAND:
            continue
        fields = step.message.fields
        name = fields.get("mechanism") or fields.get("task") or next(iter(parts))
        asked = step.says(t.POSTURE)
        if asked is None or name not in parts:
            last[name] = None
        else:
            last[name] = asked.get("q") or parts[name].postures.get(asked["posture"])
    truths, first = {}, 0
    for name, mechanism in parts.items():
        truths[name] = truth.q[first : first + len(mechanism.drives)]
        first += len(mechanism.drives)
    errors = [
        max(abs(true - told) for true, told in zip(truths[name], q, strict=True))
        for name, q in last.items()
        if q is not None
    ]
    return {"posture_error_rad": max(errors)} if errors else {}


# --- Judge of the tool: its true distance from where the script sends it, at the end of a run -----
#
# It knows the script's steps and the physics, and nothing of the controller: what a command
# means is worked out anew when it is played, from the true poses. A target that the daemon
# refused or gave up by itself is a target all the same. Targets of joint tasks, and what a
# reflecting handle leads to, are not judged here.
JUDGED_S = 0.5  # the tool's error is the largest over this long before the end [s]
_ENDS_GOAL: Final = (t.POSTURE, t.JOG, t.CANCEL, t.INSERT)  # commands that drop the target


class _Mount(NamedTuple):
    """A frame's place on the ground that it moves with."""

    on: str
    T: Pose


def stands(part: Cell) -> bool:
    """Return whether the Base of a mechanism stands; physics moves that of a cell's first only."""
    there = part.config.mechanism.base is None and part.config.frames.base is None
    return there or part.place not in ("mechanism", "mechanisms[0]")


class ToolJudge:
    """Compares the physics' pose of one arm's MRF with its target, tick by tick."""

    def __init__(self, cell: Cell, *, first: bool = True, under: Cell | None = None) -> None:
        """Judge the arm of one part of a cell; commands without a name are the `first` one's.

        It stands on another part's tip link, if one is `under` it.
        """
        mechanism, frames = cell.config.mechanism, cell.config.frames
        self._period_s = cell.config.timing.period_s
        self._name = mechanism.name
        self._names = {mechanism.name, cell.task, *([None] if first else [])}
        self._T_wrist_mrf = placed(mechanism.T_wrist_mrf)
        self._T_mrf_wrist = self._T_wrist_mrf.inverse()
        self._T_world_base = placed(mechanism.T_world_base)
        self._stands = stands(cell)
        self._on: tuple[str, Pose] | None = None
        """The mechanism that it stands on, and its Base in that one's MRF; None: it is in World."""
        if under is not None:
            torso, T_on = under.config.mechanism, placed(mechanism.T_on or PoseSection())
            self._on = torso.name, placed(torso.T_wrist_mrf).inverse() @ T_on
        on_world = frames.crf_on == "world"
        self._crf = _Mount(
            frames.crf_on, placed(cell.config.T_world_crf if on_world else frames.T_ground_crf)
        )
        sensor = mechanism.force_torque
        self._T_wrist_sensor = None if sensor is None else placed(sensor.T_wrist_sensor)
        self._target: _Mount | None = None
        self._T_wrist_goal = self._T_wrist_mrf
        """The point of the tool that is sent there: the MRF of then, in the Wrist."""
        self._master: tuple[Array, Frame] | None = None
        """Twist (6,) of the master's handle, and in whose axes."""
        self._clutch: dict[str, float] = {"engaged": 0.0, "translation": 1.0, "rotation": 1.0}
        self._late: deque[tuple[RigTruth, _Mount | None, Pose]] = deque(
            maxlen=round(JUDGED_S / self._period_s)
        )
        """The newest truths, each with its target and where the goal is in Wrist."""

    def on_step(self, step: Step, truth: RigTruth) -> None:
        """Take in a step of the script when it is played, with the truth of then."""
        if step.master is not None and None in self._names:
            self._master = np.array(step.master.twist), step.master.expressed_in
        if step.message is None:
            return
        topic, fields = step.message.topic, step.message.fields
        if fields.get("task", fields.get("mechanism")) not in self._names:
            return
        if topic is t.POSITION:
            self._aim(truth, fields, fields["xyz"], fields["rpy"])
        elif topic is t.PATH:
            self._target = None
            if fields.get("waypoints"):
                last = fields["waypoints"][-1]
                self._aim(truth, fields, last[:3], last[3:])
        elif topic in _ENDS_GOAL:
            self._target = None
        elif topic is t.FRAME:
            self._redefine(truth, fields)
        elif topic is t.CLUTCH:
            given = {name: fields.get(name) for name in self._clutch}
            self._clutch |= {name: float(x) for name, x in given.items() if x is not None}

    def judge(self, truth: RigTruth) -> None:
        """Take in the truth after a tick."""
        if self._clutch["engaged"] and self._master is not None:
            self._lead(truth, *self._master)
        self._late.append((truth, self._target, self._T_wrist_goal))

    @property
    def error(self) -> tuple[float, float] | None:
        """Largest distance [m] and angle [rad] of late; None without a target all along."""
        judged = [
            sizes(
                pose_error(
                    self._ground(truth, target.on) @ target.T, self._wrist(truth) @ T_wrist_goal
                )
            )
            for truth, target, T_wrist_goal in self._late
            if target is not None
        ]
        if len(judged) != self._late.maxlen:
            return None
        return max(e[0] for e in judged), max(e[1] for e in judged)

    def _aim(self, truth: RigTruth, fields: Mapping[str, Any], xyz: Array, rpy: Array) -> None:
        relative = fields.get("relative_to", Frame.CRF)
        axes = fields.get("expressed_in") or relative
        R, T_origin = self._pose(truth, axes).R, self._pose(truth, relative)
        turn = R @ rotation_rpy(*rpy) @ R.T
        T = Pose(turn @ T_origin.R, T_origin.p + R @ np.array(xyz))
        self._place(truth, T, self._ground_of(truth, relative))

    def _place(self, truth: RigTruth, T_world_target: Pose, ground: str) -> None:
        T = self._ground(truth, ground).inverse() @ T_world_target
        self._target, self._T_wrist_goal = _Mount(ground, T), self._T_wrist_mrf

    def _lead(self, truth: RigTruth, twist: Array, axes: Frame) -> None:
        """Move the target on as the master's handle moves, at the clutch's scales."""
        if self._target is None:
            self._place(truth, self._pose(truth, Frame.MRF), "world")
        if self._target is None:
            return
        R, scales = self._pose(truth, axes).R, self._clutch
        step = self._period_s * np.concatenate(
            (scales["translation"] * R @ twist[:3], scales["rotation"] * R @ twist[3:])
        )
        self._target = self._target._replace(T=moved(self._target.T, step))

    def _redefine(self, truth: RigTruth, fields: Mapping[str, Any]) -> None:
        is_mrf = fields["frame"] == "mrf"
        there = fields.get("relative_to") or (Frame.WRIST if is_mrf else Frame.WORLD)
        asked = Pose.from_xyz_rpy(fields.get("xyz", (0.0,) * 3), fields.get("rpy", (0.0,) * 3))
        T = self._pose(truth, there) @ asked
        if fields.get("origin_only"):
            T = T._replace(R=self._pose(truth, Frame(fields["frame"])).R @ asked.R)
        if is_mrf:
            self._T_wrist_mrf = self._wrist(truth).inverse() @ T
        else:
            on = fields.get("moves_with") or self._crf.on
            self._crf = _Mount(on, self._ground(truth, on).inverse() @ T)

    def _ground_of(self, truth: RigTruth, frame: Frame) -> str:
        """Return the ground that what is measured against a frame moves with."""
        grounds = (Frame.WORLD, Frame.BASE, Frame.CARRIER)
        on = str(frame) if frame in grounds else self._crf.on
        return on if self._moved(truth, on) is not None else "world"

    def _moved(self, truth: RigTruth, name: str) -> Pose | None:
        """Return where a ground that may move truly is; None for one that stands."""
        if name == "base" and self._on is not None:
            torso, T_mrf_base = self._on
            return _pose(truth.arms[torso].pose_mrf) @ T_mrf_base
        told = None if name == "base" and self._stands else truth.frames.get(name)
        return None if told is None else _pose(told)

    def _ground(self, truth: RigTruth, name: str) -> Pose:
        moved = self._moved(truth, name)
        if moved is not None:
            return moved
        return self._T_world_base if name == "base" else Pose.identity()

    def _wrist(self, truth: RigTruth) -> Pose:
        return _pose(truth.arms[self._name].pose_mrf) @ self._T_mrf_wrist

    def _pose(self, truth: RigTruth, frame: Frame) -> Pose:
        match frame:
            case Frame.MRF:
                return self._wrist(truth) @ self._T_wrist_mrf
            case Frame.CRF:
                return self._ground(truth, self._crf.on) @ self._crf.T
            case Frame.WRIST:
                return self._wrist(truth)
            case Frame.SENSOR if self._T_wrist_sensor is not None:
                return self._wrist(truth) @ self._T_wrist_sensor
            case _:
                return self._ground(truth, str(frame))


def placed(section: PoseSection) -> Pose:
    """Return a pose of the cell file."""
    return Pose.from_xyz_rpy(section.xyz, section.rpy)


def _pose(six: tuple[float, ...]) -> Pose:
    return Pose.from_xyz_rpy(six[:3], six[3:])


def _wrist(truth: RigTruth, part: Cell) -> Pose:
    m = part.config.mechanism
    return _pose(truth.arms[m.name].pose_mrf) @ placed(m.T_wrist_mrf).inverse()


# --- Depth of pegs as arms' tools: truly in a hole, wherever the hole really is -------------------
def peg_depths(cell: Cell, truth: RigTruth) -> list[float]:
    """Return how deep each arm's peg is in the hole that it is nearest to the axis of [m].

    Negative before the mouth, 0 where its end is below the mouth, but beside the hole. None of a
    cell without pegs and holes.
    """
    holes = () if cell.config.rig is None else cell.config.rig.holes
    placed_holes = [(placed(h.T_world_hole) @ placed(h.misplaced), h.radius) for h in holes]
    depths = []
    for part in cell.parts if holes else ():
        if part.config.rig is None or part.config.rig.peg is None:
            continue
        end, found = np.array(truth.arms[part.config.mechanism.name].pose_mrf[:3]), []
        for T, radius in placed_holes:
            T_hole_world = T.inverse()
            x, y, z = (T_hole_world.R @ end + T_hole_world.p).tolist()
            aside = math.hypot(x, y)
            found.append((aside, -z if z > 0.0 or aside < radius else 0.0))
        depths.append(min(found)[1])
    return depths


# --- Judge of an arm in tunnels: where its links truly are, and what they press on the walls ------
STEP = 0.004  # points of the centre line are at most so far apart [m]
INSIDE = 2.0
"""Points farther from the centre line than this many half widths are not in the tunnel [1]."""


class TunnelJudge:
    """Judges every tick by the physics; idle for a cell without a backbone."""

    def __init__(self, cell: Cell) -> None:
        backbone, rig = cell.config.mechanism.backbone, cell.config.rig
        if backbone is not None and rig is not None and rig.tunnel.pieces:
            backbone = backbone.model_copy(update={"tunnel": rig.tunnel.pieces})
        self._chain = None if backbone is None else Chain.from_cell(cell)
        self._line = None if backbone is None else _CentreLine(backbone)
        self.centre_error = 0.0  # the farthest that a link was off the centre line inside [m]
        self.insertion = self.deepest = 0.0
        """How far in along the centre line the tip is, and has been [m]."""
        self.wall_force = 0.0
        """The greatest force on walls and what else stands around, in any physics step [N]."""

    def judge(self, truth: RigTruth) -> None:
        """Take in a tick."""
        if self._chain is None or self._line is None:
            return
        links = self._chain.points(np.array([truth.q]))[0]
        self.insertion = self._line.along(links[-1])
        self.deepest = max(self.deepest, self.insertion)
        points = np.concatenate((links, 0.5 * (links[1:] + links[:-1])))
        self.centre_error = max(self.centre_error, self._line.off_centre(points))
        arms = truth.arms.values()
        self.wall_force = max(self.wall_force, *(arm.contact_peak for arm in arms))

    def figures(self) -> dict[str, Any]:
        """Return what a simulation's JSON tells; nothing for a plain arm."""
        if self._line is None:
            return {}
        return {
            "insertion_m": self.insertion,
            "deepest_m": self.deepest,
            "centre_error_m": self.centre_error,
            "wall_force_n": self.wall_force,
        }


class _CentreLine:
    """The centre line of what has walls, as points."""

    def __init__(self, backbone: BackboneSection) -> None:
        frames = [T for row in centre_line(backbone, STEP) for T in row]
        self._points = np.array([T.p for T in frames])
        self._tangents = np.array([T.R[:, 0] for T in frames])
        self._squares = (self._points**2).sum(axis=1)
        self._near = INSIDE * backbone.half_width
        steps = np.linalg.norm(np.diff(self._points, axis=0), axis=1)
        self._lengths = np.concatenate(([0.0], np.cumsum(steps)))

    def along(self, point: Array) -> float:
        """Return how far in along the centre line a point (3,) is [m]; what is before it, at 0."""
        nearest = int((self._squares - 2.0 * self._points @ point).argmin())
        onward = float((point - self._points[nearest]) @ self._tangents[nearest])
        ends = nearest in (0, len(self._points) - 1)
        return max(0.0, float(self._lengths[nearest]) + (onward if ends else 0.0))

    def off_centre(self, points: Array) -> float:
        """Return how far those of points (m, 3) that are in the tunnel are off its centre line [m].

        At most; 0 where none is inside.
        """
        # Least |p − c|², less what is the same for all c.
        nearest = (self._squares - 2.0 * points @ self._points.T).argmin(axis=1)
        inside = (nearest > 0) & (nearest < len(self._points) - 1)
        way = points - self._points[nearest]
        along = (way * self._tangents[nearest]).sum(axis=1)
        off = np.sqrt(np.maximum(0.0, (way * way).sum(axis=1) - along**2))
        found = off[inside & (np.abs(along) < STEP) & (off < self._near)]
        return float(found.max()) if len(found) else 0.0


# --- Judge of the view: its true distance from the stored one, by physics, never by pictures ------
class ViewJudge:
    """Remembers the true view of each camera when one is stored, and compares."""

    def __init__(self, cell: Cell) -> None:
        self._eyes = {c.name: (part, c) for part in cell.parts for c in part.config.cameras}
        """Each camera, with the arm whose task it is for."""
        tags = () if cell.config.rig is None else cell.config.rig.tags
        self._tags = {tag.tag: (cell.part(tag.mechanism), tag) for tag in tags}
        kept = (part.config.sources.vision.camera for part in cell.parts)
        self._camera = next((name for name in kept if name), None) or next(iter(self._eyes), "")
        self._stored: dict[str, Pose] = {}
        """Views that cameras are to have: told by the cell, or true when one was stored."""
        for part in cell.parts:
            vision = part.config.sources.vision
            named = vision.camera or next((c.name for c in part.config.cameras), "")
            if vision.view is not None and named:
                self._stored[named] = placed(vision.view)

    def view(self, truth: RigTruth, camera: str | None = None) -> Pose | None:
        """Return the true pose of a camera's tag in its Lens, None where there is no such tag."""
        if (eye := self._eyes.get(camera or self._camera)) is None:
            return None
        (part, section), (carrier, tag) = eye, self._tags.get(eye[1].tag, (eye[0], None))
        if tag is None:
            return None
        base, home = truth.frames.get("base"), placed(part.config.mechanism.T_world_base)
        places = {
            "wrist": _wrist(truth, part),
            "base": home if base is None or stands(part) else _pose(base),
            "world": Pose.identity(),
        }
        T_world_lens = places[section.on] @ placed(section.place)
        if tag.T_wrist_tag is not None:
            return T_world_lens.inverse() @ (_wrist(truth, carrier) @ placed(tag.T_wrist_tag))
        return T_world_lens.inverse() @ _pose(truth.tags[tag.name])

    def error_px(self, truth: RigTruth) -> float | None:
        """Return how far corners truly are from where they were stored in the picture [px], rms.

        Of the camera's tag, where its stored view has it; covered or not.
        """
        now, stored = self.view(truth), self._stored.get(self._camera)
        if stored is None or now is None:
            return None
        camera = self._eyes[self._camera][1]
        corners = board_of(camera)[camera.tag]
        if min((corners @ T.R.T + T.p)[:, 2].min() for T in (now, stored)) <= 0.0:
            return None
        off = pictured(corners @ now.R.T + now.p) - pictured(corners @ stored.R.T + stored.p)
        return math.sqrt(float(((off * camera.focal) ** 2).sum()) / len(off))

    def on_event(self, event: Event, truth: RigTruth) -> None:
        self._camera = event.detail or self._camera
        if event.name == "view_stored" and (seen := self.view(truth)) is not None:
            self._stored[self._camera] = seen

    def error(self, truth: RigTruth) -> tuple[float, float] | None:
        """Return how far the Lens is from the stored view [m, rad], None before one is stored.

        Of a camera beside the arm: how far the target is.
        """
        now, stored = self.view(truth), self._stored.get(self._camera)
        if stored is None or now is None:
            return None
        carried = self._eyes[self._camera][1].on == "wrist"
        a, b = (stored.inverse(), now.inverse()) if carried else (stored, now)
        turn = rotation_log(a.R.T @ b.R)
        way = b.p - a.p
        return math.sqrt(float(way @ way)), math.sqrt(float(turn @ turn))
