"""What the operator has ordered: streams with their age, goals, and settings.

Streams are true only now and expire; goals stay until replaced, cancelled, or the lease ends.
Nothing is queued: the newest order of a kind is the only one.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from ...config.load import Cell
from ...protocols.messages import messages as m
from ...protocols.messages import motion, moving
from ...protocols.messages.reflection import Reflection, ReflectionRequest
from ...protocols.topics import TOPICS, Flow
from ..control.frame_tree import GROUNDS, Tree, UnknownFrame
from ..control.spatial import Array, Pose, rotate_twist
from ..control.state import Output, Settings, StickCommand
from ..control.task.paths.goals import Goal, PathGoal, Pursuit
from ..reflection.force_reflection import Reflector
from ..refusals import Refused, Why
from .clutch import Master
from .frame_set import FrameSet
from .goals import goal_of, placed
from .redefinition import wrench_kept
from .settings import OperatorSettings

StreamT = TypeVar("StreamT", m.JoystickTwist, m.JointJog)


_BY: dict[type[m.Message], str] = {
    topic.message: topic.key for topic in TOPICS if topic.flow is Flow.COMMAND
}
"""The topic of each command."""


@dataclass(frozen=True)
class _Stream(Generic[StreamT]):
    """The newest message of a stream, and when it came."""

    message: StreamT
    since_s: float


class Commands:
    """The newest orders, checked against the cell."""

    def __init__(self, cell: Cell) -> None:
        config = cell.config
        self._n = len(cell.robot.joints)
        self._joints = [j.name for j in cell.robot.joints]
        drives = {d.joint: d for d in config.mechanism.drives}
        self._velocity = np.array([drives[j].max_velocity for j in self._joints])
        margin = np.array([drives[j].position_margin for j in self._joints])
        self._lower = np.array([j.lower for j in cell.robot.joints]) + margin
        self._upper = np.array([j.upper for j in cell.robot.joints]) - margin
        self.settings = OperatorSettings(cell)
        self.frames = FrameSet(cell, self.settings.T_wrist_sensor)
        self._stream_timeout_s = config.timing.stream_timeout_s
        self._stick: _Stream[m.JoystickTwist] | None = None
        self._jog: _Stream[m.JointJog] | None = None
        self._serial = 0
        self.goal: Goal | None = None
        """Poses in it are in World, or on the ground that it was measured against."""
        self._goal_ground = "world"
        self.T_wrist_goal = self.frames.T_wrist_mrf
        """The point of the tool that is led to the goal: the MRF that it was ordered for."""
        self.paused = False
        self.master = Master()
        self.reflector = None if config.reflection is None else Reflector(cell)
        """Forces for the operator's handle; None in a cell that reflects none."""
        self.posture: Array | None = None
        self.posture_reached = False
        self.idle = True
        """Nothing was asked for since the arm was enabled."""
        self.dropped: list[tuple[str, str]] = []
        """Goals that another command ended under way, "posture" or "goal", and by which topic."""
        self.wrench_desired = np.zeros(6)
        self._wrench_axes = m.Frame.MRF
        self._take: dict[type[m.Message], Callable[..., None]] = {
            m.JoystickTwist: self._take_stick,
            m.JointJog: self._take_jog,
            m.PositionTarget: self._take_target,
            m.PostureMove: self._take_posture,
            m.DesiredWrench: self._take_wrench,
            m.CancelGoals: self._take_cancel,
            motion.PathMotion: self._take_path,
            motion.MasterPose: self._take_master,
        }

    # --- taking orders -----------------------------------------------------------------------

    def take(self, message: m.Command, now_s: float, T_world_mrf: Pose) -> None:
        """Put a command in force. Raises `Refused` where it does not fit this cell."""
        before = self.goal, self.posture
        try:
            self._take[type(message)](message, now_s, T_world_mrf)
        except UnknownFrame as error:
            raise Refused(Why.UNKNOWN_FRAME, str(error)) from None
        self.idle = self.idle and not self._asks(message)
        for name, old, new in zip(
            ("goal", "posture"), before, (self.goal, self.posture), strict=True
        ):
            if old is not None and new is None and not isinstance(message, m.CancelGoals):
                self.dropped.append((name, _BY[type(message)]))

    def _asks(self, message: m.Command) -> bool:
        """Return whether a command asks for motion, or for a force."""
        match message:
            case m.JoystickTwist():
                return any(message.twist)
            case m.JointJog():
                return any(message.rates)
            case motion.MasterPose():
                return self.goal is not None
            case _:
                return not isinstance(message, m.CancelGoals)

    @property
    def at_rest(self) -> bool:
        """True where no self-motion is to lead the arm away: at a posture, or not asked at all."""
        return self.idle or self.posture_reached

    def clear(self) -> None:
        """Drop every stream and goal: what was ordered before is dead.

        The view that is stored stays; the source that would drive to it goes back to its switch
        at start, so that no enable and no other operator sets the arm in motion unasked.
        """
        self._stick = self._jog = None
        self.settings.settle_vision()
        if self.reflector is not None:
            self.reflector.protected = True
        self._drop_goals()
        self.idle = True
        self.wrench_desired, self._wrench_axes = np.zeros(6), m.Frame.MRF

    def finish_posture(self) -> None:
        """The posture is reached: the other sources may act again."""
        self.posture = None
        self.posture_reached = True

    def led_by_hand(self) -> None:
        """A hand moves the tool: as with a stick, the arm is no posture's any more."""
        self.posture_reached = self.idle = False

    def _drop_goals(self) -> None:
        self.goal = self.posture = None
        self.posture_reached = self.paused = False
        self.master.wait()

    def _take_stick(self, message: m.JoystickTwist, now_s: float, T_world_mrf: Pose) -> None:
        tree = self.frames.tree(T_world_mrf)
        tree.pose(message.expressed_in)  # raises before it is in force
        self._stick = _Stream(message, now_s)
        self._feel(message, now_s, tree)
        if any(message.twist):
            # Whoever moves the stick wants to steer, not to watch a posture being taken.
            self.posture = None
            self.posture_reached = False

    def _take_jog(self, message: m.JointJog, now_s: float, _T: Pose) -> None:
        rates = self._joint_vector(message.rates, "rates")
        beyond = np.abs(rates) > self._velocity * (1 + 1e-9)
        if beyond.any():
            j = int(np.argmax(beyond))
            raise Refused(
                Why.OUT_OF_RANGE,
                f"rates: {self._joints[j]} {rates[j]:g} rad/s, at most {self._velocity[j]:g}",
            )
        self._jog = _Stream(message, now_s)
        self._drop_goals()

    def _take_target(self, message: m.PositionTarget, _now_s: float, T_world_mrf: Pose) -> None:
        tree = self.frames.tree(T_world_mrf)
        ground = self.frames.ground(tree.ground(message.relative_to))
        target = placed(
            message.xyz,
            message.rpy,
            message.relative_to,
            message.expressed_in,
            lambda frame: tree.pose(frame, ground),
        )
        self._lead_to(PathGoal(target, self._next_serial(), message.speed), ground)

    def _take_path(self, message: motion.PathMotion, _now_s: float, T_world_mrf: Pose) -> None:
        serial, tree = self._next_serial(), self.frames.tree(T_world_mrf)
        ground = self.frames.ground(tree.ground(message.relative_to))
        goal = goal_of(message, serial, lambda frame: tree.pose(frame, ground))
        self._lead_to(goal, ground)

    def _lead_to(self, goal: Goal, ground: str) -> None:
        self._drop_goals()
        self.goal, self._goal_ground = goal, ground
        self.T_wrist_goal = self.frames.T_wrist_mrf

    def _take_master(self, message: motion.MasterPose, now_s: float, T_world_mrf: Pose) -> None:
        tree = self.frames.tree(T_world_mrf)
        ground = self._goal_ground
        if not isinstance(self.goal, Pursuit):
            ground = self.frames.ground(self.frames.crf.on)
        axes, T = tree.pose(message.expressed_in, ground).R, tree.pose(m.Frame.MRF, ground)
        self._feel(message, now_s, tree)
        if not self.master.take(message, now_s, axes, T, self.reflector):
            return
        if not isinstance(self.goal, Pursuit):
            self.posture, self.posture_reached, self.paused = None, False, False
            self.goal = Pursuit(self.master.target, self._next_serial())
            self._goal_ground, self.T_wrist_goal = ground, self.frames.T_wrist_mrf
        self._lead()

    def _feel(self, message: m.JoystickTwist | motion.MasterPose, now_s: float, tree: Tree) -> None:
        if self.reflector is not None:
            self.reflector.hear(message.handle, now_s, tree.pose(message.expressed_in).R)

    def _next_serial(self) -> int:
        self._serial += 1
        return self._serial

    def _lead(self) -> None:
        """Let the position source follow the master; where it leads nowhere, come to rest."""
        if isinstance(self.goal, Pursuit):
            self.goal = replace(self.goal, T_world_target=self.master.target)

    def _take_posture(self, message: m.PostureMove, _now_s: float, _T: Pose) -> None:
        if message.posture is not None:
            q = self.settings.posture(message.posture)
        else:
            q = self._joint_vector(message.q or (), "q")
            beyond = (q < self._lower) | (q > self._upper)
            if beyond.any():
                j = int(np.argmax(beyond))
                raise Refused(
                    Why.OUT_OF_RANGE,
                    f"q: {self._joints[j]} {q[j]:g} rad, between "
                    f"{self._lower[j]:.4f} and {self._upper[j]:.4f}",
                )
        self._drop_goals()
        self.posture = q

    def _take_wrench(self, message: m.DesiredWrench, _now_s: float, T_world_mrf: Pose) -> None:
        self.frames.tree(T_world_mrf).pose(message.expressed_in)  # raises before it is in force
        self.wrench_desired, self._wrench_axes = np.array(message.wrench), message.expressed_in

    def _take_cancel(self, _message: m.CancelGoals, _now_s: float, _T: Pose) -> None:
        self._drop_goals()
        self.wrench_desired = np.zeros(6)

    def _joint_vector(self, values: tuple[float, ...], field: str) -> Array:
        if len(values) != self._n:
            raise Refused(Why.WRONG_JOINTS, f"{field}: {len(values)} values for {self._n} joints")
        return np.array(values)

    # --- changes to what was ordered --------------------------------------------------------

    def set_frame(self, request: moving.FrameRequest, T_world_mrf: Pose) -> None:
        """Redefine the MRF or the CRF; `T_world_mrf` is where the command has the MRF.

        Goals stay on the ground that they were measured against, and lead the point of the tool
        that they were ordered for; a master leads the new MRF from where it has led the old one.
        A desired wrench stays the same load. Raises `Refused`.
        """
        tree = self.frames.tree(T_world_mrf)
        try:
            T_old_new = self.frames.redefine(request, tree)
        except UnknownFrame as error:
            raise Refused(Why.UNKNOWN_FRAME, str(error)) from None
        if T_old_new is not None:
            self._keep(T_old_new, tree)
        elif self._wrench_axes is m.Frame.CRF:
            turn = self.frames.T_world_crf.R.T @ tree.pose("crf").R
            self.wrench_desired = rotate_twist(turn, self.wrench_desired)

    def _keep(self, T_old_new: Pose, tree: Tree) -> None:
        """Let what was ordered for the old MRF mean the same for the new one."""
        axes = None
        if self._wrench_axes is not m.Frame.MRF:
            axes = tree.pose(self._wrench_axes, m.Frame.MRF).R
        self.wrench_desired = wrench_kept(self.wrench_desired, T_old_new, axes)
        if isinstance(self.goal, Pursuit):
            self.T_wrist_goal = self.frames.T_wrist_mrf
            self.master.carry(T_old_new)
            self._lead()

    def set_clutch(self, request: motion.ClutchRequest) -> None:
        """Engage, disengage or scale the master."""
        self.master.set(request)
        self._lead()

    def set_protection(self, request: ReflectionRequest) -> None:
        """Protect the reflected force against delay, or not. Raises `Refused` if there is none."""
        if self.reflector is None:
            raise Refused(Why.NOT_NOW, "the cell reflects no forces")
        self.reflector.protected = request.protected

    def set_path(self, request: motion.PathRequest) -> None:
        """Pause, resume or abort the path. Raises `Refused` where none is under way."""
        if self.goal is None or isinstance(self.goal, Pursuit):
            raise Refused(Why.NOT_NOW, "no path is under way")
        if request.action == "abort":
            self.goal = None
        self.paused = request.action == "pause"

    def control_settings(self) -> Settings:
        """Return what the tick shall use now."""
        settings, frames = self.settings, self.frames
        return Settings(
            gains=settings.gains_in_force,
            T_wrist_mrf=frames.T_wrist_mrf,
            T_world_crf=frames.T_world_crf,
            redefined=frames.redefined,
            wrench_bias=settings.wrench_bias,
            speed_factor=settings.speed_factor,
            payload=settings.payload,
            pulls=settings.pulls,
            avoid=settings.avoid,
        )

    # --- what is in force now ----------------------------------------------------------------

    @property
    def target(self) -> Pose | None:
        """Where the position source is to bring the MRF, in World, if anywhere that is known."""
        placed = self.placed_target
        return None if placed is None else self.frames.in_world(*placed)

    @property
    def placed_target(self) -> tuple[str, Pose] | None:
        """The target as it was placed: its ground, and the MRF's pose there."""
        T, mrf = None if self.goal is None else self.goal.T_world_target, self.frames.T_wrist_mrf
        if T is None or mrf is self.T_wrist_goal:
            return None if T is None else (self._goal_ground, T)
        return self._goal_ground, T @ (self.T_wrist_goal.inverse() @ mrf)

    def ground(self, now_s: float) -> str:
        """Return what motion is relative to: of the goal, else of the stick, else of the CRF."""
        if self.goal is not None:
            return self._goal_ground
        stick = self._fresh(self._stick, now_s)
        if stick is not None and any(stick.message.twist):
            frame = stick.message.relative_to
            return self.frames.ground(frame if frame in GROUNDS else self.frames.crf.on)
        return self.frames.ground(self.frames.crf.on)

    def wrench_axes(self, T_world_mrf: Pose) -> Array | None:
        """Return the axes (3, 3) of the desired wrench in World, None for the MRF's."""
        if self._wrench_axes is m.Frame.MRF:
            return None
        return self.frames.tree(T_world_mrf).pose(self._wrench_axes).R

    def stick(self, now_s: float, T_world_mrf: Pose) -> StickCommand | None:
        """Return the stick's twist, or None once its news is too old."""
        stream = self._fresh(self._stick, now_s)
        if stream is None:
            return None
        axes = self.frames.tree(T_world_mrf).pose(stream.message.expressed_in).R
        twist = self.master.scaled(np.array(stream.message.twist))
        return None if twist is None else StickCommand(twist, axes)

    def jog(self, now_s: float) -> Array | None:
        """Return the joint rates (n,) to jog at, or None once their news is too old."""
        stream = self._fresh(self._jog, now_s)
        if stream is None:
            return None
        return np.array(stream.message.rates)

    def expired(self, now_s: float) -> list[str]:
        """Return the streams that fell silent while they asked for motion, and forget them."""
        names = []
        if self._stick is not None and self._fresh(self._stick, now_s) is None:
            names += ["joystick"] if any(self._stick.message.twist) else []
            self._stick = None
        if self._jog is not None and self._fresh(self._jog, now_s) is None:
            names += ["jog"] if any(self._jog.message.rates) else []
            self._jog = None
        if self.master.expired(now_s, self._stream_timeout_s):
            names.append("master_pose")
            self._lead()
        return names

    def restart_path(self) -> None:
        """Let the path to the target begin anew from where the arm is."""
        if self.goal is not None:
            self.goal = replace(self.goal, attempt=self.goal.attempt + 1)

    def reflect(self, output: Output) -> None:
        """Let the handle feel what a tick has measured, where the cell reflects forces."""
        if self.reflector is not None:
            self.reflector.reflect(
                output.wrench_mrf,
                output.gains,
                output.T_world_mrf_measured.R,
                self.master.translation,
                isinstance(self.goal, Pursuit),
            )

    def reflection(self, tick: int) -> Reflection | None:
        """Return what the operator's handle is told, None where the cell reflects no forces."""
        return None if self.reflector is None else self.reflector.message(tick)

    def _fresh(self, stream: _Stream[StreamT] | None, now_s: float) -> _Stream[StreamT] | None:
        if stream is None or now_s - stream.since_s > self._stream_timeout_s:
            return None
        return stream
