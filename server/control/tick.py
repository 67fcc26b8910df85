"""The tick: sum, resolve, avoid, limit, gate. The page to read first.

    sources ──► sum ──► tool speed ──► resolve ──► nearest allowed ──► limit ──► gate ──► q
       ▲                                  ▲               ▲              │
       └── poses, wrench                  └ objectives    └ joint room   └ verified stop

A pure function of its inputs: no I/O, no clock, no thread, no logging.
"""

import math
from dataclasses import dataclass

import numpy as np

from .avoidance.joint_room import JointRoom
from .avoidance.nearest import nearest
from .bleed import bleed
from .evolve import evolve
from .frames import Array, Pose
from .gains import GAIN_TIME_S, Gains, Quantities
from .gate import Gate
from .limit import Limited, Limiter
from .mechanism import Kinematics, Mechanism
from .parameters import Parameters
from .redundancy import Redundancy, SelfMotion
from .resolve import Travel, resolve
from .sources.force import Force, ForceState, load_of
from .sources.joystick import Joystick, JoystickState
from .sources.position import Position, PositionState
from .sources.vision import Vision, VisionState
from .state import Inputs, Intent, Memory, Output, Settings
from .trajectory import Motion

POSTURE_GAIN = 4.0
"""Approach to a joint posture close to it [1/s]."""

POSTURE_REACHED = 2e-4
"""A posture is reached within this angle of every joint [rad]."""

STANDING = 1e-9
"""Joint rates [rad/s] and accelerations [rad/s²] below this are rounding, not motion."""


@dataclass(frozen=True)
class _Asked:
    """Joint rates asked for, and the twists behind them."""

    dq: Array
    twists: dict[str, Array]
    twist: Array
    scale: float
    limits: tuple[str, ...]
    sigma_min: float
    self_motion: SelfMotion


