"""The tick: sum, resolve, avoid, limit, gate. The page to read first.

    sources ──► sum ──► tool speed ──► resolve ──► nearest allowed ──► limit ──► gate ──► actuate
       ▲                                  ▲               ▲              │
       └── poses, wrench                  └ objectives    └ joint limits └ verified stop

Sums are made for each task and resolved for each mechanism (`arm.py`). What of that is granted is
decided once, for all joints of the cell together: one programme of barriers, one limiter with one
verified stop, one gate. So what stops one arm stops them all, and two arms keep clear of each other
as of anything else.

A pure function of its inputs: no I/O, no clock, no thread, no logging.
"""

from collections.abc import Collection, Sequence
from functools import partial
from typing import Self

import numpy as np

from ...config.load import Cell
from .arm import Arm
from .barriers.barriers import ConstraintSet
from .barriers.clearance import CollisionConstraint, ProximityQuery
from .bodies.rates import ArmTick
from .compiled import evolve
from .inputs import Inputs, Intent
from .joint_task.joint_task import ActiveTask, JointTasks, finish, members_of
from .joints import Joints, joined, parts_of
from .scene import Body
from .spatial import Array
from .state import Memory
from .stop.limiter import Commanded, Gate, Limited, Limiter, StopConstraint
from .stop.profile import Stop
from .torso import Torso


