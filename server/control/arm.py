"""One mechanism with its task: what it is asked for in a tick, and what became of that."""

import math
from typing import Final, Self

from ...config.load import Cell
from .actuation.actuation import Now
from .asking import ArmController, ArmMeasurement, DesiredRates, Stages, path_of_mrf
from .backbone.insertion import BackboneArm
from .barriers.barriers import Allowed, Clear
from .barriers.clearance import BarrierInputs
from .bodies.body import Builder, SerialArm
from .bodies.wheels import WheeledArm
from .compiled import evolve
from .hold import MOVED
from .mechanism.field import advance_offset, on_path
from .mechanism.joint_rates import at_posture
from .mechanism.model import Kinematics, Mechanism
from .parameters import Parameters
from .spatial import Array, Pose, sizes
from .state import Inputs, Intent, Memory, Output, Settings
from .stop.limiter import Limited
from .task.source import Granted
from .task.task import TaskMemory

SLID = 0.99
"""A tool that does less than this part of what its path does has been turned off it [1]."""

LATELY = 0.9
"""Share that is left after a tick of the greatest acceleration that the tool was told [1]."""

STANDING = 1e-9
"""Joint rates [rad/s] and accelerations [rad/s²] below this are rounding, not motion."""

BODIES: Final = (BackboneArm, WheeledArm, SerialArm)
"""Kinds of bodies; a mechanism's is the first that the cell has a section for."""


