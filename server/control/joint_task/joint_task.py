"""A joint task: one sum of sources, one payload, and each arm's part in moving it.

The common twist of the MRF is that of stick, position, vision and frames. Each arm moves its Wrist
by it with its own lever (Williams 1997, eq. 1 and section 3), and gives way at its own grasp to
what is not its share of the load (`forces.py`). So arms that do not agree on where the payload is,
as calibration never makes them, do not press it.

The payload's pose is the mean of the arms' views, which follow it slowly (`grasps/views.py`).
"""

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from ....config.errors import ConfigError
from ....config.load import Cell
from ....config.schema.joint_task import JointTaskSection
from ..arm.arm import Arm
from ..arm.asking import ArmReading
from ..arm.context import path_of_mrf
from ..evolve import evolve
from ..grasps.held import Held, Holding
from ..grasps.views import apart, mean_of
from ..mechanism.joint_rates import Around
from ..mechanism.kinematics import Kinematics, at_mrf
from ..mechanism.null_space.redundancy import ObjectiveGains
from ..mechanism.wrist import WristMemory
from ..rigid_body import rotate_twist
from ..spatial import Array, Pose
from ..state import Inputs, Intent, Memory, Output
from ..task.sources.force import ForceState
from ..task.task import TaskMemory
from .at_fault import AtFault, Moving
from .common import Common
from .forces import SLIPPED_S, GivingWay, Grasping, light_s
from .grips import Grips
from .members import Member, Together
from .stretch import relative_speed
from .weighing import Told, weighed

FIT_M = 0.020
"""Grasps that are farther from fitting each other do not hold one payload [m]."""


class _Of(NamedTuple):
    """One arm in one tick, before it is decided what it is asked for."""

    before: Memory
    inputs: Inputs
    measured: Pose
    """Where its Wrist was measured, in World."""
    wrist: WristMemory
    held: Held
    kinematics: Kinematics
    """Of the commanded posture, with the MRF where the arm sees it."""


class _Tuned(NamedTuple):
    """One arm's gains in effect, and how it gives way at its grasp."""

    task: TaskMemory
    objectives: ObjectiveGains
    since_s: float
    way: Array
    """The twist (6,) of the MRF by which it does, World axes."""
    force: ForceState