class Control:
    """The control computation of one cell. Holds constants and scratch memory only."""

    def __init__(
        self,
        arms: Sequence[Arm],
        guard: CollisionConstraint | None = None,
        cell: Cell | None = None,
    ) -> None:
        """Build it; `guard` keeps clearances, None in a cell that has none to keep.

        All arms have one period. Their joints are one vector, arm after arm. `cell` has the joint
        tasks, None for none; raises `ConfigError` where their grasps do not fit.
        """
        self.arms = tuple(arms)
        p = self.arms[0].p
        every = [arm.p.joints for arm in self.arms]
        joints = Joints.of_all(every)
        T, parts = p.period_s, parts_of([arm.n for arm in every])
        self.torsos = () if cell is None else Torso.of_all(cell, self.arms, parts)
        """Mechanisms that carry others."""
        trees = [torso.tree for torso in self.torsos]
        self.allow = ConstraintSet(every, T, p.resolve.characteristic_length, guard, trees)
        self.limiter = self._limiter_of(())
        self.joint: JointTasks | None = None
        """Payloads that several arms may hold together; None in a cell without joint tasks."""
        if cell is not None and cell.joint_tasks:
            self.joint = JointTasks(cell, self.arms, self._limiter_of)
        self.gate = Gate(joints, T)
        if guard is not None and len(self.arms) == 1 and guard.capsules is p.capsules:
            self.arms[0].shared = guard.capsules

    @classmethod
    def of(cls, cell: Cell) -> Self:
        """Build that of a cell. Raises `ConfigError` where a link's shape is needed, not known."""
        arms = [Arm.of(part) for part in cell.parts]
        guard = None
        if cell.config.keeps_clear:
            joints = Joints.of_all([arm.p.joints for arm in arms])
            capsules = arms[0].p.capsules if len(arms) == 1 else None
            guard = CollisionConstraint(cell, joints.acceleration, joints.jerk, capsules)
        return cls(arms, guard, cell)

    def seed(self, q: Array, on: Collection[str] | None = None) -> Memory:
        """Return the memory of arms at rest at q (n,) [rad] that were told nothing yet.

        Arms hold the payloads of the joint tasks `on`; of those that are at start, if None.
        """
        found = Memory(Commanded.at_rest(q), tuple(arm.seed() for arm in self.arms), {})
        return found if self.joint is None else self.joint.seeded(found, on)

    @property
    def parts(self) -> tuple[slice, ...]:
        """Where each arm's joints are among all."""
        return self.allow.parts

    def tick(self, memory: Memory, inputs: Sequence[Inputs]) -> tuple[Memory, tuple[ArmTick, ...]]:
        """Return the next memory and what to send, of each arm: one period of control.

        Time, intent, scene and the factor of reduced speed are the same for all arms. A refusal of
        the gate concerns all.
        """
        first, beside = inputs[0], self.allow.guard is not None
        if first.intent is Intent.SEED:
            memory = memory._replace(commanded=self._seeded(memory.commanded, inputs), levels={})
        commanded = memory.commanded
        each = self._each(commanded)
        inputs = self._placed(inputs, each)
        on = [] if self.joint is None else self.joint.on(memory.arms, each, inputs)
        told, members = inputs, members_of(on)
        if on:
            inputs = [
                members[i].inputs if i in members else given for i, given in enumerate(inputs)
            ]
        asked: list[ArmTick] = []
        shared: dict[int, ArmTick] = {}
        for torso in self.torsos:
            shared.update(torso.solve(self.arms, memory.arms, each, inputs))
        for i, (arm, last, given) in enumerate(zip(self.arms, memory.arms, inputs, strict=True)):
            tick = members.get(i) or shared.get(i) or arm.solve(last, each[i], given)
            arm.before_barriers(tick, beside)
            asked.append(tick)
        watch = self.allow.nearest(
            asked, commanded.motion, memory.levels, self._bases(inputs), [one.link for one in on]
        )
        bodies = self._of_bodies(asked)
        limited = self._limit(commanded, inputs, asked, watch, on, bodies)
        refusal = self.gate.refusal(limited.motion.q, commanded.sent)
        nexts = []
        for arm, last, tick, part in zip(self.arms, memory.arms, asked, self.parts, strict=True):
            nexts.append(arm.finish(last, tick, limited, part))
            tick.refusal = tick.refusal if refusal is None else refusal
        if on:
            finish(on, told, nexts, asked)
        levels = {} if watch is None else watch.levels
        return Memory(commanded.followed_by(limited), tuple(nexts), levels), tuple(asked)

    def _placed(self, inputs: Sequence[Inputs], each: Sequence[Commanded]) -> Sequence[Inputs]:
        """Return the inputs with all sight lines in World, by where arms are commanded to be."""
        scene = inputs[0].scene
        if scene is None or not scene.carried:
            return inputs
        wrists = [
            arm.mechanism.pose_wrist(told.motion.q, given.moved and given.moved.base.T)
            for arm, told, given in zip(self.arms, each, inputs, strict=True)
        ]
        scene = scene.placed(wrists)
        return [evolve(given, scene=scene) for given in inputs]

    def _seeded(self, commanded: Commanded, inputs: Sequence[Inputs]) -> Commanded:
        """Return joints at rest where they are measured; those whose drives are on keep theirs."""
        at = [given.q_measured for given in inputs]
        for i, (part, given) in enumerate(zip(self.parts, inputs, strict=True)):
            if given.energised is not None:
                at[i] = np.where(given.energised, commanded.motion.q[part], at[i])
        return Commanded.at_rest(joined(at))

    def _bases(self, inputs: Sequence[Inputs]) -> tuple[Body, ...]:
        """Return where the Bases are, and how they move of themselves; none where all stand.

        Those on a torso are where its joints have them, whatever is said here.
        """
        carried = {i for torso in self.torsos for i in torso.tree[1:].tolist()}
        moved = [None if i in carried else given.moved for i, given in enumerate(inputs)]
        if all(each is None for each in moved):
            return ()
        return tuple(
            Body.standing(arm.mechanism.T_world_base) if each is None else each.base
            for arm, each in zip(self.arms, moved, strict=True)
        )

    def _each(self, commanded: Commanded) -> list[Commanded]:
        """Return what the joints of each arm were told."""
        return [commanded] if len(self.arms) == 1 else [commanded.of(part) for part in self.parts]

    def _limit(
        self,
        commanded: Commanded,
        inputs: Sequence[Inputs],
        asked: Sequence[ArmTick],
        watch: ProximityQuery | None,
        on: Sequence[ActiveTask],
        bodies: Sequence[StopConstraint],
    ) -> Limited:
        """Bound acceleration and jerk, and keep a verified stop at hand.

        `bodies` judge stops by what they keep of their own.
        """
        motion, stop, _ = commanded
        limiter = self.limiter if self.joint is None or not on else self.joint.limiter(on)
        if inputs[0].intent is Intent.STOP or any(each.stops for each in on):
            return limiter.go_on(stop)
        if inputs[0].intent is Intent.SEED:
            return Limited(motion, stop, False)
        judges: list[StopConstraint] = []
        if self.allow.guard is not None and watch is not None:
            judges.append(partial(_shortfall, self.allow.guard, watch))
        judges += bodies
        judges += [each.violation for each in on]
        judge = None if not judges else judges[0] if len(judges) == 1 else partial(_worst, judges)
        dq = joined([tick.allowed for tick in asked])
        return limiter.step(motion, stop, dq, max(given.pace for given in inputs), judge)

    def _of_bodies(self, asked: Sequence[ArmTick]) -> list[StopConstraint]:
        """Return what judges stops of all joints by what their bodies keep."""
        found = []
        for arm, part, tick in zip(self.arms, self.parts, asked, strict=True):
            judge = arm.body.stop_constraint(tick)
            if judge is not None:
                found.append(judge if len(self.arms) == 1 else partial(_of_part, judge, part))
        return found

    def _limiter_of(self, groups: tuple[tuple[int, ...], ...]) -> Limiter:
        """Return the limiter of the cell; joints of a group of arms stop in proportion.

        So do those that a body synchronizes, and all of a torso and what it carries: they get to
        their rates together, too.
        """
        trees = [tuple(torso.tree.tolist()) for torso in self.torsos]
        groups = (*groups, *trees)
        grouped = {i for group in groups for i in group}
        joints = Joints.of_all([arm.p.joints for arm in self.arms])
        every = np.arange(joints.n)
        return Limiter(
            joints,
            self.arms[0].p.period_s,
            [np.concatenate([every[self.parts[i]] for i in group]).tolist() for group in groups]
            + [
                every[self.parts[i]][own].tolist()
                for i, arm in enumerate(self.arms)
                for own in arm.body.synchronized
                if i not in grouped
            ],
            self._together(),
        )

    def _together(self) -> list[slice]:
        """Return where the joints are that get to their rates together: an arm's, or a torso's."""
        found = list(self.parts)
        for torso in reversed(self.torsos):
            first, last = int(torso.tree[0]), int(torso.tree[-1])
            found[first : last + 1] = [slice(self.parts[first].start, self.parts[last].stop)]
        return found


def _of_part(judge: StopConstraint, part: slice, stop: Stop) -> float:
    """Return by how much the part of a stop that is one arm's breaks what that arm keeps [m]."""
    return judge(stop.of(part))


def _worst(judges: Sequence[StopConstraint], stop: Stop) -> float:
    """Return by how much a stop breaks what any of the judges keeps [m]."""
    return max(judge(stop) for judge in judges)


def _shortfall(guard: CollisionConstraint, watch: ProximityQuery, stop: Stop) -> float:
    """Return by how much a stop breaks what the guard keeps [m]; 0 for not at all."""
    return guard.violation(watch, stop.to_go_s, stop.low, stop.high, stop.postures)
