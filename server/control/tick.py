"""The tick: sum, resolve, avoid, limit, gate. The page to read first.

    sources ──► sum ──► tool speed ──► resolve ──► nearest allowed ──► limit ──► gate ──► actuate
       ▲                                  ▲               ▲              │
       └── poses, wrench                  └ objectives    └ joint room   └ verified stop

A pure function of its inputs: no I/O, no clock, no thread, no logging.
"""

import math
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from .actuation.actuation import Now
from .barriers.barriers import Allowed, State
from .barriers.collision import Guard, Watch
from .context import context_of, path_of_mrf, quantities, sample_of
from .evolve import evolve
from .mechanism.joint_motion import at_posture
from .mechanism.joint_rates import Around, Wish
from .mechanism.kinematics import Kinematics, Mechanism
from .mechanism.null_space.potential_field import Felt, further, on_path
from .mechanism.null_space.redundancy import SelfMotion
from .parameters import Parameters
from .proximity.capsules import Placed
from .spatial import Array, Pose, sizes
from .stages import Stages
from .state import Inputs, Intent, Memory, Output, Settings
from .stop.limiter import Limited
from .stop.trajectory import Motion, Stop
from .task.source import Granted

SLID = 0.99
"""A tool that does less than this part of what its path does has been turned off it [1]."""

LATELY = 0.9
"""Share that is left after a tick of the greatest acceleration that the tool was told [1]."""

STANDING = 1e-9
"""Joint rates [rad/s] and accelerations [rad/s²] below this are rounding, not motion."""


class _Asked(NamedTuple):
    """Joint rates asked for, and the twists behind them."""

    dq: Array
    twists: dict[str, Array]
    twist: Array
    scale: float
    limits: tuple[str, ...]
    sigma_min: float
    self_motion: SelfMotion
    field: Felt | None = None
    give_way: Array | None = None
    """Velocity along the virtual link (3,) [m/s]; None where it does not act."""
    by_joint: bool = False
    """The joints are commanded themselves: jogged, or led to a posture."""