class JointTask:
    """The control computation of one task that several arms hold."""

    def __init__(
        self, section: JointTaskSection, arms: Sequence[Arm], members: Sequence[int]
    ) -> None:
        """Build it; `members` tells which of a cell's `arms` hold the payload, the first leads."""
        self.name, self.section, self.members = section.name, section, tuple(members)
        self.arms = tuple(arms[i] for i in members)
        nominal = [Pose.from_xyz_rpy(T.xyz, T.rpy) for T in section.T_wrist_mrf]
        self._T_payload_wrist = nominal[0].inverse()
        self.at_fault = AtFault(section, self.arms, nominal)
        self.grips = Grips(section.name, self.arms, nominal, self.arms[0].p.period_s)
        self._common = Common(section, self.arms[0], nominal[0].p)
        self._giving_way = GivingWay(section, self.arms)

    @classmethod
    def of(cls, cell: Cell, arms: Sequence[Arm]) -> tuple[Self, ...]:
        """Build those of a cell. Raises `ConfigError` where grasps do not fit at the start."""
        names = [part.config.mechanism.name for part in cell.parts]
        start = [np.array(part.config.mechanism.postures["start"]) for part in cell.parts]
        found = []
        for section in cell.joint_tasks:
            task = cls(section, arms, [names.index(name) for name in section.by])
            if section.at_start:
                misfit = task.grips.misfit([start[i] for i in task.members])
                if misfit > FIT_M:
                    raise ConfigError(
                        f"{cell.path}: task '{section.name}': T_wrist_mrf: at the postures 'start' "
                        f"the grasps are {1e3 * misfit:.0f} mm from fitting each other: at most "
                        f"{1e3 * FIT_M:.0f} mm"
                    )
            found.append(task)
        return tuple(found)

    def on(self, memories: Sequence[Memory]) -> bool:
        """Return whether the arms hold the payload together."""
        held = memories[self.members[0]].held
        return held is not None and held.task == self.name

    # --- one tick ----------------------------------------------------------------------------

    def ask(self, memories: Sequence[Memory], inputs: Sequence[Inputs]) -> Together:
        """Return what the task asks of each of its arms; both are those of all arms of the cell."""
        told = inputs[self.members[0]]
        T_payload_mrf = self._T_payload_wrist @ told.settings.T_wrist_mrf
        each, mean = self._seen(memories, inputs, told, T_payload_mrf)
        T_world_mrf, first = mean @ T_payload_mrf, each[0]
        shared, twists = self._common.summed(
            first.held.shared or self._common.idle,
            first.before, told, first.wrist, first.kinematics, T_world_mrf,
        )  # fmt: skip
        twist = sum(twists.values(), np.zeros(6))
        views, wrists = [of.inputs.settings.T_wrist_mrf for of in each], [of.wrist for of in each]
        known = first.held.weighed
        forces = self._giving_way.forces(
            told, views, wrists, T_payload_mrf, T_world_mrf.R, known.load + known.waits
        )
        light = [0.0] * len(each)
        if told.intent is not Intent.SEED:
            before_s, T = [of.held.light_s for of in each], self.arms[0].p.period_s
            light = light_s(before_s, forces, T_world_mrf.R[2], T)
        lost = max(light) >= SLIPPED_S
        tuned = [self._tuned(i, of, forces, T_world_mrf.R, lost) for i, of in enumerate(each)]
        factor, ways = told.settings.speed_factor, [t.way for t in tuned]
        wanted, way = bool(told.wrench_desired.any()), sum(ways, np.zeros(6)) / len(ways)
        sums = Told(forces.contact, wanted, T_payload_mrf, T_world_mrf, twist, way)
        intent = Intent.STOP if lost else told.intent
        known = weighed(known, sums, intent, self.arms[0].p.period_s)
        share = min(
            arm.asking.tool_share(twist + way, factor)
            for arm, way in zip(self.arms, ways, strict=True)
        )
        moving = told.intent is Intent.MOVE
        strained = self._giving_way.strained(forces) if moving else None
        members = []
        for i, (seen, t) in enumerate(zip(each, tuned, strict=True)):
            of = seen._replace(held=evolve(seen.held, light_s=light[i], weighed=known))
            away = apart(T_world_mrf, of.kinematics.T_world_mrf)[0]
            holding = Holding(
                self.name, forces.exerted[i], forces.desired[i], forces.internal_force,
                forces.internal_moment, strained, light[i] >= SLIPPED_S, known.load, away,
                of.held.redefined,
            )  # fmt: skip
            members.append(self._member(i, of, t, twists, twist, share, holding))
        if told.intent is Intent.MOVE:
            R_world_payload = T_world_mrf.R @ T_payload_mrf.R.T
            slowed = self.at_fault.slowed(
                [self._moving(member, forces, i) for i, member in enumerate(members)],
                R_world_payload,
            )
            if slowed.share < 1.0:
                share *= slowed.share
                limit = f"internal_at_fault:{slowed.by}"
                members = [member.slowed(slowed.share, limit) for member in members]
        return Together(
            tuple(members), T_world_mrf, shared, twists, twist, share, strained,
            lost, forces.p, forces.contact, share * relative_speed(ways),
        )  # fmt: skip

    def finish(
        self,
        together: Together,
        told: Inputs,
        memories: Sequence[Memory],
        outputs: Sequence[Output],
        pace: float,
    ) -> tuple[list[Memory], list[Output]]:
        """Return the members' memories and outputs with what is common to them.

        A path may go on at a part `pace` (0 to 1) of its own speed.
        """
        shared = self._common.advanced(
            together.shared, together.twist, together.T_world_mrf, outputs[0], pace
        )
        held = memories[0].held
        nexts = list(memories)
        if held is not None:
            nexts[0] = evolve(memories[0], held=evolve(held, shared=shared))
        strained: tuple[str, ...] = ()
        if together.strained is not None:
            strained = (f"{together.strained}:{self.name}",)
        if together.slipped:
            strained += (f"slipped:{self.name}",)
        found = [
            output._replace(held=member.holding, limits=(*output.limits, *strained))
            for output, member in zip(outputs, together.members, strict=True)
        ]
        position, first = shared.position, found[0]
        common = first._replace(
            T_world_mrf=together.T_world_mrf,
            T_world_mrf_measured=mean_of([output.T_world_mrf_measured for output in found]),
            T_wrist_mrf=told.settings.T_wrist_mrf,
            wrench_mrf=together.contact,
            at_rest=all(output.at_rest for output in found),
            gains=shared.gains,
            at_goal=told.intent is Intent.MOVE and position.at_goal,
            bleeding=any(m.held is not None and m.held.force.bleeding for m in memories),
            path=position.progress,
            T_world_path=path_of_mrf(told, position.T_world_path),
        )
        found[0] = first._replace(shared=common)
        return nexts, found

    # --- its steps ---------------------------------------------------------------------------

    def _seen(
        self,
        memories: Sequence[Memory],
        inputs: Sequence[Inputs],
        told: Inputs,
        T_payload_mrf: Pose,
    ) -> tuple[list[_Of], Pose]:
        """Return where each arm is and has the payload, and where that is in World.

        While drives are off, a grasp is what the measured joints make of it.
        """
        measured, wrists, before = [], [], []
        for i, arm in zip(self.members, self.arms, strict=True):
            memory, own = memories[i], inputs[i]
            T = arm.mechanism.pose_wrist(own.q_measured)
            measured.append(T)
            wrists.append(arm.asking.measured(memory, own, T))
            seeding = told.intent is Intent.SEED
            before.append(arm.asking.seeded(memory, own) if seeding else memory)
        commanded = [
            arm.mechanism.wrist(memory.motion.q)
            for arm, memory in zip(self.arms, before, strict=True)
        ]
        if told.intent is Intent.SEED:
            held, mean = self.grips.taken(measured, before)
        else:
            held, mean = self.grips.followed([T for T, _ in commanded], before)
        found = []
        for i, wrist in enumerate(commanded):
            given = _of_member(inputs[self.members[i]], told, held[i], T_payload_mrf)
            k = at_mrf(*wrist, given.settings.T_wrist_mrf)
            found.append(_Of(before[i], given, measured[i], wrists[i], held[i], k))
        return found, mean

    def _tuned(self, i: int, of: _Of, forces: Grasping, R_world_mrf: Array, lost: bool) -> _Tuned:
        """Return one arm's gains in effect, and the twist by which it gives way with them.

        None does that while the payload is `lost`: they would go up and down after their shares.
        """
        asking = self.arms[i].asking
        task, objectives, since_s = asking.tuned(of.before, of.inputs, of.kinematics, of.wrist)
        gain, at = task.gains.get("force", np.zeros(6)), of.kinematics.T_world_wrist.p
        intent = Intent.STOP if lost else of.inputs.intent
        way, state = self._giving_way.twist(i, forces, gain, R_world_mrf, intent, of.held, at)
        return _Tuned(task, objectives, since_s, way, state)

    def _moving(self, member: Member, forces: Grasping, i: int) -> Moving:
        """Return what one arm is asked for, for what a fault would then do."""
        k = member.seen.kinematics
        R = k.T_world_mrf.R
        return Moving(
            member.memory.motion.q, member.wanted.dq, k.J,
            R @ forces.p[i], rotate_twist(R, forces.desired[i]),
        )  # fmt: skip

    def _member(
        self,
        i: int,
        of: _Of,
        tuned: _Tuned,
        twists: dict[str, Array],
        twist: Array,
        share: float,
        holding: Holding,
    ) -> Member:
        """Return one arm's part: the common twist and its own, resolved into joint rates."""
        arm, given = self.arms[i], of.inputs
        wanted = arm.asking.resolved(
            of.before.motion.q,
            {"common": share * twist, "force": share * tuned.way},
            tuned.objectives,
            None,
            given,
            of.kinematics,
            of.kinematics.T_world_wrist.R @ (arm.p.T_wrist_tool.p - given.settings.T_wrist_mrf.p),
            Around(given.scene, None, None, None),
        )
        wanted = wanted._replace(
            twists={**twists, "force": tuned.way},
            twist=twist,
            scale=share,
            limits=(*wanted.limits, "tool_speed") if share < 1.0 else wanted.limits,
        )
        memory = evolve(
            of.before,
            wrist=of.wrist,
            task=tuned.task,
            objectives=tuned.objectives,
            moving_since_s=tuned.since_s if given.intent is Intent.MOVE else None,
            held=evolve(of.held, force=tuned.force),
        )
        wrist, mrf = arm.stages.wrist, given.settings.T_wrist_mrf
        seen = ArmReading(
            of.kinematics,
            None,
            of.measured,
            memory.sent[1] - given.q_measured,
            wrist.wrench_mrf(of.wrist, mrf),
            wrist.hand_mrf(of.wrist, mrf),
        )
        return Member(memory, given, seen, wanted, share * tuned.way, holding)


def _of_member(own: Inputs, told: Inputs, held: Held, T_payload_mrf: Pose) -> Inputs:
    """Return the inputs of one arm, which nothing commands alone."""
    settings = evolve(
        own.settings,
        T_wrist_mrf=held.T_wrist_payload @ T_payload_mrf,
        gains=told.settings.gains,
        at_once=told.settings.at_once,
    )
    return evolve(
        own, settings=settings, stick=None, jog=None, goal=None, view=None, posture=None,
        T_wrist_goal=None, wrench_desired=told.wrench_desired, at_posture=told.at_posture,
    )  # fmt: skip
