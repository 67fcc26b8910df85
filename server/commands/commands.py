"""Commands in force: streams with their age, goals, the desired wrench, settings and frames."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final, Generic, Self, TypeVar

import numpy as np

from ...config.drives import JointBounds, joint_bounds
from ...config.load import Cell
from ...config.schema.mechanism import BackboneSection, DrivenSection
from ...protocols.messages import messages as drive
from ...protocols.messages import messages as m
from ...protocols.messages import messages as motion
from ...protocols.messages import perception as moving
from ...protocols.messages.messages import Drive, Frame, Insert, PathRequest
from ...protocols.topics import TOPICS, Flow
from ..control.backbone.fit import Chain
from ..control.inputs import (
    STILL,
    UNASKED,
    DriveRequest,
    Goal,
    Inputs,
    Intent,
    PathGoal,
    Pursuit,
    SelfMotionRequest,
    StickCommand,
)
from ..control.mechanism.self_motion import REACHED, HandState
from ..control.scene import GROUNDS, FrameTree, UnknownFrame
from ..control.spatial import Array, Pose, rotate_twist
from ..reflection import Reflector
from ..refusals import Refused, Why
from ..stability.judgement import LoopBounds
from .frames import FrameSet, path_goal, placed, wrench_kept
from .haptics import Master, reflector_of
from .settings import CellSettings, OperatorSettings

NOT_MEASURED: Final = np.zeros(0)
"""Joints of inputs whose measured part is still to come."""

# --- Streams: commands that hold only while they are news, as a stick's twist ---------------------

MessageT = TypeVar("MessageT", bound=m.Command)


class Stream(Generic[MessageT]):
    """The newest message of one stream; it is in force for `timeout_s` after it came."""

    def __init__(self, timeout_s: float, moves: Callable[[MessageT], bool]) -> None:
        """Build it; `moves` says whether a message asks for motion."""
        self._timeout_s, self._moves = timeout_s, moves
        self.message: MessageT | None = None
        """The newest message, however old; None without one."""
        self._since_s = 0.0

    def take(self, message: MessageT, now_s: float) -> None:
        """Put a message in force."""
        self.message, self._since_s = message, now_s

    def newest(self, now_s: float) -> MessageT | None:
        """Return the message in force, None once it is too old."""
        return None if now_s - self._since_s > self._timeout_s else self.message

    def fell_silent(self, now_s: float) -> bool:
        """Forget a message that is too old; return whether there was one that asks for motion."""
        message = self.message
        if message is None or now_s - self._since_s <= self._timeout_s:
            return False
        self.message = None
        return self._moves(message)

    def clear(self) -> None:
        """Forget the message."""
        self.message = None


def _drives(message: Drive | m.JointJog) -> bool:
    return any(message.rates)


# --- Commands that drive an arm into its tunnels and out: a stream of speed, or a depth to go to


class InsertionCommands:
    """How the operator drives one arm; without a backbone every command is refused."""

    def __init__(self, backbone: BackboneSection | None, length: float, timeout_s: float) -> None:
        """Build it for an arm of a length from its first joint to its tip [m]."""
        self._backbone, self._length = backbone, length
        self.stream = Stream[Drive](timeout_s, _drives)
        self._goal: DriveRequest | None = None

    @classmethod
    def from_cell(cls, cell: Cell) -> Self:
        """Return those of a cell's mechanism. Raises `ConfigError` where it is no chain."""
        backbone, timeout_s = cell.config.mechanism.backbone, cell.config.timing.stream_timeout_s
        return cls(backbone, Chain.from_cell(cell).length if backbone else 0.0, timeout_s)

    def take(self, message: Drive | Insert, now_s: float, _T: Pose) -> None:
        """Put a speed or a depth in force; each ends the other, but for a speed of 0.

        Raises `Refused`.
        """
        if self._backbone is None:
            raise Refused(Why.UNKNOWN_MECHANISM, "the mechanism has no backbone to be inserted")
        if isinstance(message, Drive):
            self._take_drive(message, now_s, self._backbone)
        else:
            self._take_goal(message, self._backbone)

    def _take_drive(self, message: Drive, now_s: float, backbone: BackboneSection) -> None:
        if len(message.rates) != 1:
            raise Refused(Why.OUT_OF_RANGE, f"rates: {len(message.rates)} values: one is expected")
        if abs(message.rates[0]) > backbone.speed * (1 + 1e-9):
            raise Refused(
                Why.OUT_OF_RANGE,
                f"rates: {message.rates[0]:g} m/s: at most {backbone.speed:g} either way",
            )
        if message.rates[0]:
            self._goal = None
        self.stream.take(message, now_s)

    def _take_goal(self, message: Insert, backbone: BackboneSection) -> None:
        deepest = self._length - backbone.least
        if message.depth > deepest + 1e-9:
            raise Refused(Why.OUT_OF_RANGE, f"depth: {message.depth:g} m: at most {deepest:.4f} m")
        self.stream.clear()
        self._goal = DriveRequest(
            min(message.speed or backbone.speed, backbone.speed), message.depth
        )

    def newest(self, now_s: float) -> DriveRequest:
        """Return what is in force now."""
        if self._goal is not None or self.stream.message is None:
            return self._goal or STILL
        message = self.stream.newest(now_s)
        return STILL if message is None else DriveRequest(message.rates[0])

    def drop(self) -> None:
        """Drop the goal."""
        self._goal = None

    def clear(self) -> None:
        """Drop goal and stream."""
        self.stream.clear()
        self._goal = None


