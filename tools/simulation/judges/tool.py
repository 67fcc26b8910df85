"""Judge of the tool: its true distance from where the script sends it, at the end of a run.

It knows the script's steps and the physics, and nothing of the controller: what a command means is
worked out anew when it is played, from the true poses. A target that the daemon refused or gave up
by itself is a target all the same. Targets of joint tasks, and what a reflecting handle leads to,
are not judged here.
"""

from collections import deque
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from ....config.load import Cell
from ....config.schema.section import PoseSection
from ....protocols import topics as t
from ....protocols.messages.messages import Frame
from ....protocols.messages.rig import RigTruth
from ....server.control.spatial import Array, Pose, moved, pose_error, rotation_rpy, sizes
from ...scripts.step import Step

JUDGED_S = 0.5
"""The tool's error is the largest over this long before the end [s]."""
_ENDS_GOAL: Final = (t.POSTURE, t.JOG, t.CANCEL, t.INSERT)
"""Commands that drop the target."""


class _Mount(NamedTuple):
    """A frame's place on the ground that it moves with."""

    on: str
    T: Pose


class ToolJudge:
    """Compares the physics' pose of one arm's MRF with its target, tick by tick."""

    def __init__(self, cell: Cell, *, first: bool = True) -> None:
        """Judge the arm of one part of a cell; commands without a name are the `first` one's."""
        mechanism, frames = cell.config.mechanism, cell.config.frames
        self._period_s = cell.config.timing.period_s
        self._name = mechanism.name
        self._names = {mechanism.name, cell.task, *([None] if first else [])}
        self._T_wrist_mrf = placed(mechanism.T_wrist_mrf)
        self._T_mrf_wrist = self._T_wrist_mrf.inverse()
        self._T_world_base = placed(mechanism.T_world_base)
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
        self._errors: deque[tuple[float, float] | None] = deque(
            maxlen=round(JUDGED_S / self._period_s)
        )

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
            self._clutch |= {name: float(value) for name, value in fields.items()}

    def judge(self, truth: RigTruth) -> None:
        """Take in the truth after a tick."""
        if self._clutch["engaged"] and self._master is not None:
            self._lead(truth, *self._master)
        if self._target is None:
            self._errors.append(None)
            return
        T_world_target = self._ground(truth, self._target.on) @ self._target.T
        T_world_goal = self._wrist(truth) @ self._T_wrist_goal
        self._errors.append(sizes(pose_error(T_world_target, T_world_goal)))

    @property
    def error(self) -> tuple[float, float] | None:
        """Largest distance [m] and angle [rad] of late; None without a target all along."""
        judged = [error for error in self._errors if error is not None]
        if len(judged) != self._errors.maxlen:
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
        return on if on in truth.frames else "world"

    def _ground(self, truth: RigTruth, name: str) -> Pose:
        moved = truth.frames.get(name)
        if moved is not None:
            return _pose(moved)
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