class Control:
    """The control computation of one cell. Holds constants and scratch memory only."""

    def __init__(self, p: Parameters, mechanism: Mechanism) -> None:
        self.p = p
        self.mechanism = mechanism
        T = p.period_s
        self.joystick = Joystick(p.shaping_acceleration, p.shaping_jerk, T)
        self.position = Position(p.path_speed, p.shaping_acceleration, p.shaping_jerk, T)
        self.vision = Vision(p.vision_speed, p.shaping_acceleration, p.shaping_jerk, T)
        self.force = Force(
            p.T_wrist_sensor or Pose.identity(),
            p.wrench_smoothing,
            T,
            p.wrench_calibration,
            p.wrench_inertia,
            p.limits.acceleration,
        )
        self.gains = Gains(p.schedules, T)
        self.redundancy = Redundancy(p, mechanism)
        self.room = JointRoom(p.lower, p.upper, p.acceleration, p.jerk, p.velocity, p.leash, T)
        self.limiter = Limiter(p.lower, p.upper, p.acceleration, p.jerk, T)
        self.gate = Gate(p.joints, p.lower, p.upper, p.velocity, p.acceleration, p.jerk, T)

    def seed(self, q: Array) -> Memory:
        """Return the memory of an arm at rest at q (n,) [rad] that was told nothing yet."""
        rest = Motion.at_rest(q)
        return Memory(
            motion=rest,
            stop=self.limiter.verified_stop(rest),
            sent=(q, q, q),
            gains={},
            pulls=self.redundancy.pulls,
            joystick=JoystickState.idle(),
            position=PositionState(),
            vision=VisionState.idle(),
            force=ForceState(),
        )

    def pose_mrf(self, memory: Memory, T_wrist_mrf: Pose) -> Pose:
        """Return where the command has the MRF, in World."""
        return self.mechanism.pose_wrist(memory.motion.q) @ T_wrist_mrf

    def weight(self, T_world_mrf: Pose, settings: Settings) -> Array:
        """Return the sensor reading (6,) of the payload's weight with the MRF at a pose."""
        T_world_wrist = T_world_mrf @ settings.T_wrist_mrf.inverse()
        R_world_sensor = T_world_wrist.R @ self.force.T_wrist_sensor.R
        return self.force.weight(R_world_sensor, self._load(settings))

    def tick(self, memory: Memory, inputs: Inputs) -> tuple[Memory, Output]:
        """Return the next memory and what to send: one period of control."""
        T_world_wrist_measured = self.mechanism.pose_wrist(inputs.q_measured)
        load = self._ramp_load(memory, inputs)
        force = self.force.measure(
            memory.force,
            inputs.wrench_sensor,
            load,
            T_world_wrist_measured,
            inputs.time_s,
            inputs.wrench_age_s,
        )
        if inputs.intent is Intent.SEED:
            q = inputs.q_measured
            if inputs.energised is not None:
                q = np.where(inputs.energised, memory.motion.q, q)
            memory = self.seed(q)
        kinematics = self.mechanism.kinematics(memory.motion.q, inputs.settings.T_wrist_mrf)
        memory = self._tune(evolve(memory, force=force, load=load), inputs, kinematics)
        memory, asked = self._ask(memory, inputs, kinematics)
        error = memory.sent[1] - inputs.q_measured
        asked = self._allow(memory, inputs, kinematics, asked, error)
        limited = self._limit(memory, inputs, asked)
        refusal = self.gate.refusal(limited.motion.q, memory.sent)
        return self._remember(memory, inputs, limited, asked), Output(
            q=limited.motion.q,
            dq=limited.motion.dq,
            refusal=refusal,
            at_rest=max(np.abs(limited.motion.dq).max(), np.abs(limited.motion.ddq).max())
            < STANDING,
            following_error=error,
            T_world_mrf=kinematics.T_world_mrf,
            T_world_mrf_measured=T_world_wrist_measured @ inputs.settings.T_wrist_mrf,
            wrench_mrf=self.force.wrench_mrf(force, inputs.settings.T_wrist_mrf),
            twists=asked.twists,
            twist=asked.twist,
            scale=asked.scale,
            limits=asked.limits + (("verified_stop",) if limited.stopped else ()),
            sigma_min=asked.sigma_min,
            gains=memory.gains,
            pulls=memory.pulls,
            self_motion=asked.self_motion,
            at_goal=self._at_goal(memory, inputs),
            bleeding=memory.bleeding,
            path=memory.position.progress,
            T_world_path=memory.position.T_world_path,
        )

    # --- gains -------------------------------------------------------------------------------

    def _tune(self, memory: Memory, inputs: Inputs, k: Kinematics) -> Memory:
        """Return the memory with the gains in effect: scheduled, and ramped while moving."""
        settings, moving = inputs.settings, inputs.intent is Intent.MOVE
        pulls = settings.pulls or self.redundancy.pulls
        since_s = memory.moving_since_s if memory.moving_since_s is not None else inputs.time_s
        wrench = memory.force.wrench
        target = None if inputs.goal is None else inputs.goal.T_world_target
        way = None if target is None else target.p - k.T_world_mrf.p
        now = Quantities(
            contact_force=None if wrench is None else math.sqrt(float(wrench[:3] @ wrench[:3])),
            distance=None if way is None else math.sqrt(float(way @ way)),
            time=inputs.time_s - since_s,
        )
        gains = self.gains.scheduled(settings.gains, now)
        if moving and memory.gains.keys() == gains.keys():
            gains = self.gains.ramped(memory.gains, gains)
            pulls = self.redundancy.ramped(memory.pulls, pulls, self.gains.part)
        return evolve(memory, gains=gains, pulls=pulls, moving_since_s=since_s if moving else None)

    # --- what is asked for -------------------------------------------------------------------

    def _ask(self, memory: Memory, inputs: Inputs, k: Kinematics) -> tuple[Memory, _Asked]:
        """Sum the sources and resolve the sum, or take joint rates where those are commanded."""
        memory, twists = self._sum(memory, inputs, k)
        twist = np.zeros(6)
        for part in twists.values():
            twist = twist + part
        joint_rates = self._joint_rates(memory, inputs)
        if joint_rates is not None:
            twists = {name: np.zeros(6) for name in twists}
            twist = k.J @ joint_rates
        s_tool = self._tool_share(twist, inputs.settings.speed_factor)
        limits: tuple[str, ...] = ("tool_speed",) if s_tool < 1.0 else ()
        self_motion = self.redundancy.none()
        if joint_rates is not None:
            dq, sigma_min = s_tool * joint_rates, math.nan
        else:
            q, T_wrist_mrf = memory.motion.q, inputs.settings.T_wrist_mrf
            task = resolve(
                k.J,
                s_tool * twist,
                lambda step: self.mechanism.kinematics(q + step, T_wrist_mrf).J,
                self.p.resolve,
                Travel(q - self.p.lower, self.p.upper - q),
            )
            dq, sigma_min = task.dq, task.sigma_min
            if inputs.intent is Intent.MOVE and not inputs.at_posture:
                self_motion = self.redundancy.rate(
                    q, k.J, dq, task.null_projector, memory.pulls, inputs.settings.speed_factor
                )
                dq = dq + self_motion.dq
            if task.singular:
                limits += ("singularity",)
        return memory, _Asked(dq, twists, twist, s_tool, limits, sigma_min, self_motion)

    def _sum(
        self, memory: Memory, inputs: Inputs, k: Kinematics
    ) -> tuple[Memory, dict[str, Array]]:
        """Return each source's twist (6,) in World axes; every source is always on."""
        settings, gains = inputs.settings, memory.gains
        moving = inputs.intent is Intent.MOVE
        stick = inputs.stick if moving else None
        joystick_state = memory.joystick if moving else JoystickState.idle()
        joystick, joystick_state = self.joystick.rate(
            joystick_state,
            None if stick is None else stick.twist,
            np.eye(3) if stick is None else stick.R_world_axes,
            gains["joystick"],
        )
        position, position_state = self.position.rate(
            memory.position,
            inputs.goal if moving and inputs.posture is None else None,
            k.T_world_mrf,
            k.J @ memory.motion.dq,
            gains["position"],
            settings.T_world_crf.R,
            settings.speed_factor,
            inputs.paused,
        )
        vision, vision_state = self.vision.rate(
            memory.vision if moving else VisionState.idle(),
            inputs.view if moving and inputs.posture is None and inputs.jog is None else None,
            k.T_world_wrist,
            k.T_world_mrf.p,
            gains["vision"],
            settings.speed_factor,
        )
        wrench = self.force.wrench_mrf(memory.force, settings.T_wrist_mrf)
        force = self.force.rate(wrench, inputs.wrench_desired, gains["force"], k.T_world_mrf.R)
        memory = evolve(
            memory, joystick=joystick_state, position=position_state, vision=vision_state
        )
        if not moving:
            memory, force = self._bleed(memory, inputs, k, wrench, force)
        return memory, {
            "joystick": joystick,
            "position": position,
            "vision": vision,
            "force": force,
        }

    def _bleed(
        self, memory: Memory, inputs: Inputs, k: Kinematics, wrench: Array | None, force: Array
    ) -> tuple[Memory, Array]:
        """In HOLD, let FMA go on alone, inside a small leash, until contact is bled off."""
        if inputs.intent is not Intent.HOLD:
            return evolve(memory, hold=None, bleeding=False), np.zeros(6)
        hold = memory.hold if memory.hold is not None else k.T_world_wrist.p
        away = k.T_world_wrist.p - hold
        bled = bleed(memory.bleeding, wrench, force, away, self.p.hold_threshold, self.p.hold_leash)
        return evolve(memory, hold=hold, bleeding=bled.bleeding), bled.twist

    def _joint_rates(self, memory: Memory, inputs: Inputs) -> Array | None:
        """Return joint rates (n,) where joints are commanded directly: jog, then posture."""
        if inputs.intent is not Intent.MOVE:
            return None
        if inputs.jog is not None:
            return inputs.jog
        if inputs.posture is None:
            return None
        error = inputs.posture - memory.motion.q
        size = np.maximum(np.abs(error), 1e-9)
        fastest = np.minimum(
            self.room.approach(size), inputs.settings.speed_factor * self.p.velocity
        )
        return error * min(POSTURE_GAIN, float((fastest / size).min()))

    def _tool_share(self, twist: Array, factor: float) -> float:
        """Return the share (0 to 1) of a twist (6,) that the tool's speed bounds allow."""
        v = math.sqrt(float(twist[:3] @ twist[:3]))
        w = math.sqrt(float(twist[3:] @ twist[3:]))
        limits = self.p.limits
        return min(
            1.0,
            factor * limits.speed / max(v, 1e-12),
            factor * limits.angular_speed / max(w, 1e-12),
        )

    # --- what is allowed ---------------------------------------------------------------------

    def _allow(
        self, memory: Memory, inputs: Inputs, k: Kinematics, asked: _Asked, error: Array
    ) -> _Asked:
        """Scale to the joint speed bounds, then find the nearest rates that keep every barrier."""
        V = inputs.settings.speed_factor * self.p.velocity
        limits = asked.limits
        share = 1.0 / max(1.0, float((np.abs(asked.dq) / V).max()))
        if share < 1.0:
            limits += ("joint_speed",)
        dq = np.clip(share * asked.dq, -V, V)  # rounding is no reason to name a limit
        room = self.room.limits(memory.motion.q)
        leash = self.room.leash(error)
        low = np.maximum(np.maximum(room.low, leash.low), -V)
        high = np.minimum(np.minimum(room.high, leash.high), V)
        low, high = np.minimum(low, high), np.maximum(low, high)
        if ((dq < low) | (dq > high)).any():
            limits += self._reasons(dq, room.low, room.high, "joint_limit")
            limits += self._reasons(dq, leash.low, leash.high, "leash")
            found = nearest(dq, k.J, low, high, V, self.p.resolve.characteristic_length)
            dq, share = found.dq, share * found.share
        return evolve(asked, dq=dq, scale=asked.scale * share, limits=limits)

    def _reasons(self, dq: Array, low: Array, high: Array, name: str) -> tuple[str, ...]:
        beyond = (dq < low) | (dq > high)
        return tuple(f"{name}:{self.p.joints[i]}" for i in np.flatnonzero(beyond))

    def _limit(self, memory: Memory, inputs: Inputs, asked: _Asked) -> Limited:
        """Bound acceleration and jerk, and keep a verified stop at hand."""
        if inputs.intent is Intent.STOP:
            return self.limiter.go_on(memory.stop)
        if inputs.intent is Intent.SEED:
            return Limited(memory.motion, memory.stop, False)
        return self.limiter.step(memory.motion, memory.stop, asked.dq, inputs.settings.speed_factor)

    # --- what is remembered ------------------------------------------------------------------

    def _ramp_load(self, memory: Memory, inputs: Inputs) -> Array:
        """Return payload and bias in effect (10,): a tool picked up or a tare never jumps."""
        target = self._load(inputs.settings)
        if memory.load is None or inputs.intent is Intent.SEED:
            return target
        return memory.load + (1.0 - math.exp(-self.p.period_s / GAIN_TIME_S)) * (
            target - memory.load
        )

    def _load(self, settings: Settings) -> Array:
        payload = settings.payload or self.p.payload
        return load_of(payload.mass, payload.com, settings.wrench_bias)

    def _remember(self, memory: Memory, inputs: Inputs, limited: Limited, asked: _Asked) -> Memory:
        granted = 0.0 if limited.stopped else asked.scale
        return evolve(
            memory,
            motion=limited.motion,
            stop=limited.stop,
            sent=(limited.motion.q, memory.sent[0], memory.sent[1]),
            position=self.position.advance(memory.position, granted),
            hold=memory.hold if inputs.intent is Intent.HOLD else None,
        )

    def _at_goal(self, memory: Memory, inputs: Inputs) -> bool:
        if inputs.intent is not Intent.MOVE:
            return False
        if inputs.posture is not None:
            return bool(np.abs(inputs.posture - memory.motion.q).max() < POSTURE_REACHED)
        return memory.position.at_goal
