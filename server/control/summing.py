"""The sources of the tick: what each asks of the MRF, every one always on.

The tick adds the twists up. What the force source reads, and what is taken off its reading, is
kept here too, because the sum and the watch over the sensor must agree about it.
"""

import math

import numpy as np

from .bleed import bleed
from .evolve import evolve
from .frames import GRAVITY, Array, Pose, rotate_twist
from .gains import GAIN_TIME_S
from .mechanism import Kinematics
from .parameters import Parameters
from .payload import Payload
from .sources.following import Following, FollowingState
from .sources.force import Force, load_of
from .sources.frames import Frames, FramesState
from .sources.joystick import Joystick, JoystickState
from .sources.position import Position, PositionState
from .sources.vision import Vision, VisionState
from .state import Inputs, Intent, Memory, Settings

_OFF = np.zeros(6)
_OFF.flags.writeable = False
_IDLE = FollowingState()
_AXES = np.eye(3)


class Summing:
    """The sources of one cell, and what they remember from tick to tick."""

    def __init__(self, p: Parameters) -> None:
        self._p = p
        T = p.period_s
        # Scratch: payload, bias and both as a load, of the tick before.
        self._hung: tuple[Payload | None, Array | None, Array] = (None, None, np.zeros(10))
        self._part = 1.0 - math.exp(-T / GAIN_TIME_S)
        self.joystick = Joystick(p.shaping_acceleration, p.shaping_jerk, T)
        self.position = Position(p.path_speed, p.shaping_acceleration, p.shaping_jerk, T)
        self.vision = Vision(p.vision_speed, p.shaping_acceleration, p.shaping_jerk, T)
        self.following = Following(p.impedance, T)
        self.force = Force(
            p.T_wrist_sensor or Pose.identity(),
            p.wrench_smoothing,
            T,
            p.wrench_calibration,
            p.wrench_inertia,
            p.limits.acceleration,
        )
        self.frames = Frames(p.shaping_acceleration, p.shaping_jerk, T)

    def measure(self, memory: Memory, inputs: Inputs, T_world_wrist: Pose) -> Memory:
        """Return the memory with the newest wrench in it, payload and bias taken off.

        `T_world_wrist` is measured, at the instant that the joints were.
        """
        load, place, free_fall = self._ramp_load(memory, inputs), T_world_wrist, GRAVITY
        if inputs.moved is not None:
            # Seen from a Base that moves: its news is too rough to be differentiated twice.
            base = inputs.moved.T_world_base_measured
            place = base.inverse() @ T_world_wrist
            free_fall = base.R.T @ (GRAVITY - inputs.moved.acceleration_at(T_world_wrist.p))
        force = self.force.measure(
            memory.force,
            inputs.wrench_sensor,
            load,
            place,
            inputs.time_s,
            inputs.wrench_age_s,
            free_fall,
        )
        return evolve(memory, force=force, load=load)

    def wrench_mrf(self, memory: Memory, T_wrist_mrf: Pose) -> Array | None:
        """Return what the arm exerts at and in the MRF (6,), None when stale."""
        return self.force.wrench_mrf(memory.force, T_wrist_mrf)

    def weight(self, T_world_mrf: Pose, settings: Settings) -> Array:
        """Return the sensor reading (6,) of the payload's weight with the MRF at a pose."""
        T_world_wrist = T_world_mrf @ settings.T_wrist_mrf.inverse()
        R_world_sensor = T_world_wrist.R @ self.force.T_wrist_sensor.R
        return self.force.weight(R_world_sensor, self._load(settings))

    def twists(
        self, memory: Memory, inputs: Inputs, k: Kinematics
    ) -> tuple[Memory, dict[str, Array]]:
        """Return each source's twist (6,) in World axes; every source is always on."""
        settings, gains = inputs.settings, memory.gains
        moving = inputs.intent is Intent.MOVE
        guided = moving and inputs.posture is None and inputs.jog is None
        stick = inputs.stick if moving else None
        joystick_state = memory.joystick if moving else JoystickState.idle()
        joystick, joystick_state = self.joystick.rate(
            joystick_state,
            None if stick is None else stick.twist,
            _AXES if stick is None else stick.R_world_axes,
            gains["joystick"],
        )
        carried = None
        if inputs.moved is not None:
            carried = inputs.moved.carries(inputs.ground, k.T_world_mrf.p)
        position, position_state = self._position(memory, inputs, k, carried)
        vision, vision_state = self.vision.rate(
            memory.vision if moving else VisionState.idle(),
            inputs.view if guided else None,
            k.T_world_wrist,
            k.T_world_mrf.p,
            gains["vision"],
            settings.speed_factor,
        )
        wrench = self.force.wrench_mrf(memory.force, settings.T_wrist_mrf)
        desired = inputs.wrench_desired
        if inputs.R_world_wrench is not None:
            desired = rotate_twist(k.T_world_mrf.R.T @ inputs.R_world_wrench, desired)
        force = self.force.rate(wrench, desired, gains["force"], k.T_world_mrf.R)
        following, following_state = _OFF, _IDLE
        if "following" in gains:
            following, following_state = self.following.rate(
                memory.following if guided else _IDLE,
                None if wrench is None else -wrench,
                gains["following"] if guided else _OFF,
                k.T_world_mrf,
                1.0 if memory.near is None else 1.0 - memory.near.alpha,
            )
        frames, frames_state = np.zeros(6), FramesState()
        if guided:
            frames, frames_state = self.frames.rate(
                memory.frames,
                joystick + position + vision + force + following,
                carried,
                (settings.T_wrist_mrf, settings.redefined, inputs.ground),
                k.T_world_wrist.R,
            )
        elif not moving:
            memory, force = self._bleed(memory, inputs, k, wrench, force)
        memory = evolve(
            memory,
            joystick=joystick_state,
            position=position_state,
            vision=vision_state,
            following=following_state,
            frames=frames_state,
        )
        return memory, {
            "joystick": joystick,
            "position": position,
            "vision": vision,
            "force": force,
            "following": following,
            "frames": frames,
        }

    def _position(
        self, memory: Memory, inputs: Inputs, k: Kinematics, carried: Array | None
    ) -> tuple[Array, PositionState]:
        """Follow the goal on its ground; `carried` (6,) is that ground's twist seen from Base."""
        settings = inputs.settings
        goal = None
        if inputs.intent is Intent.MOVE and inputs.posture is None:
            goal = inputs.goal
        ground = None if inputs.moved is None else inputs.moved.body(inputs.ground)
        T, axes = _on_path(k.T_world_mrf, memory.off_path), settings.T_world_crf.R
        twist = k.J @ memory.motion.dq
        if carried is not None:
            twist = twist - carried
        if ground is not None and goal is not None:
            there = ground.T.R.T
            T, axes = ground.T.inverse() @ T, there @ axes
            twist = rotate_twist(there, twist)
        rate, state = self.position.rate(
            memory.position,
            goal,
            T,
            twist,
            memory.gains["position"],
            axes,
            settings.speed_factor,
            inputs.paused,
        )
        return (rate if ground is None else rotate_twist(ground.T.R, rate)), state

    def _bleed(
        self, memory: Memory, inputs: Inputs, k: Kinematics, wrench: Array | None, force: Array
    ) -> tuple[Memory, Array]:
        """In HOLD, let FMA go on alone, inside a small leash, until contact is bled off."""
        if inputs.intent is not Intent.HOLD:
            return evolve(memory, hold=None, bleeding=False), np.zeros(6)
        at = k.T_world_wrist.p
        base = None if inputs.moved is None else inputs.moved.base.T
        if base is not None:
            at = base.R.T @ (at - base.p)
        hold = memory.hold if memory.hold is not None else at
        away = at - hold if base is None else base.R @ (at - hold)
        bled = bleed(
            memory.bleeding, wrench, force, away, self._p.hold_threshold, self._p.hold_leash
        )
        return evolve(memory, hold=hold, bleeding=bled.bleeding), bled.twist

    def _ramp_load(self, memory: Memory, inputs: Inputs) -> Array:
        """Return payload and bias in effect (10,): a tool picked up or a tare never jumps."""
        target = self._load(inputs.settings)
        if memory.load is None or inputs.intent is Intent.SEED:
            return target
        return memory.load + self._part * (target - memory.load)

    def _load(self, settings: Settings) -> Array:
        payload, bias = settings.payload or self._p.payload, settings.wrench_bias
        if payload is not self._hung[0] or bias is not self._hung[1]:
            self._hung = payload, bias, load_of(payload.mass, payload.com, bias)
        return self._hung[2]


def _on_path(T_world_mrf: Pose, off_path: Array | None) -> Pose:
    """Return where the MRF would be without the virtual link: what the path is held against."""
    return T_world_mrf if off_path is None else Pose(T_world_mrf.R, T_world_mrf.p - off_path)
