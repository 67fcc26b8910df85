"""What the operator has ordered: streams with their age, goals, and settings.

Streams are true only now and expire; goals stay until replaced, cancelled, or the lease ends.
Nothing is queued: the newest order of a kind is the only one.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from ..config.load import Cell
from ..protocols import messages as m
from .admission import Refused, Why
from .control.frames import Array, Pose, rotation_rpy
from .control.sources.position import PathGoal
from .control.state import Settings, StickCommand

StreamT = TypeVar("StreamT", m.JoystickTwist, m.JointJog)


@dataclass(frozen=True)
class _Stream(Generic[StreamT]):
    """The newest message of a stream, and when it came."""

    message: StreamT
    since_s: float


class Orders:
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
        self._postures = {k: np.array(q) for k, q in config.mechanism.postures.items()}
        base = config.mechanism.T_world_base
        self._T_world_base = Pose.from_xyz_rpy(base.xyz, base.rpy)
        self._stream_timeout_s = config.timing.stream_timeout_s
        mrf, crf = config.mechanism.T_wrist_mrf, config.T_world_crf
        self.T_wrist_mrf = Pose.from_xyz_rpy(mrf.xyz, mrf.rpy)
        self.T_world_crf = Pose.from_xyz_rpy(crf.xyz, crf.rpy)
        sources = config.sources
        self.gains = {
            "joystick": np.array(sources.joystick.gain),
            "position": np.array(sources.position.gain),
            "vision": np.array(sources.vision.gain),
            "force": np.array(sources.force.gain),
        }
        self.on = {
            "joystick": sources.joystick.enabled,
            "position": sources.position.enabled,
            "vision": sources.vision.enabled and bool(config.cameras),
            "force": sources.force.enabled and config.mechanism.force_torque is not None,
        }
        self._vision_on = self.on["vision"]
        sensor = config.mechanism.force_torque
        self.wrench_bias = np.zeros(6) if sensor is None else -np.array(sensor.bias)
        self.speed_factor = config.limits.speed_factor
        self._stick: _Stream[m.JoystickTwist] | None = None
        self._jog: _Stream[m.JointJog] | None = None
        self._serial = 0
        self.goal: PathGoal | None = None
        self.posture: Array | None = None
        self.posture_reached = False
        self.wrench_desired = np.zeros(6)
        self._take: dict[type[m.Message], Callable[..., None]] = {
            m.JoystickTwist: self._take_stick,
            m.JointJog: self._take_jog,
            m.PositionTarget: self._take_target,
            m.PostureMove: self._take_posture,
            m.DesiredWrench: self._take_wrench,
            m.CancelGoals: self._take_cancel,
        }

    # --- taking orders -----------------------------------------------------------------------

    def take(self, message: m.Command, now_s: float, T_world_mrf: Pose) -> None:
        """Put a command in force. Raises `Refused` where it does not fit this cell."""
        self._take[type(message)](message, now_s, T_world_mrf)

    def clear(self) -> None:
        """Drop every stream and goal: what was ordered before is dead.

        The view that is stored stays; the source that would drive to it goes back to its switch
        at start, so that no enable and no other operator sets the arm in motion unasked.
        """
        self._stick = self._jog = None
        self.on["vision"] = self._vision_on
        self._drop_goals()
        self.wrench_desired = np.zeros(6)

    def finish_posture(self) -> None:
        """The posture is reached: the other sources may act again."""
        self.posture = None
        self.posture_reached = True

    def _drop_goals(self) -> None:
        self.goal = self.posture = None
        self.posture_reached = False

    def _take_stick(self, message: m.JoystickTwist, now_s: float, _T: Pose) -> None:
        self._stick = _Stream(message, now_s)
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
        axes = self._frame(message.expressed_in or message.relative_to, T_world_mrf)
        origin = self._frame(message.relative_to, T_world_mrf)
        turn = axes.R @ rotation_rpy(*message.rpy) @ axes.R.T
        target = Pose(turn @ origin.R, origin.p + axes.R @ np.array(message.xyz))
        self._drop_goals()
        self._serial += 1
        self.goal = PathGoal(target, self._serial, message.speed)

    def _take_posture(self, message: m.PostureMove, _now_s: float, _T: Pose) -> None:
        if message.posture is not None:
            if message.posture not in self._postures:
                raise Refused(
                    Why.UNKNOWN_POSTURE,
                    f"{message.posture!r} is none of {', '.join(self._postures)}",
                )
            q = self._postures[message.posture]
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

    def _take_wrench(self, message: m.DesiredWrench, _now_s: float, _T: Pose) -> None:
        self.wrench_desired = np.array(message.wrench)

    def _take_cancel(self, _message: m.CancelGoals, _now_s: float, _T: Pose) -> None:
        self._drop_goals()
        self.wrench_desired = np.zeros(6)

    def _joint_vector(self, values: tuple[float, ...], field: str) -> Array:
        if len(values) != self._n:
            raise Refused(Why.WRONG_JOINTS, f"{field}: {len(values)} values for {self._n} joints")
        return np.array(values)

    # --- settings ----------------------------------------------------------------------------

    def set_frame(self, request: m.FrameRequest) -> None:
        """Redefine the MRF or the CRF. A target pose under way was for the old MRF: it ends."""
        pose = Pose.from_xyz_rpy(request.xyz, request.rpy)
        if request.frame == "crf":
            self.T_world_crf = pose
        else:
            self.T_wrist_mrf = pose
            self.goal = None

    def settings(self) -> Settings:
        """Return what the tick shall use now."""
        off = np.zeros(6)
        return Settings(
            gains={name: gain if self.on[name] else off for name, gain in self.gains.items()},
            T_wrist_mrf=self.T_wrist_mrf,
            T_world_crf=self.T_world_crf,
            wrench_bias=self.wrench_bias,
            speed_factor=self.speed_factor,
        )

    # --- what is in force now ----------------------------------------------------------------

    def stick(self, now_s: float, T_world_mrf: Pose) -> StickCommand | None:
        """Return the stick's twist, or None once its news is too old."""
        stream = self._fresh(self._stick, now_s)
        if stream is None:
            return None
        axes = self._frame(stream.message.expressed_in, T_world_mrf).R
        return StickCommand(np.array(stream.message.twist), axes)

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
        return names

    def restart_path(self) -> None:
        """Let the path to the target begin anew from where the arm is."""
        if self.goal is not None:
            self._serial += 1
            self.goal = replace(self.goal, serial=self._serial)

    def _fresh(self, stream: _Stream[StreamT] | None, now_s: float) -> _Stream[StreamT] | None:
        if stream is None or now_s - stream.since_s > self._stream_timeout_s:
            return None
        return stream

    def _frame(self, frame: m.Frame, T_world_mrf: Pose) -> Pose:
        match frame:
            case m.Frame.WORLD:
                return Pose.identity()
            case m.Frame.BASE:
                return self._T_world_base
            case m.Frame.MRF:
                return T_world_mrf
            case m.Frame.CRF:
                return self.T_world_crf