# --- The command that drives a base on wheels: a stream of its speed ahead and about its axis -----


class BaseCommands:
    """How the operator drives one base."""

    def __init__(self, base: DrivenSection, timeout_s: float) -> None:
        """Build it; a drive is in force for `timeout_s` after it came."""
        self._base = base
        self.stream = Stream[Drive](timeout_s, _drives)

    def take(self, message: Drive | Insert, now_s: float, _T: Pose) -> None:
        """Put a drive in force. Raises `Refused`."""
        if isinstance(message, Insert):
            raise Refused(Why.UNKNOWN_MECHANISM, "the mechanism has no backbone to be inserted")
        rates, base = message.rates, self._base
        if len(rates) != 2:
            raise Refused(Why.OUT_OF_RANGE, f"rates: {len(rates)} values: two are expected")
        each = zip(rates, base.most, base.rate_units, strict=True)
        for i, (value, most, unit) in enumerate(each):
            if abs(value) > most * (1 + 1e-9):
                words = f"rates[{i}]: {value:g} {unit}: at most {most:g} either way"
                raise Refused(Why.OUT_OF_RANGE, words)
        self.stream.take(message, now_s)

    def newest(self, now_s: float) -> DriveRequest:
        """Return what is in force now."""
        message = self.stream.newest(now_s)
        return STILL if message is None else DriveRequest(message.rates[0], turn=message.rates[1])

    def drop(self) -> None:
        """Keep the drive: it is no goal."""

    def clear(self) -> None:
        """Forget the drive."""
        self.stream.clear()


DriveCommands = BaseCommands | InsertionCommands
"""How the operator drives a mechanism as a whole."""


def drive_commands(cell: Cell) -> DriveCommands:
    """Return those of a cell's mechanism: of its base, or into its tunnels."""
    base = cell.config.mechanism.driven
    if base is None:
        return InsertionCommands.from_cell(cell)
    return BaseCommands(base, cell.config.timing.stream_timeout_s)


# --- Commands of the spare joints: a stream of their rate, or an arm angle to go to ---------------

STUCK_S: Final = 2.0
"""An angle that comes no nearer for so long is out of reach [s]."""
NEARER: Final = 1e-3
"""By this an angle has come nearer [rad]."""


