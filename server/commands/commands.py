"""Commands in force: streams with their age, goals, the desired wrench, settings and frames.

Streams are true only now and expire; goals stay until replaced, cancelled, or the lease ends.
Nothing is queued: the newest command of a kind is the only one.
"""

from collections.abc import Callable
from typing import Final, Self

import numpy as np

from ...config.load import Cell
from ...protocols.messages import drive, motion
from ...protocols.messages import messages as m
from ...protocols.messages.perception import moving
from ...protocols.topics import TOPICS, Flow
from ..control.frame_tree import GROUNDS, UnknownFrame
from ..control.spatial import Pose
from ..control.state import Output, Settings
from ..control.task.asked import StickCommand
from ..control.task.paths.goals import Goal, PathGoal, Pursuit
from ..reflection.force_reflection import Reflector
from ..refusals import Refused, Why
from ..stability.gains import LoopBounds
from .clutch import Master
from .driving import DriveCommands, drive_commands
from .frames.frame_set import FrameSet
from .frames.placement import path_goal, placed
from .goals import Goals
from .haptic_handle import HapticHandle, reflector_of
from .in_force import InForce
from .joint_commands import JointCommands
from .settings import CellSettings, OperatorSettings
from .streams import Stream
from .wrench_goal import WrenchGoal

_TOPIC: Final[dict[type[m.Message], str]] = {
    topic.message: topic.key for topic in TOPICS if topic.flow is Flow.COMMAND
}
"""The topic of each command."""