class Arm:
    """The control computation of one mechanism and its task."""

    def __init__(self, p: Parameters, mechanism: Mechanism, build: Builder = SerialArm) -> None:
        """Build it; `build` makes its body."""
        self.p = p
        self.mechanism = mechanism
        self.stages = Stages(p, mechanism, build)
        self.body = self.stages.body
        self.asking = ArmController(p, mechanism, self.stages)

    @classmethod
    def of(cls, cell: Cell) -> Self:
        """Build that of a cell's only mechanism. Raises `ConfigError`."""
        p, mechanism = Parameters.from_cell(cell), Mechanism.from_cell(cell)
        builders = (kind.builder(cell) for kind in BODIES)
        return cls(p, mechanism, next(build for build in builders if build is not None))

    def seed(self, q: Array) -> Memory:
        """Return the memory of an arm at rest at q (n,) [rad] that was told nothing yet."""
        return self.asking.seed(q)

    def pose_mrf(self, memory: Memory, T_wrist_mrf: Pose, T_world_base: Pose | None = None) -> Pose:
        """Return where the command has the MRF, in World."""
        return self.mechanism.pose_wrist(memory.motion.q, T_world_base) @ T_wrist_mrf

    def weight(self, T_world_mrf: Pose, settings: Settings) -> Array:
        """Return the sensor reading (6,) of the payload's weight with the MRF at a pose."""
        mrf, payload, bias = settings.T_wrist_mrf, settings.payload, settings.wrench_bias
        return self.stages.wrist.weight(T_world_mrf, mrf, payload, bias)

    def locked_joints(self, memory: Memory) -> dict[str, float]:
        """Return the angles of joints that stand and do not follow, by name [rad].

        Looked for where an arm goes through a tunnel, and cannot leave its curve.
        """
        locked = None if memory.insertion is None else memory.insertion.locked
        if locked is None:
            return {}
        each = zip(self.p.joints.names, locked.tolist(), strict=True)
        return {name: angle for name, angle in each if not math.isnan(angle)}

    def before_barriers(
        self,
        memory: Memory,
        inputs: Inputs,
        seen: ArmMeasurement,
        asked: DesiredRates,
        beside: bool,
    ) -> BarrierInputs:
        """Return what the barriers have to know; `beside` tells whether clearances are kept."""
        return BarrierInputs(
            dq=asked.dq,
            kinematics=seen.kinematics,
            motion=memory.motion,
            error=seen.error,
            way=memory.sent[1] - memory.sent[2],
            resistance=memory.resistance,
            # An arm that may not move gives way at most, and is not held up.
            may_move=memory.moving_since_s is not None,
            T_wrist_mrf=inputs.settings.T_wrist_mrf,
            together=asked.found.synchronized,
            led=asked.found.wheels_commanded,
            path=self.body.path(seen.kinematics, inputs.ground == "base"),
            by_joint=asked.by_joint,
            standing=asked.found.n_locked,
            ordered=not beside or self.asking.ordered(asked.twists, inputs),
            makes_way=asked.stance.makes_way,
            tool_stays=asked.stance.tool_stays,
        )

    def finish(
        self,
        memory: Memory,
        inputs: Inputs,
        seen: ArmMeasurement,
        asked: DesiredRates,
        allowed: Allowed,
        clear: Clear,
        limited: Limited,
    ) -> tuple[Memory, Output]:
        """Return the next memory and what to send, once it is decided how the joints move."""
        actuated = self.stages.actuate(
            memory.torque,
            Now(
                inputs.q_measured,
                seen.error,
                memory.motion,
                limited.motion,
                seen.kinematics,
                None if seen.hand is None else -seen.hand,
                inputs.settings.T_wrist_mrf,
                inputs.time_s,
                inputs.intent is Intent.SEED,
                memory.wrist.load,
            ),
        )
        scale, pace = asked.scale * allowed.scale, asked.scale * allowed.pace
        stance = asked.stance
        station = stance.station
        leaves = (
            inputs.at_posture and max(asked.found.self_motion.norms.values(), default=0.0) > MOVED
        )
        if station is None and stance.alert and (allowed.made_way or leaves):
            station = self.stages.standing.begun(memory.stop, seen.kinematics.T_world_mrf)
        accelerated = sizes(seen.kinematics.J.dot(limited.motion.ddq))[0]
        memory = evolve(
            memory,
            levels=clear.levels,
            torque=actuated.state,
            station=station,
            resistance=allowed.resistance,
            motion=limited.motion,
            stop=limited.stop,
            max_tool_acceleration=max(accelerated, LATELY * memory.max_tool_acceleration),
            sent=(limited.motion.q, memory.sent[0], memory.sent[1]),
            task=self._advanced(memory.task, limited.stopped, asked, scale, pace, seen.kinematics),
        )
        return memory, Output(
            q=limited.motion.q,
            dq=limited.motion.dq,
            command=actuated.command,
            refusal=actuated.refusal,
            at_rest=limited.motion.stands(STANDING),
            following_error=seen.error,
            T_world_mrf=seen.kinematics.T_world_mrf,
            T_world_mrf_measured=seen.T_world_wrist_measured @ inputs.settings.T_wrist_mrf,
            T_wrist_mrf=inputs.settings.T_wrist_mrf,
            wrench_mrf=seen.wrench,
            twists=asked.twists,
            twist=asked.twist,
            scale=scale,
            limits=asked.limits
            + allowed.limits
            + (("verified_stop",) if limited.stopped else ())
            + actuated.limits,
            stop_worsened=limited.worsened,
            shown=clear.shown,
            near=memory.near,
            sigma_min=asked.found.sigma_min,
            gains=memory.task.gains,
            objectives=memory.objectives,
            self_motion=asked.found.self_motion,
            at_goal=self._at_goal(memory, inputs),
            bleeding=memory.task.force.bleeding,
            path=memory.task.position.progress,
            T_world_path=path_of_mrf(inputs, memory.task.position.T_world_path),
            field=asked.found.field,
            off_path=memory.task.off_path,
            insertion=memory.insertion,
        )

    def _advanced(
        self,
        memory: TaskMemory,
        stopped: bool,
        asked: DesiredRates,
        scale: float,
        pace: float,
        k: Kinematics,
    ) -> TaskMemory:
        """Return the task's next memory; the tool did `scale` of what was asked, a path `pace`."""
        share = 0.0 if stopped else scale
        granted = Granted(
            share, 0.0 if stopped else pace, scale < SLID * pace, asked.twist, k.T_world_mrf
        )
        off_path = advance_offset(memory.off_path, asked.found.give_way, share * self.p.period_s)
        return self.stages.task.advanced(memory, granted, off_path)

    def _at_goal(self, memory: Memory, inputs: Inputs) -> bool:
        if inputs.intent is not Intent.MOVE:
            return False
        if inputs.posture is not None:
            return at_posture(memory.motion.q, inputs.posture)
        if (arrived := self.body.arrived(memory.insertion, inputs.drive)) is not None:
            return arrived
        return memory.task.position.at_goal and on_path(memory.task.off_path)