class SelfMotionCommands:
    """How the operator moves the spare joints of one arm."""

    def __init__(
        self,
        timeout_s: float,
        spare: Callable[[], int] = int,
        most: float = 0.0,
        *,
        angled: bool = False,
    ) -> None:
        """Build it; `spare` says how many freedoms are spare now. With none all is refused.

        Rates are at most `most`: of the arm angle [rad/s] where the arm is `angled`, else in parts
        of its quickest [1].
        """
        self._spare, self._most, self._angled = spare, most, angled
        self.stream = Stream[m.SelfMotion](timeout_s, lambda message: message.rate != 0.0)
        self.goal: SelfMotionRequest | None = None
        """The arm angle that is gone to, or kept."""
        self._least, self._since_s = math.inf, 0.0

    def take(self, message: m.SelfMotion, now_s: float) -> bool:
        """Put a rate in force; return whether it asks for motion, which ends an angle.

        Raises `Refused`.
        """
        moves = message.rate != 0.0
        if moves:
            self._require_spare()
        if abs(message.rate) > self._most * (1 + 1e-9):
            unit = " rad/s of the arm angle" if self._angled else ", of 1 for the quickest"
            raise Refused(
                Why.OUT_OF_RANGE, f"rate: {message.rate:g}{unit}: at most {self._most:g} either way"
            )
        self.stream.take(message, now_s)
        if moves:
            self.drop()
        return moves

    def lead_to(self, message: m.ArmAngle, now_s: float) -> None:
        """Put an angle in force. Raises `Refused`."""
        self._require_spare()
        if not self._angled:
            why = "the arm has no arm angle: its axes make no shoulder, elbow and wrist"
            raise Refused(Why.UNKNOWN_MECHANISM, why)
        self.stream.clear()
        speed = min(message.speed or self._most, self._most)
        self.goal = SelfMotionRequest(speed, message.angle)
        self._least, self._since_s = math.inf, now_s

    def newest(self, now_s: float) -> SelfMotionRequest:
        """Return what is in force now."""
        if self.goal is not None or self.stream.message is None:
            return self.goal or UNASKED
        message = self.stream.newest(now_s)
        return UNASKED if message is None else SelfMotionRequest(message.rate)

    def look(self, state: HandState, now_s: float) -> bool | None:
        """Return whether the angle is reached, once: False where it is out of reach, and dropped.

        None as long as neither is so; `state` is how far it has come.
        """
        goal, left = self.goal, abs(state.left)
        if goal is None or goal.kept:
            return None
        if left <= REACHED:
            self.goal = goal._replace(kept=True)
            return True
        if left < self._least - NEARER:
            self._least, self._since_s = left, now_s
        elif now_s - self._since_s > STUCK_S:
            self.goal = None
            return False
        return None

    def drop(self) -> None:
        """Drop the angle."""
        self.goal = None

    def clear(self) -> None:
        """Drop angle and stream."""
        self.stream.clear()
        self.goal = None

    def _require_spare(self) -> None:
        if self._spare() < 1:
            raise Refused(Why.NO_SPARE_JOINT, "the arm has no spare joint: its task holds them all")


# --- Goals: where the arm is to go. They hold until they are replaced, cancelled or reached -------