class Control:
    """The control computation of one cell. Holds constants and scratch memory only."""

    def __init__(self, p: Parameters, mechanism: Mechanism, guard: Guard | None = None) -> None:
        """Build it; `guard` keeps clearances, None in a cell that has none to keep."""
        self.p = p
        self.mechanism = mechanism
        self.stages = Stages(p, mechanism, guard)

    def seed(self, q: Array) -> Memory:
        """Return the memory of an arm at rest at q (n,) [rad] that was told nothing yet."""
        rest = Motion.at_rest(q)
        return Memory(
            motion=rest,
            stop=self.stages.limiter.verified_stop(rest),
            sent=(q, q, q),
            pulls=self.stages.redundancy.pulls,
            task=self.stages.task.idle,
            retreat=None if self.stages.retreat is None else self.stages.retreat.start,
        )

    def pose_mrf(self, memory: Memory, T_wrist_mrf: Pose, T_world_base: Pose | None = None) -> Pose:
        """Return where the command has the MRF, in World."""
        return self.mechanism.pose_wrist(memory.motion.q, T_world_base) @ T_wrist_mrf

    def weight(self, T_world_mrf: Pose, settings: Settings) -> Array:
        """Return the sensor reading (6,) of the payload's weight with the MRF at a pose."""
        mrf, payload, bias = settings.T_wrist_mrf, settings.payload, settings.wrench_bias
        return self.stages.wrist.weight(T_world_mrf, mrf, payload, bias)

    def tick(self, memory: Memory, inputs: Inputs) -> tuple[Memory, Output]:
        """Return the next memory and what to send: one period of control."""
        moved = inputs.moved
        T_world_wrist_measured = self.mechanism.pose_wrist(
            inputs.q_measured, None if moved is None else moved.T_world_base_measured
        )
        memory = self._measure(memory, inputs, T_world_wrist_measured)
        if inputs.intent is Intent.SEED:
            q = inputs.q_measured
            if inputs.energised is not None:
                q = np.where(inputs.energised, memory.motion.q, q)
            memory = evolve(self.seed(q), torque=memory.torque, wrist=memory.wrist)
        kinematics = self.mechanism.kinematics(
            memory.motion.q,
            inputs.settings.T_wrist_mrf,
            None if moved is None else moved.base.T,
        )
        memory = self._tune(memory, inputs, kinematics)
        placed = None
        if self.stages.capsules is not None and inputs.settings.avoid:
            placed = self.stages.capsules.place(
                memory.motion.q[None], None if moved is None else moved.base.T
            )
        mrf = inputs.settings.T_wrist_mrf
        wrench = self.stages.wrist.wrench_mrf(memory.wrist, mrf)
        hand = self.stages.wrist.hand_mrf(memory.wrist, mrf)
        memory, asked = self._ask(memory, inputs, kinematics, placed, wrench, hand)
        memory, dq = self._give_way(memory, inputs, kinematics, asked.dq)
        error = memory.sent[1] - inputs.q_measured
        allowed = self.stages.allow.nearest(
            dq,
            kinematics,
            State(
                motion=memory.motion,
                error=error,
                way=memory.sent[1] - memory.sent[2],
                levels=memory.levels,
                resistance=memory.resistance,
                # An arm that may not move gives way at most, and is not held up.
                may_move=memory.moving_since_s is not None,
                speed_factor=inputs.settings.speed_factor,
                T_wrist_mrf=inputs.settings.T_wrist_mrf,
                keep_clear=inputs.settings.avoid,
                scene=inputs.scene,
                base=None if moved is None else moved.base,
                placed=placed,
                by_joint=asked.by_joint,
                ordered=self.stages.allow.guard is None or self._ordered(asked.twists, inputs),
            ),
        )
        limited = self._limit(memory, inputs, allowed)
        refusal = self.stages.gate.refusal(limited.motion.q, memory.sent)
        actuated = self.stages.actuate(
            memory.torque,
            Now(
                inputs.q_measured,
                error,
                memory.motion,
                limited.motion,
                kinematics,
                None if hand is None else -hand,
                inputs.settings.T_wrist_mrf,
                inputs.time_s,
                inputs.intent is Intent.SEED,
                memory.wrist.load,
            ),
        )
        scale, pace = asked.scale * allowed.scale, asked.scale * allowed.pace
        memory = evolve(
            memory,
            levels=allowed.levels,
            torque=actuated.state,
            resistance=allowed.resistance,
            **self._moved_on(memory, limited, asked, scale, pace, kinematics),
        )
        return memory, Output(
            q=limited.motion.q,
            dq=limited.motion.dq,
            command=actuated.command,
            refusal=refusal or actuated.refusal,
            at_rest=limited.motion.stands(STANDING),
            following_error=error,
            T_world_mrf=kinematics.T_world_mrf,
            T_world_mrf_measured=T_world_wrist_measured @ inputs.settings.T_wrist_mrf,
            T_wrist_mrf=inputs.settings.T_wrist_mrf,
            wrench_mrf=wrench,
            twists=asked.twists,
            twist=asked.twist,
            scale=scale,
            limits=asked.limits
            + allowed.limits
            + (("verified_stop",) if limited.stopped else ())
            + actuated.limits,
            stop_worsened=limited.worsened,
            shown=allowed.shown,
            near=memory.near,
            sigma_min=asked.sigma_min,
            gains=memory.task.gains,
            pulls=memory.pulls,
            self_motion=asked.self_motion,
            at_goal=self._at_goal(memory, inputs),
            bleeding=memory.task.force.bleeding,
            path=memory.task.position.progress,
            T_world_path=path_of_mrf(inputs, memory.task.position.T_world_path),
            field=asked.field,
            off_path=memory.task.off_path,
        )

    def _measure(self, memory: Memory, inputs: Inputs, T_world_wrist: Pose) -> Memory:
        """Return the memory with the newest wrench in it; the Wrist was measured at a pose."""
        wrist, settings = self.stages.wrist, inputs.settings
        measured = wrist.measure(
            memory.wrist,
            sample_of(inputs),
            wrist.load(settings.payload, settings.wrench_bias),
            T_world_wrist,
            inputs.time_s,
            inputs.moved,
            memory.quickness,
            at_once=inputs.intent is Intent.SEED,
        )
        return evolve(memory, wrist=measured)

    # --- gains -------------------------------------------------------------------------------

    def _tune(self, memory: Memory, inputs: Inputs, k: Kinematics) -> Memory:
        """Return the memory with the gains in effect: scheduled, and ramped while moving."""
        settings, moving = inputs.settings, inputs.intent is Intent.MOVE
        pulls = settings.pulls or self.stages.redundancy.pulls
        since_s = memory.moving_since_s if memory.moving_since_s is not None else inputs.time_s
        task = self.stages.task.tuned(
            memory.task,
            settings.gains,
            lambda: quantities(memory, inputs, k, inputs.time_s - since_s),
            moving,
            settings.at_once,
        )
        if moving and memory.task.gains:
            pulls = self.stages.redundancy.ramped(memory.pulls, pulls, self.stages.task.part)
        return evolve(memory, task=task, pulls=pulls, moving_since_s=since_s if moving else None)

    # --- what is asked for -------------------------------------------------------------------

    def _ask(
        self,
        memory: Memory,
        inputs: Inputs,
        k: Kinematics,
        placed: Placed | None,
        wrench: Array | None,
        hand: Array | None,
    ) -> tuple[Memory, _Asked]:
        """Sum the sources and resolve the sum, or take joint rates where those are commanded."""
        base = None if inputs.moved is None else inputs.moved.base.T
        if self.p.priority is not None:
            near = self.p.priority.look(memory.motion.q, inputs.scene, memory.near, base)
            memory = evolve(memory, near=near)
        context = context_of(
            memory, inputs, k, self.stages.wrist, self.p.T_wrist_tool.p, wrench, hand
        )
        task, twists = self.stages.task.twists(memory.task, context)
        memory = evolve(memory, task=task)
        twist = np.zeros(6)
        for part in twists.values():
            twist = twist + part
        joint_rates = None
        if inputs.intent is Intent.MOVE:
            joint_rates = self.stages.joint_motion.rates(
                memory.motion.q, inputs.jog, inputs.posture, inputs.settings.speed_factor
            )
        if joint_rates is not None:
            twists = {name: np.zeros(6) for name in twists}
            twist = k.J @ joint_rates
        s_tool = self._tool_share(twist, inputs.settings.speed_factor)
        limits: tuple[str, ...] = ("tool_speed",) if s_tool < 1.0 else ()
        self_motion = self.stages.redundancy.none()
        if joint_rates is not None:
            dq = s_tool * joint_rates
            return memory, _Asked(
                dq, twists, twist, s_tool, limits, math.nan, self_motion, by_joint=True
            )
        wish = Wish(
            s_tool * twist,
            inputs.settings.T_wrist_mrf,
            memory.pulls,
            inputs.settings.speed_factor,
            inputs.intent is Intent.MOVE and not inputs.at_posture,
            memory.task.off_path,
            inputs.goal is not None,
        )
        around = Around(inputs.scene, memory.near, base, placed)
        found = self.stages.resolver.rates(memory.motion.q, k, wish, around)
        if found.singular:
            limits += ("singularity",)
        return memory, _Asked(
            found.dq,
            twists,
            twist,
            s_tool,
            limits,
            found.sigma_min,
            found.self_motion,
            found.field,
            found.give_way,
        )

    def _give_way(
        self, memory: Memory, inputs: Inputs, k: Kinematics, dq: Array
    ) -> tuple[Memory, Array]:
        """Add what gives way after a touch to joint rates dq (n,)."""
        if self.stages.retreat is None or memory.retreat is None:
            return memory, dq
        held = inputs.intent is Intent.HOLD
        state, dq = self.stages.retreat.step(
            memory.retreat, memory.motion.q, dq, k.J, inputs.pushed, inputs.time_s, held
        )
        return memory if state is memory.retreat else evolve(memory, retreat=state), dq

    def _ordered(self, twists: dict[str, Array], inputs: Inputs) -> bool:
        """Return whether anything but accommodation tells the arm to move.

        News of obstacles needs no lease: an arm that nobody tells to move shall not be led away by
        it.
        """
        asked = inputs.jog is not None or inputs.posture is not None
        return asked or bool(inputs.wrench_desired.any()) or self.stages.task.orders(twists)

    def _tool_share(self, twist: Array, factor: float) -> float:
        """Return the share (0 to 1) of a twist (6,) that the tool's speed bounds allow."""
        v, w = sizes(twist)
        limits = self.p.limits
        return min(
            1.0,
            factor * limits.speed / max(v, 1e-12),
            factor * limits.angular_speed / max(w, 1e-12),
        )

    def _limit(self, memory: Memory, inputs: Inputs, allowed: Allowed) -> Limited:
        """Bound acceleration and jerk, and keep a verified stop at hand."""
        if inputs.intent is Intent.STOP:
            return self.stages.limiter.go_on(memory.stop)
        if inputs.intent is Intent.SEED:
            return Limited(memory.motion, memory.stop, False)
        guard, watch = self.stages.allow.guard, allowed.watch
        judge = None
        if guard is not None and watch is not None:
            judge = partial(_shortfall, guard, watch)
        factor = inputs.settings.speed_factor
        return self.stages.limiter.step(memory.motion, memory.stop, allowed.dq, factor, judge)

    # --- what is remembered ------------------------------------------------------------------

    def _moved_on(
        self,
        memory: Memory,
        limited: Limited,
        asked: _Asked,
        scale: float,
        pace: float,
        k: Kinematics,
    ) -> dict[str, Any]:
        """Return what the step changes; the tool did `scale` of what was asked, a path `pace`."""
        granted = 0.0 if limited.stopped else scale
        return {
            "motion": limited.motion,
            "stop": limited.stop,
            "quickness": max(sizes(k.J @ limited.motion.ddq)[0], LATELY * memory.quickness),
            "sent": (limited.motion.q, memory.sent[0], memory.sent[1]),
            "task": evolve(
                self.stages.task.advanced(
                    memory.task,
                    Granted(
                        granted,
                        0.0 if limited.stopped else pace,
                        scale < SLID * pace,
                        asked.twist,
                        k.T_world_mrf,
                    ),
                ),
                off_path=further(memory.task.off_path, asked.give_way, granted * self.p.period_s),
            ),
        }

    def _at_goal(self, memory: Memory, inputs: Inputs) -> bool:
        if inputs.intent is not Intent.MOVE:
            return False
        if inputs.posture is not None:
            return at_posture(memory.motion.q, inputs.posture)
        return memory.task.position.at_goal and on_path(memory.task.off_path)


def _shortfall(guard: Guard, watch: Watch, stop: Stop) -> float:
    """Return by how much a stop breaks what the guard keeps [m]; 0 for not at all."""
    return guard.shortfall(watch, stop.to_go_s, stop.low, stop.high, stop.postures)
