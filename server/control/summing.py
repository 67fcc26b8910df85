"""The sources of the tick: what each asks of the MRF, every one always on.

The tick adds the twists up. What the force source reads, and what is taken off its reading, is
kept here too, because the sum and the watch over the sensor must agree about it.
"""

import math

import numpy as np

from .evolve import evolve
from .hold.bleed import bleed
from .mechanism.kinematics import Kinematics
from .mechanism.payload import Payload
from .parameters import Parameters
from .redefinition import carried, differ, goal_point, led
from .rigid_body import twist_at, wrench_to
from .spatial import GRAVITY, Array, Pose, rotate_twist
from .state import Inputs, Intent, Memory, Settings
from .task.gains import GAIN_TIME_S
from .task.sources.feedforward import About, Frames, FramesState
from .task.sources.following import Following, FollowingState
from .task.sources.force import Force, load_of
from .task.sources.joystick import Joystick, JoystickState
from .task.sources.position import Position
from .task.sources.vision import Vision, VisionState

OVERSHOOT = 2.0
"""A tool may be accelerated by this times what it was told: drives overshoot [1]."""

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
        self._most = (p.limits.speed, p.limits.angular_speed)
        self.frames = Frames(p.shaping_acceleration, p.shaping_jerk, self._most, T)

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
            OVERSHOOT * memory.quickness,
            inputs.wrench_mean,
        )
        return evolve(memory, force=force, load=load)

    def wrench_mrf(self, memory: Memory, T_wrist_mrf: Pose) -> Array | None:
        """Return what the arm exerts at and in the MRF (6,), None when stale."""
        return self.force.wrench_mrf(memory.force, T_wrist_mrf)

    def hand_mrf(self, memory: Memory, T_wrist_mrf: Pose) -> Array | None:
        """Return the same of the mean readings, for what a payload's own force would upset."""
        return self.force.hand_mrf(memory.force, T_wrist_mrf)

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
        memory = carried(memory, inputs, k, self._most, self._p.shaping_acceleration)
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
        ground = None
        if inputs.moved is not None:
            ground = inputs.moved.carries(inputs.ground, k.T_world_mrf.p)
        # What is shaped at a point of the tool that stays the same does not mind a new MRF.
        lever = k.T_world_wrist.R @ (self._p.T_wrist_tool.p - settings.T_wrist_mrf.p)
        R_crf = settings.T_world_crf.R
        position, position_state = led(self.position, memory, inputs, k, ground, R_crf)
        vision, vision_state = self.vision.rate(
            memory.vision if moving else VisionState.idle(),
            inputs.view if guided else None,
            k.T_world_wrist,
            k.T_world_mrf.p + lever,
            gains["vision"],
            settings.speed_factor,
        )
        if np.count_nonzero(lever):
            vision = twist_at(vision, -lever)
        wrench = self.force.wrench_mrf(memory.force, settings.T_wrist_mrf)
        desired = inputs.wrench_desired
        if inputs.R_world_wrench is not None:
            desired = rotate_twist(k.T_world_mrf.R.T @ inputs.R_world_wrench, desired)
        force = self.force.rate(wrench, desired, gains["force"], k.T_world_mrf.R)
        jump = self._jump(memory, inputs, k, ground, position, force, desired)
        following, following_state = _OFF, _IDLE
        if "following" in gains:
            hand = self.hand_mrf(memory, settings.T_wrist_mrf)
            following, following_state = self.following.rate(
                memory.following if guided else _IDLE,
                None if hand is None else -hand,
                gains["following"] if guided else _OFF,
                k.T_world_mrf,
                1.0 if memory.near is None else 1.0 - memory.near.alpha,
                memory.load,
            )
        frames, frames_state = np.zeros(6), FramesState()
        if guided:
            frames, frames_state = self.frames.rate(memory.frames, ground, jump, lever)
        elif not moving:
            memory, force = self._bleed(memory, inputs, k, wrench, force)
        memory = evolve(
            memory,
            joystick=joystick_state,
            position=position_state,
            vision=vision_state,
            following=following_state,
            frames=frames_state,
            about=About(
                settings.T_wrist_mrf,
                goal_point(inputs),
                None if inputs.goal is None else inputs.goal.serial,
                inputs.ground,
                R_crf,
                settings.redefined,
                position,
            ),
        )
        return memory, {
            "joystick": joystick,
            "position": position,
            "vision": vision,
            "force": force,
            "following": following,
            "frames": frames,
        }

    def _jump(
        self,
        memory: Memory,
        inputs: Inputs,
        k: Kinematics,
        ground: Array | None,
        position: Array,
        force: Array,
        desired: Array,
    ) -> Array | None:
        """Return what the sum was more before a redefinition (6,), None where there was none.

        Of what depends on the frames of now alone: the other sources' motion was carried on.
        """
        before, new = memory.about, inputs.settings
        if before is None or not memory.frames.leading:
            return None
        grounded = before.ground != inputs.ground
        other = differ(before.T_wrist_mrf, new.T_wrist_mrf)
        if not (grounded or other or before.redefined != new.redefined):
            return None
        jump, lever = np.zeros(6), k.T_world_wrist.R @ (new.T_wrist_mrf.p - before.T_wrist_mrf.p)
        if grounded and inputs.moved is not None and ground is not None:
            jump += inputs.moved.carries(before.ground, k.T_world_mrf.p) - ground
            if before.serial != (None if inputs.goal is None else inputs.goal.serial):
                jump += twist_at(before.position, lever) - position
        elif inputs.goal is not None and not np.array_equal(before.R_world_crf, new.T_world_crf.R):
            was, _ = led(self.position, memory, inputs, k, ground, before.R_world_crf)
            jump += was - position
        if other:
            T_old_new = before.T_wrist_mrf.inverse() @ new.T_wrist_mrf
            wrench = self.force.wrench_mrf(memory.force, before.T_wrist_mrf)
            R = k.T_world_wrist.R @ before.T_wrist_mrf.R
            was = self.force.rate(wrench, wrench_to(T_old_new, desired), memory.gains["force"], R)
            jump += twist_at(was, lever) - force
        return jump

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