class Goals:
    """The newest goal, of which there is one: a path, the pursuit of a master, or a posture."""

    def __init__(self, T_wrist_mrf: Pose) -> None:
        self.goal: Goal | None = None
        """Path or pursuit; poses in it are in World, or on `ground`."""
        self.ground = "world"
        """The frame that the goal is measured against."""
        self.T_wrist_goal = T_wrist_mrf
        """The point of the tool that is led to the goal: the MRF that it was commanded for."""
        self.paused = False
        self.posture: Array | None = None
        """Joint angles (n,) to go to [rad]."""
        self.posture_reached = False
        self.idle = True
        """Nothing was asked for since the arm was enabled."""
        self._serial = 0

    @property
    def at_rest(self) -> bool:
        """True where no self-motion is to lead the arm away: at a posture, or not asked at all."""
        return self.idle or self.posture_reached

    @property
    def pursuing(self) -> bool:
        """True while a master's pose leads the MRF."""
        return isinstance(self.goal, Pursuit)

    def next_serial(self) -> int:
        """Return a number that no goal has had."""
        self._serial += 1
        return self._serial

    def lead_to(self, goal: Goal, ground: str, T_wrist_goal: Pose) -> None:
        """Replace the goal by a path or a pursuit on a ground, for a point of the tool."""
        self.drop()
        self.goal, self.ground, self.T_wrist_goal = goal, ground, T_wrist_goal

    def take_posture(self, q: Array) -> None:
        """Replace the goal by a posture (n,) [rad]."""
        self.drop()
        self.posture = q

    def pursue(self, target: Pose | None) -> None:
        """Let a pursuit lead to a new target; None: nowhere, come to rest."""
        if isinstance(self.goal, Pursuit):
            self.goal = replace(self.goal, T_world_target=target)

    def drop(self) -> None:
        """Drop the goal, whatever it is."""
        self.goal = self.posture = None
        self.posture_reached = self.paused = False

    def leave_posture(self) -> None:
        """Give up a posture for a motion that begins where the arm is now."""
        self.posture, self.posture_reached = None, False

    def finish_posture(self) -> None:
        """End a posture that is reached: the other sources may act again."""
        self.posture, self.posture_reached = None, True

    def led_by_hand(self) -> None:
        """Note that a hand moves the tool, as a stick does: the arm is at no posture any more."""
        self.posture_reached = self.idle = False

    def control_path(self, request: PathRequest) -> None:
        """Pause, resume or abort the path. Raises `Refused` where none is under way."""
        if self.goal is None or self.pursuing:
            raise Refused(Why.NOT_NOW, "no path is under way")
        if request.action == "abort":
            self.goal = None
        self.paused = request.action == "pause"

    def restart_path(self) -> None:
        """Let the path to the target begin anew from where the arm is."""
        if self.goal is not None:
            self.goal = replace(self.goal, attempt=self.goal.attempt + 1)


# --- The wrench that the arm is to exert: its value, and the frame in whose axes it is given ------


class WrenchGoal:
    """A wrench at the MRF (6,) [N, N·m]; zero at first. It holds until replaced or cleared."""

    def __init__(self) -> None:
        self.value = np.zeros(6)
        self.frame = Frame.MRF

    def set(self, value: Array, expressed_in: Frame) -> None:
        """Put a wrench (6,) in the axes of a frame in force."""
        self.value, self.frame = value, expressed_in

    def cancel(self) -> None:
        """Exert nothing, in the same axes."""
        self.value = np.zeros(6)

    def carry_mrf(self, T_old_new: Pose, before: FrameTree) -> None:
        """Keep the same load when the MRF is redefined; `before` has the frames of before."""
        axes = None
        if self.frame is not Frame.MRF:
            axes = before.pose(self.frame, Frame.MRF).R
        self.value = wrench_kept(self.value, T_old_new, axes)

    def carry_crf(self, R_world_crf: Array, before: FrameTree) -> None:
        """Keep the same load when the CRF is redefined; `before` has the frames of before."""
        if self.frame is Frame.CRF:
            turn = R_world_crf.T @ before.pose("crf").R
            self.value = rotate_twist(turn, self.value)


# --- Checks of commands that are given joint by joint ---------------------------------------------