class Commands:
    """The newest commands of each kind, checked against the cell."""

    def __init__(
        self,
        joints: JointCommands,
        insertion: DriveCommands,
        settings: OperatorSettings,
        frames: FrameSet,
        stream_timeout_s: float,
        reflector: Reflector | None = None,
    ) -> None:
        self._joints, self._insertion = joints, insertion
        self.settings, self.frames = settings, frames
        self.goals = Goals(frames.T_wrist_mrf)
        self.wrench = WrenchGoal()
        self.master = Master()
        self.handle = HapticHandle(reflector)
        self.dropped: list[tuple[str, str]] = []
        """Goals that another command ended under way, "posture" or "goal", and by which topic."""
        self._stream_timeout_s = stream_timeout_s
        self._stick = Stream[m.JoystickTwist](stream_timeout_s)
        self._jog = Stream[m.JointJog](stream_timeout_s)
        self._take: dict[type[m.Message], Callable[..., None]] = {
            m.JoystickTwist: self._take_stick,
            m.JointJog: self._take_jog,
            m.PositionTarget: self._take_target,
            m.PostureMove: self._take_posture,
            m.DesiredWrench: self._take_wrench,
            m.CancelGoals: self._take_cancel,
            motion.PathMotion: self._take_path,
            motion.MasterPose: self._take_master,
            drive.Drive: insertion.take,
            drive.Insert: insertion.take,
        }

    @classmethod
    def from_cell(
        cls, cell: Cell, shared: CellSettings | None = None, bounds: LoopBounds | None = None
    ) -> Self:
        """Return the commands of a loaded cell: nothing is asked for yet.

        `shared` are the settings of all its arms, where there are several, `bounds` those of its
        loops where they are not this cell's own.
        """
        config = cell.config
        frames = FrameSet(config.mechanism, config.frames, config.T_world_crf)
        shared = shared or CellSettings.from_config(config)
        return cls(
            JointCommands.from_cell(cell),
            drive_commands(cell),
            OperatorSettings(config, bounds or LoopBounds(cell), shared, frames),
            frames,
            config.timing.stream_timeout_s,
            reflector_of(config),
        )

    # --- one message ---------------------------------------------------------------------------

    def take(self, message: m.Command, now_s: float, T_world_mrf: Pose) -> None:
        """Put a command in force. Raises `Refused` where it does not fit this cell."""
        goals = self.goals
        before = goals.goal, goals.posture
        try:
            self._take[type(message)](message, now_s, T_world_mrf)
        except UnknownFrame as error:
            raise Refused(Why.UNKNOWN_FRAME, str(error)) from None
        goals.idle = goals.idle and not self._asks(message)
        after = goals.goal, goals.posture
        for name, old, new in zip(("goal", "posture"), before, after, strict=True):
            if old is not None and new is None and not isinstance(message, m.CancelGoals):
                self.dropped.append((name, _TOPIC[type(message)]))

    def _asks(self, message: m.Command) -> bool:
        """Return whether a command asks for motion, or for a force."""
        match message:
            case m.JoystickTwist():
                return any(message.twist)
            case m.JointJog() | drive.Drive():
                return any(message.rates)
            case motion.MasterPose():
                return self.goals.goal is not None
            case _:
                return not isinstance(message, m.CancelGoals)

    def _take_stick(self, message: m.JoystickTwist, now_s: float, T_world_mrf: Pose) -> None:
        tree = self.frames.tree(T_world_mrf)
        tree.pose(message.expressed_in)  # raises before it is in force
        self._stick.take(message, now_s)
        self.handle.hear(message.handle, now_s, tree.pose(message.expressed_in).R)
        if any(message.twist):
            # Whoever moves the stick wants to steer, not to watch a posture being taken.
            self.goals.leave_posture()

    def _take_jog(self, message: m.JointJog, now_s: float, _T: Pose) -> None:
        self._joints.check_rates(message.rates)
        self._jog.take(message, now_s)
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
        self._lead_to(PathGoal(target, self.goals.next_serial(), message.speed), ground)

    def _take_path(self, message: motion.PathMotion, _now_s: float, T_world_mrf: Pose) -> None:
        serial, tree = self.goals.next_serial(), self.frames.tree(T_world_mrf)
        ground = self.frames.ground(tree.ground(message.relative_to))
        goal = path_goal(message, serial, lambda frame: tree.pose(frame, ground))
        self._lead_to(goal, ground)

    def _lead_to(self, goal: Goal, ground: str) -> None:
        self.master.wait()
        self.goals.lead_to(goal, ground, self.frames.T_wrist_mrf)

    def _take_master(self, message: motion.MasterPose, now_s: float, T_world_mrf: Pose) -> None:
        tree, goals = self.frames.tree(T_world_mrf), self.goals
        ground = goals.ground
        if not goals.pursuing:
            ground = self.frames.ground(self.frames.crf.on)
        axes, T = tree.pose(message.expressed_in, ground).R, tree.pose(m.Frame.MRF, ground)
        self.handle.hear(message.handle, now_s, tree.pose(message.expressed_in).R)
        if not self.master.take(message, now_s, axes, T, self.handle.reflector):
            return
        if not goals.pursuing:
            pursuit = Pursuit(self.master.target, goals.next_serial())
            goals.lead_to(pursuit, ground, self.frames.T_wrist_mrf)
        goals.pursue(self.master.target)

    def _take_posture(self, message: m.PostureMove, _now_s: float, _T: Pose) -> None:
        if message.posture is not None:
            q = self.settings.posture(message.posture)
        else:
            q = self._joints.angles(message.q or ())
        self._drop_goals()
        self.goals.take_posture(q)

    def _take_wrench(self, message: m.DesiredWrench, _now_s: float, T_world_mrf: Pose) -> None:
        self.frames.tree(T_world_mrf).pose(message.expressed_in)  # raises before it is in force
        self.wrench.set(np.array(message.wrench), message.expressed_in)

    def _take_cancel(self, _message: m.CancelGoals, _now_s: float, _T: Pose) -> None:
        self._drop_goals()
        self.wrench.cancel()

    def _drop_goals(self) -> None:
        self._insertion.drop()
        self.goals.drop()
        self.master.wait()

    # --- requests that change what was commanded -----------------------------------------------

    def set_frame(self, request: moving.FrameRequest, T_world_mrf: Pose) -> None:
        """Redefine the MRF or the CRF; `T_world_mrf` is where the command has the MRF.

        Goals stay on the ground that they were measured against, and lead the point of the tool
        that they were commanded for; a master leads the new MRF from where it has led the old one.
        A desired wrench stays the same load. Raises `Refused`.
        """
        tree = self.frames.tree(T_world_mrf)
        try:
            T_old_new = self.frames.redefine(request, tree, self.settings.require_mrf)
        except UnknownFrame as error:
            raise Refused(Why.UNKNOWN_FRAME, str(error)) from None
        if T_old_new is None:
            self.wrench.carry_crf(self.frames.T_world_crf.R, tree)
            return
        self.wrench.carry_mrf(T_old_new, tree)
        if self.goals.pursuing:
            self.goals.T_wrist_goal = self.frames.T_wrist_mrf
            self.master.carry(T_old_new)
            self.goals.pursue(self.master.target)

    def set_clutch(self, request: motion.ClutchRequest) -> None:
        """Engage, disengage or scale the master."""
        self.master.set(request)
        self.goals.pursue(self.master.target)

    def clear(self) -> None:
        """Drop every stream and goal: what was commanded before is dead.

        The view that is stored stays; the source that would drive to it goes back to its switch
        at start, so that no enable and no other operator sets the arm in motion unasked.
        """
        self._stick.clear()
        self._jog.clear()
        self._insertion.clear()
        self.settings.settle_vision()
        self.handle.protect()
        self._drop_goals()
        self.goals.idle = True
        self.wrench.set(np.zeros(6), m.Frame.MRF)

    def expired(self, now_s: float) -> list[str]:
        """Return the streams that fell silent while they asked for motion, and forget them."""
        stick, jog = self._stick.expire(now_s), self._jog.expire(now_s)
        silent = {
            "joystick": stick is not None and any(stick.twist),
            "jog": jog is not None and any(jog.rates),
            "drive": self._insertion.expired(now_s),
        }
        names = [name for name, moved in silent.items() if moved]
        if self.master.expired(now_s, self._stream_timeout_s):
            names.append("master_pose")
            self.goals.pursue(self.master.target)
        return names

    def reflect(self, output: Output) -> None:
        """Let the operator's handle feel what a tick has measured."""
        self.handle.reflect(output, self.master.translation, self.goals.pursuing)

    # --- what is in force now ------------------------------------------------------------------

    def in_force(self, now_s: float, T_world_mrf: Pose) -> InForce:
        """Return what a tick acts on, with the MRF at a pose in World."""
        goals, tree = self.goals, self.frames.tree(T_world_mrf)
        stick, jog = self._stick.newest(now_s), self._jog.newest(now_s)
        twist = None if stick is None else self.master.scaled(np.array(stick.twist))
        return InForce(
            settings=self.control_settings(),
            stick=None
            if stick is None or twist is None
            else StickCommand(twist, tree.pose(stick.expressed_in).R),
            jog=None if jog is None else np.array(jog.rates),
            goal=goals.goal,
            paused=goals.paused,
            posture=goals.posture,
            at_posture=goals.at_rest,
            wrench_desired=self.wrench.value,
            R_world_wrench=self.wrench.axes(tree),
            ground=self.ground(now_s),
            T_wrist_goal=goals.T_wrist_goal,
            drive=self._insertion.newest(now_s),
        )

    def by_joint(self, now_s: float) -> bool:
        """Return whether joints are commanded themselves: jogged, or led to a posture."""
        return self.goals.posture is not None or self._jog.newest(now_s) is not None

    def control_settings(self) -> Settings:
        """Return the settings that a tick uses."""
        return self.settings.for_control()

    def ground(self, now_s: float) -> str:
        """Return what motion is relative to: of the goal, else of the stick, else of the CRF."""
        if self.goals.goal is not None:
            return self.goals.ground
        stick = self._stick.newest(now_s)
        if stick is not None and any(stick.twist) and stick.relative_to in GROUNDS:
            return self.frames.ground(stick.relative_to)
        return self.frames.ground(self.frames.crf.on)

    @property
    def target(self) -> Pose | None:
        """Pose in World that the position source is to bring the MRF to, if there is any."""
        placed_target = self.placed_target
        return None if placed_target is None else self.frames.in_world(*placed_target)

    @property
    def placed_target(self) -> tuple[str, Pose] | None:
        """The target on its ground: the ground's name, and the MRF's pose there."""
        return self.goals.placed_target(self.frames.T_wrist_mrf)