class JointCommands:
    """The joints of one cell, and the angles and rates that may be asked of them."""

    def __init__(self, names: tuple[str, ...], bounds: JointBounds, velocity: Array) -> None:
        self._names, self._velocity = names, velocity
        self._lower, self._upper = np.array(bounds.lower), np.array(bounds.upper)

    @classmethod
    def from_cell(cls, cell: Cell) -> Self:
        """Return those of a cell's mechanism."""
        joints, drives = cell.robot.joints, cell.config.mechanism.drives
        velocity = np.array([drive.max_velocity for drive in drives])
        return cls(tuple(j.name for j in joints), joint_bounds(joints, drives), velocity)

    def check_rates(self, rates: tuple[float, ...]) -> None:
        """Raise `Refused` for rates (n,) [rad/s] that no drive may be told."""
        asked = self._vector(rates, "rates")
        beyond = np.abs(asked) > self._velocity * (1 + 1e-9)
        if beyond.any():
            j = int(np.argmax(beyond))
            raise Refused(
                Why.OUT_OF_RANGE,
                f"rates: {self._names[j]} {asked[j]:g} rad/s, at most {self._velocity[j]:g}",
            )

    def angles(self, q: tuple[float, ...]) -> Array:
        """Return a posture (n,) [rad]. Raises `Refused` for one outside the joints' bounds."""
        asked = self._vector(q, "q")
        beyond = (asked < self._lower) | (asked > self._upper)
        if beyond.any():
            j = int(np.argmax(beyond))
            raise Refused(
                Why.OUT_OF_RANGE,
                f"q: {self._names[j]} {asked[j]:g} rad, between "
                f"{self._lower[j]:.4f} and {self._upper[j]:.4f}",
            )
        return asked

    def _vector(self, values: tuple[float, ...], field: str) -> Array:
        if len(values) != len(self._names):
            raise Refused(
                Why.WRONG_JOINTS, f"{field}: {len(values)} values for {len(self._names)} joints"
            )
        return np.array(values)


# --- Commands in force: streams with their age, goals, the desired wrench, settings and frames ----
#
# Streams are true only now and expire; goals stay until replaced, cancelled, or the lease ends.
# Nothing is queued: the newest command of a kind is the only one.

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
        self.reflector = reflector
        """Reflects forces to the handle of the lease's holder; None in a cell that reflects none.
        """
        self.dropped: list[tuple[str, str]] = []
        """Goals that another command ended under way, "posture" or "goal", and by which topic."""
        self._stream_timeout_s = stream_timeout_s
        self._stick = Stream[m.JoystickTwist](stream_timeout_s, lambda message: any(message.twist))
        self._jog = Stream[m.JointJog](stream_timeout_s, _drives)
        self.self_motion = SelfMotionCommands(stream_timeout_s)
        """Of an arm without a spare joint, unless its unit knows better."""
        self._take: dict[type[m.Message], Callable[..., None]] = {
            m.JoystickTwist: self._take_stick,
            m.JointJog: self._take_jog,
            m.SelfMotion: self._take_self_motion,
            m.ArmAngle: self._take_arm_angle,
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
            case m.SelfMotion() | m.ArmAngle():
                return False
            case motion.MasterPose():
                return self.goals.goal is not None
            case _:
                return not isinstance(message, m.CancelGoals)

    def _take_stick(self, message: m.JoystickTwist, now_s: float, T_world_mrf: Pose) -> None:
        # Raises before it is in force.
        axes = self.frames.tree(T_world_mrf).pose(message.expressed_in).R
        self._stick.take(message, now_s)
        if self.reflector is not None:
            self.reflector.hear(message.handle, now_s, axes)
        if any(message.twist):
            # Whoever moves the stick wants to steer, not to watch a posture being taken.
            self.goals.leave_posture()

    def _take_jog(self, message: m.JointJog, now_s: float, _T: Pose) -> None:
        self._joints.check_rates(message.rates)
        self._jog.take(message, now_s)
        self._drop_goals()

    def _take_self_motion(self, message: m.SelfMotion, now_s: float, _T: Pose) -> None:
        if self.self_motion.take(message, now_s):
            self._place_spare_joints()

    def _take_arm_angle(self, message: m.ArmAngle, now_s: float, _T: Pose) -> None:
        self.self_motion.lead_to(message, now_s)
        self._place_spare_joints()

    def _place_spare_joints(self) -> None:
        """Let no objective lead spare joints away from where an operator puts them."""
        self.goals.leave_posture()
        self.goals.idle = True

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
        if self.reflector is not None:
            self.reflector.hear(message.handle, now_s, tree.pose(message.expressed_in).R)
        if not self.master.take(message, now_s, axes, T, self.reflector):
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
        self.self_motion.drop()
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

    def protect_handle(self, protected: bool) -> None:
        """Protect the reflected force against delay, or not. Raises `Refused` if there is none."""
        if self.reflector is None:
            raise Refused(Why.NOT_NOW, "the cell reflects no forces")
        self.reflector.protected = protected

    def clear(self) -> None:
        """Drop every stream and goal: what was commanded before is dead.

        The view that is stored stays; the source that would drive to it goes back to its switch
        at start, so that no enable and no other operator sets the arm in motion unasked.
        """
        self._stick.clear()
        self._jog.clear()
        self._insertion.clear()
        self.self_motion.clear()
        self.settings.settle_vision()
        if self.reflector is not None:
            self.reflector.protected = True
        self._drop_goals()
        self.goals.idle = True
        self.wrench.set(np.zeros(6), m.Frame.MRF)

    def expired(self, now_s: float) -> list[str]:
        """Return the streams that fell silent while they asked for motion, and forget them."""
        streams: dict[str, Stream[Any]] = {
            "joystick": self._stick,
            "jog": self._jog,
            "drive": self._insertion.stream,
            "self_motion": self.self_motion.stream,
        }
        names = []
        for name, stream in streams.items():
            if stream.message is not None and stream.fell_silent(now_s):
                names.append(name)
        if self.master.target is not None and self.master.expired(now_s, self._stream_timeout_s):
            names.append("master_pose")
            self.goals.pursue(self.master.target)
        return names

    # --- what is in force now ------------------------------------------------------------------

    def in_force(self, now_s: float, T_world_mrf: Callable[[], Pose]) -> Inputs:
        """Return a tick's inputs as far as operators decide them.

        `T_world_mrf` tells where the command has the MRF, in World: it is asked only where
        something is given in the axes of a frame that the arm carries. What is measured is still to
        come.
        """
        goals, wrench, command = self.goals, self.wrench, None
        stick, jog, axes = self._stick.newest(now_s), None, None
        if self._jog.message is not None:
            jog = self._jog.newest(now_s)
        if wrench.frame is not Frame.MRF:
            axes = self.frames.axes(wrench.frame, T_world_mrf)
        twist = None if stick is None else self.master.scaled(np.array(stick.twist))
        if stick is not None and twist is not None:
            command = StickCommand(twist, self.frames.axes(stick.expressed_in, T_world_mrf))
        return Inputs(
            now_s,
            Intent.MOVE,
            NOT_MEASURED,
            self.settings.for_control(),
            stick=command,
            jog=None if jog is None else np.array(jog.rates),
            goal=goals.goal,
            paused=goals.paused,
            posture=goals.posture,
            at_posture=goals.at_rest,
            wrench_desired=wrench.value,
            R_world_wrench=axes,
            ground=self.ground(now_s),
            T_wrist_goal=goals.T_wrist_goal,
            drive=self._insertion.newest(now_s),
            self_motion=self.self_motion.newest(now_s),
        )

    def by_joint(self, now_s: float) -> bool:
        """Return whether joints are commanded themselves: jogged, or led to a posture."""
        if self.goals.posture is not None:
            return True
        return self._jog.message is not None and self._jog.newest(now_s) is not None

    def ground(self, now_s: float) -> str:
        """Return what motion is relative to: of the goal, else of the stick, else of the CRF."""
        if not self.frames.movable:
            return "world"
        if self.goals.goal is not None:
            return self.goals.ground
        stick = self._stick.newest(now_s)
        if stick is not None and any(stick.twist) and stick.relative_to in GROUNDS:
            return self.frames.ground(stick.relative_to)
        return self.frames.ground(self.frames.crf.on)

    @property
    def target(self) -> Pose | None:
        """Pose in World that the position source is to bring the MRF to, if there is any."""
        goals, frames = self.goals, self.frames
        T = None if goals.goal is None else goals.goal.T_world_target
        if T is None:
            return None
        if frames.T_wrist_mrf is not goals.T_wrist_goal:
            T = T @ (goals.T_wrist_goal.inverse() @ frames.T_wrist_mrf)
        return frames.in_world(goals.ground, T)
