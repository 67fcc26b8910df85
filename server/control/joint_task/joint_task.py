"""A joint task: one sum of sources, one payload, and each arm's part in moving it."""

import math
from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple, Self

import numpy as np

from ....config.errors import ConfigError
from ....config.load import Cell
from ....config.schema.joint_task import JointTaskSection
from ..arm import Arm, context_of, path_of_mrf, quantities
from ..barriers.together import PayloadLink
from ..bodies.rates import ArmTick
from ..compiled import ARRAY3, ARRAY4, BLOCK, INDEX, MATRIX, compiled, evolve
from ..forest import Forest, at_mrf
from ..grasps import GraspState, GraspStatus, apart, mean_of
from ..inputs import UNASKED, Inputs, Intent
from ..joints import parts_of
from ..mechanism.self_motion import IDLE
from ..scene import Index
from ..spatial import Array, Kinematics, Pose, rotate_twist
from ..state import ArmMemory, Memory
from ..stop.limiter import Commanded, Limiter
from ..stop.profile import Stop
from ..task.source import Granted
from ..task.sources import ForceState
from ..task.task import Task, TaskMemory
from .forces import (
    SLIPPED_S,
    AtFault,
    GivingWay,
    Grasping,
    Grips,
    Moving,
    Slowed,
    Told,
    light_s,
    weighed,
)

# --- Results of a joint task in one tick: for each of its arms, and for all -----------------------


class ActiveTask(NamedTuple):
    """A joint task that is on, in one tick."""

    task: "JointTask"
    members: tuple[ArmTick, ...]
    """Each arm's, with the MRF where it sees it, and nothing that commands it alone."""
    ways: tuple[Array, ...]
    """The twists (6,) of the MRF by which each gives way at its grasp, World axes."""
    T_world_mrf: Pose
    """The mean of the arms' views."""
    shared: TaskMemory
    twist: Array
    """The common twist (6,)."""
    share: float
    """Part of it that the tool's speed bounds allow, 0 to 1 [1]."""
    strained: str | None
    """`internal_force` or `internal_moment`: which is beyond its bound while the arms may move."""
    slipped: bool
    """The payload slipped out of a grasp."""
    grasps: Array
    """Where the grasps are, seen from the MRF (k, 3) [m]."""
    contact: Array | None
    """Wrench (6,) of the payload on what it touches, at and in the MRF; None when one is stale."""
    giving_way: float
    """Greatest relative speed of two grasps that force control asks for [m/s]."""
    carried: "Carried"

    @property
    def stops(self) -> bool:
        """True while the arms may not move on: pressed too hard, or without the payload."""
        return self.strained is not None or self.slipped

    @property
    def link(self) -> PayloadLink:
        """Its arms, for the barriers."""
        return PayloadLink(np.array(self.task.members), np.array(self.ways))

    def violation(self, stop: Stop) -> float:
        """Return by how much a stop stretches the payload more than is promised [m]."""
        return self.task.stretch.violation(stop, self.carried, self.grasps, self.giving_way)


# --- The promise of stretch: how far grasps of one payload move apart along a stop ----------------
#
# Arms that stop in proportion go along straight lines in joint space, which bend apart in the
# payload by d²/2R. A stop that would stretch the payload by more than is promised is none, so
# that the arms are slower where it bends too much.

STEP_S = 0.03
"""A stop is looked at every so long [s]."""

MOST_SAMPLES = 24
"""At so many instants at most [1]."""

Carried = tuple[Array, Array]
"""Where bodies that joints move have the MRF: R (k, 3, 3) and p (k, 3) [m]."""


class Stretch:
    """How far the grasps of some mechanisms of a cell move apart along stops."""

    def __init__(self, cell: Cell, members: Sequence[int], promised: float) -> None:
        """Build it for mechanisms by their places in the cell; `promised` is the bound [m]."""
        self._forest, self._promised = Forest(cell), promised
        parts = [cell.parts[i] for i in members]
        found = [self._forest.body_of(p.prefix + p.config.mechanism.tip_link) for p in parts]
        self._joints = np.array([body - 1 for body, _ in found])
        self._T_body_wrist = [T for _, T in found]

    def carried(self, views: Sequence[Pose]) -> Carried:
        """Return where each arm has the MRF; `views` are their T_wrist_mrf."""
        in_body = [T @ view for T, view in zip(self._T_body_wrist, views, strict=True)]
        return np.array([T.R for T in in_body]), np.array([T.p for T in in_body])

    def violation(self, stop: Stop, carried: Carried, grasps: Array, giving_way: float) -> float:
        """Return by how much grasps move apart more than is promised [m], 0 for not.

        `carried` is where each arm has the MRF, `grasps` (k, 3) where the grasps are in it [m].
        `giving_way` is the relative speed that force control asks for [m/s]: coming to rest from
        that is no stretch.
        """
        to_go_s = stop.to_go_s
        if to_go_s <= 0.0:
            return 0.0
        samples = min(MOST_SAMPLES, 2 + int(to_go_s / STEP_S))
        times = np.arange(samples, dtype=np.float64) * (to_go_s / (samples - 1))
        times[-1] = to_go_s
        frames = self._forest.frames(stop.postures(times))
        places = np.empty((samples, len(self._joints), len(grasps), 3))
        most = _most_apart(frames, self._joints, *carried, grasps, places)
        allowed = self._promised + 0.5 * giving_way * to_go_s
        return max(0.0, math.sqrt(most) - allowed)


def relative_speed(twists: Sequence[Array]) -> float:
    """Return the greatest difference in speed [m/s] of two twists (6,)."""
    most = 0.0
    for i, a in enumerate(twists):
        for b in twists[:i]:
            apart = (a - b)[:3]
            most = max(most, float(apart @ apart))
    return math.sqrt(most)


@compiled(ARRAY4, INDEX, ARRAY3, MATRIX, MATRIX, BLOCK)
def _most_apart(
    frames: Array, joints: Index, R: Array, p: Array, grasps: Array, places: Array
) -> float:
    """Return the greatest square [m²] of how far two arms take one point of the payload apart.

    Each of k arms carries the points (j, 3) [m], where they are at `R` (k, 3, 3) and `p` (k, 3) in
    the body that a joint moves; `frames` (s, n, 3, 4) are the joints' frames at s instants, the
    first of which is what counts from. Places (s, k, j, 3) are filled in.
    """
    samples, arms, points, _ = places.shape
    for arm in range(arms):
        for point in range(points):
            for i in range(3):
                in_body = p[arm, i]
                for axis in range(3):
                    in_body += R[arm, i, axis] * grasps[point, axis]
                places[0, arm, point, i] = in_body
            x, y, z = places[0, arm, point, 0], places[0, arm, point, 1], places[0, arm, point, 2]
            joint = joints[arm]
            for s in range(samples):
                for i in range(3):
                    places[s, arm, point, i] = (
                        frames[s, joint, i, 0] * x
                        + frames[s, joint, i, 1] * y
                        + frames[s, joint, i, 2] * z
                        + frames[s, joint, i, 3]
                    )
    most = 0.0
    for arm in range(1, arms):
        for other in range(arm):
            for point in range(points):
                for s in range(1, samples):
                    square = 0.0
                    for i in range(3):
                        way = places[s, arm, point, i] - places[s, other, point, i]
                        way -= places[0, arm, point, i] - places[0, other, point, i]
                        square += way * way
                    most = max(most, square)
    return most


# --- A joint task: one sum of sources, one payload, and each arm's part in moving it --------------
#
# The common twist of the MRF is that of stick, position, vision and frames. Each arm moves its
# Wrist by it with its own lever (Williams 1997, eq. 1 and section 3), and gives way at its own
# grasp to what is not its share of the load (`forces.py`). So arms that do not agree on where
# the payload is, as calibration never makes them, do not press it.
#
# The payload's pose is the mean of the arms' views, which follow it slowly (`../grasps.py`).

FIT_M = 0.020
"""Grasps that are farther from fitting each other do not hold one payload [m]."""


_HALVINGS = 5
"""The part of a self-motion that a fault allows is found to 1/32 [1]."""

AT_EACH_GRASP = ("force", "following")
"""Sources that do not act at the shared MRF."""


class JointTask:
    """The control computation of one task that several arms hold."""

    def __init__(self, cell: Cell, section: JointTaskSection, arms: Sequence[Arm]) -> None:
        """Build that of a section, for those of a cell's `arms` that it names; the first leads."""
        names = [part.config.mechanism.name for part in cell.parts]
        members = [names.index(name) for name in section.by]
        self.name, self.section, self.members = section.name, section, tuple(members)
        self.stretch = Stretch(cell, members, section.stretch)
        self.arms = tuple(arms[i] for i in members)
        every = parts_of([arm.p.n for arm in arms])
        self.parts = tuple(every[i] for i in members)
        """Where each one's joints are among the cell's."""
        nominal = [Pose.from_xyz_rpy(T.xyz, T.rpy) for T in section.T_wrist_mrf]
        self._T_payload_wrist = nominal[0].inverse()
        self.at_fault = AtFault(section, self.arms, nominal)
        self.grips = Grips(section.name, self.arms, nominal, self.arms[0].p.period_s)
        self._task = Task(section.sources, section.schedules, self.arms[0].p.shaping)
        self._p_wrist_mrf = nominal[0].p
        self._giving_way = GivingWay(section, self.arms)

    @classmethod
    def of(cls, cell: Cell, arms: Sequence[Arm]) -> tuple[Self, ...]:
        """Build those of a cell. Raises `ConfigError` where grasps do not fit at the start."""
        start = [np.array(part.config.mechanism.postures["start"]) for part in cell.parts]
        found = []
        for section in cell.joint_tasks:
            task = cls(cell, section, arms)
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

    def on(self, memories: Sequence[ArmMemory]) -> bool:
        """Return whether the arms hold the payload together."""
        held = memories[self.members[0]].held
        return held is not None and held.task == self.name

    # --- one tick ----------------------------------------------------------------------------

    def ask(
        self,
        memories: Sequence[ArmMemory],
        commanded: Sequence[Commanded],
        inputs: Sequence[Inputs],
    ) -> ActiveTask:
        """Return what the task asks of each of its arms; all are those of all arms of the cell."""
        told = inputs[self.members[0]]
        T_payload_mrf = self._T_payload_wrist @ told.settings.T_wrist_mrf
        before = self._before(memories, told)
        each, held, mean = self._seen(memories, before, commanded, inputs, told, T_payload_mrf)
        T_world_mrf = mean @ T_payload_mrf
        shared, twists = self._summed(before[0], held[0], each[0], told, T_world_mrf)
        twist = sum(twists.values(), np.zeros(6))
        views, wrists = [tick.T_wrist_mrf for tick in each], [tick.wrist for tick in each]
        known = held[0].weighed
        weights = self._giving_way.weights(told, held)
        forces = self._giving_way.forces(
            told, weights, views, wrists, T_payload_mrf, T_world_mrf.R, known
        )
        moving = told.intent is Intent.MOVE
        take: Array | None = None
        if moving:
            mass = self.section.payload.mass
            shared, take = self._task.eased(
                shared, twists, forces.contact, T_world_mrf.R, len(each), mass
            )
        if take is not None:
            twist = twist + take
        light = [0.0] * len(each)
        if told.intent is not Intent.SEED:
            before_s, T = [grasp.light_s for grasp in held], self.arms[0].p.period_s
            light = light_s(before_s, forces, T_world_mrf.R[2], T)
        lost = max(light) >= SLIPPED_S
        states, ways = [], []
        for i, tick in enumerate(each):
            way, state = np.zeros(6), ForceState()
            # While the payload is lost none gives way: they would go up and down after shares.
            if not lost:
                gain, k = tick.task.gains.get("force", way), tick.kinematics
                way, state = self._giving_way.twist(
                    i, forces, gain, T_world_mrf.R, k, tick.inputs, held[i]
                )
            ways.append(way)
            states.append(state)
        factor = told.settings.speed_factor
        wanted, way = bool(told.wrench_desired.any()), sum(ways, np.zeros(6)) / len(ways)
        sums = Told(forces.contact, wanted, T_payload_mrf, T_world_mrf, twist, way)
        intent = Intent.STOP if lost else told.intent
        known = weighed(known, sums, intent, self.arms[0].p.period_s)
        share = min(
            arm.tool_share(twist + way, factor) for arm, way in zip(self.arms, ways, strict=True)
        )
        strained = self._giving_way.strained(forces) if moving else None
        members = []
        for i, (tick, way) in enumerate(zip(each, ways, strict=True)):
            rates = self._wanted(i, tick, {"common": twist, "force": way}, share)
            rates.twists, rates.twist = {**twists, "force": way}, twist
            if take is not None:
                rates.twists = {**twists, "force": way + take}
                rates.limits += ("press",)
            rates.holding = GraspStatus(
                self.name, forces.internal_force, forces.internal_moment, strained,
                light[i] >= SLIPPED_S, known.load, known.aside,
                weights[i], *forces.vertical(i, T_world_mrf.R[2]),
                apart(T_world_mrf, tick.T_world_mrf)[0], held[i].redefined,
            )  # fmt: skip
            rates.grasp = evolve(
                held[i], force=states[i], light_s=light[i], weighed=known, weights=weights[i]
            )
            members.append(rates)
        given = [share * way for way in ways]
        if told.intent is Intent.MOVE:
            R_world_payload = T_world_mrf.R @ T_payload_mrf.R.T
            slowed = self._at_fault(members, forces, R_world_payload)
            if slowed.share < 1.0 and any(tick.found.by_hand.moves for tick in members):
                still = [
                    self._wanted(
                        i, tick, {"common": twist, "force": way}, share, by_hand=False
                    ).dq_asked
                    for i, (tick, way) in enumerate(zip(each, ways, strict=True))
                ]
                members, slowed = self._self_motion_slowed(
                    members, still, slowed, forces, R_world_payload
                )
            if slowed.share < 1.0:
                share *= slowed.share
                given = [slowed.share * way for way in given]
                for tick in members:
                    tick.dq_asked, tick.scale = (
                        slowed.share * tick.dq_asked,
                        slowed.share * tick.scale,
                    )
                    tick.limits += (f"internal_at_fault:{slowed.by}",)
        return ActiveTask(
            self, tuple(members), tuple(given), T_world_mrf, shared, twist, share, strained, lost,
            forces.p, forces.contact, share * relative_speed(ways),
            self.stretch.carried([tick.T_wrist_mrf for tick in members]),
        )  # fmt: skip

    def finish(
        self,
        together: ActiveTask,
        told: Inputs,
        memories: Sequence[ArmMemory],
        ticks: Sequence[ArmTick],
    ) -> ArmMemory:
        """Write to its arms' ticks what is common to them; return the first one's memory with it.

        `memories` are what the arms have found themselves.
        """
        first = ticks[0]
        granted = Granted.of(
            first.granted, together.share * first.pace, together.twist, together.T_world_mrf,
            stopped="verified_stop" in first.limits,
        )  # fmt: skip
        shared = self._task.advanced(together.shared, granted)
        strained: tuple[str, ...] = ()
        if together.strained is not None:
            strained = (f"{together.strained}:{self.name}",)
        if together.slipped:
            strained += (f"slipped:{self.name}",)
        for tick in ticks:
            tick.limits += strained
        first.shared = evolve(
            first,
            inputs=told,
            kinematics=first.kinematics._replace(T_world_mrf=together.T_world_mrf),
            wrench=together.contact,
            task=shared,
            T_world_mrf_measured=mean_of([tick.T_world_mrf_measured for tick in ticks]),
            at_rest=all(tick.at_rest for tick in ticks),
            at_goal=told.intent is Intent.MOVE and shared.position.at_goal,
            bleeding=any(m.held is not None and m.held.force.bleeding for m in memories),
            T_world_path=path_of_mrf(told, shared.position.T_world_path),
        )
        memory, held = memories[0], memories[0].held
        return memory if held is None else evolve(memory, held=evolve(held, shared=shared))

    # --- its steps ---------------------------------------------------------------------------

    def _summed(
        self, before: ArmMemory, held: GraspState, first: ArmTick, told: Inputs, T_world_mrf: Pose
    ) -> tuple[TaskMemory, dict[str, Array]]:
        """Return the task's memory and the twists (6,) of its sources, at the mean MRF.

        They are asked as those of one arm would be, whose Wrist is where the first one's would be
        if all views agreed.
        """
        mrf, moving = told.settings.T_wrist_mrf, told.intent is Intent.MOVE
        k = Kinematics(T_world_mrf @ mrf.inverse(), T_world_mrf, first.kinematics.J)
        lever = k.T_world_wrist.R @ (self._p_wrist_mrf - mrf.p)
        there = evolve(first, inputs=told, kinematics=k, lever=lever, wrench=None, hand=None)
        since_s = before.moving_since_s if before.moving_since_s is not None else told.time_s
        memory = self._task.tuned(
            held.shared or self._task.idle,
            told.settings.gains,
            lambda: quantities(there, told.time_s - since_s),
            moving,
            told.settings.at_once,
        )
        context = context_of(there, None, self.arms[0].wrist)
        all_gains = memory.gains
        common = {name: gain for name, gain in all_gains.items() if name not in AT_EACH_GRASP}
        memory, twists = self._task.twists(memory._replace(gains=common), context)
        return memory._replace(gains=all_gains), twists

    def _before(self, memories: Sequence[ArmMemory], told: Inputs) -> list[ArmMemory]:
        """Return what each of its arms remembers, but for the sensors' readings."""
        own = [memories[i] for i in self.members]
        if told.intent is not Intent.SEED:
            return own
        return [arm.seeded(memory) for arm, memory in zip(self.arms, own, strict=True)]

    def _seen(
        self,
        memories: Sequence[ArmMemory],
        before: Sequence[ArmMemory],
        commanded: Sequence[Commanded],
        inputs: Sequence[Inputs],
        told: Inputs,
        T_payload_mrf: Pose,
    ) -> tuple[list[ArmTick], Sequence[GraspState], Pose]:
        """Return each arm's tick with what is measured, its grasp, and where the payload is.

        While drives are off, a grasp is what the measured joints make of it.
        """
        measured, wrists = [], []
        for i, arm in zip(self.members, self.arms, strict=True):
            memory, own = memories[i], inputs[i]
            T = arm.mechanism.pose_wrist(own.q_measured)
            measured.append(T)
            wrists.append(arm.wrist.measure(memory.wrist, own, T, memory.max_tool_acceleration))
        each = [commanded[i] for i in self.members]
        wrists_told = [
            arm.mechanism.wrist(own.motion.q) for arm, own in zip(self.arms, each, strict=True)
        ]
        if told.intent is Intent.SEED:
            held, mean = self.grips.taken(measured, before)
        else:
            held, mean = self.grips.followed([T for T, _ in wrists_told], before)
        found = []
        for i, wrist in enumerate(wrists_told):
            given = _of_member(inputs[self.members[i]], told, held[i], T_payload_mrf)
            arm, mrf = self.arms[i], given.settings.T_wrist_mrf
            wrench, hand = arm.wrist.contact.at_mrf(wrists[i].wrench, mrf)
            tick = ArmTick(
                given,
                at_mrf(*wrist, mrf),
                measured[i],
                each[i].sent[1] - given.q_measured,
                each[i],
                lever=wrist[0].R @ (arm.p.T_wrist_tool.p - mrf.p),
                wrench=wrench,
                hand=hand,
                wrist=wrists[i],
                by_hand=before[i].by_hand,
                settled=given.at_posture,
                retreat=before[i].retreat,
                resistance=before[i].resistance,
            )
            arm.tuned(before[i], tick)
            found.append(tick)
        return found, held, mean

    def _at_fault(
        self, members: Sequence[ArmTick], forces: Grasping, R_world_payload: Array
    ) -> Slowed:
        """Return how far arms are to be slowed down for what a fault would do."""
        moving = [self._moving(tick, forces, i) for i, tick in enumerate(members)]
        return self.at_fault.slowed(moving, R_world_payload)

    def _self_motion_slowed(
        self,
        members: list[ArmTick],
        still: Sequence[Array],
        whole: Slowed,
        forces: Grasping,
        R_world_payload: Array,
    ) -> tuple[list[ArmTick], Slowed]:
        """Return the members with as much of the self-motion by hand as slows no payload.

        `still` are their joint rates (n,) without it, `whole` how far all of it is to be slowed.
        """

        def at(part: float) -> list[ArmTick]:
            limits = (f"internal_at_fault:{whole.by}",)
            return [
                evolve(
                    tick,
                    dq_asked=dq + part * (tick.dq_asked - dq),
                    limits=tick.limits + limits,
                )
                for tick, dq in zip(members, still, strict=True)
            ]

        slowed = self._at_fault(at(0.0), forces, R_world_payload)
        low, high = 0.0, 1.0
        for _ in range(_HALVINGS):
            part = 0.5 * (low + high)
            if self._at_fault(at(part), forces, R_world_payload).share < slowed.share:
                high = part
            else:
                low = part
        return at(low), slowed

    def _moving(self, tick: ArmTick, forces: Grasping, i: int) -> Moving:
        """Return what one arm is asked for, for what a fault would then do."""
        R = tick.T_world_mrf.R
        return Moving(
            tick.commanded.motion.q, tick.dq_asked, tick.kinematics.J,
            R @ forces.p[i], rotate_twist(R, forces.desired[i]),
        )  # fmt: skip

    def _wanted(
        self,
        i: int,
        tick: ArmTick,
        twists: dict[str, Array],
        share: float,
        *,
        by_hand: bool = True,
    ) -> ArmTick:
        """Return one arm's tick with its twists, in common and its own, resolved into joint rates.

        With what an operator asks of its spare joints, or without that.
        """
        slowed = {name: share * twist for name, twist in twists.items()}
        tick = evolve(tick, twists=slowed)
        if not by_hand:
            tick.inputs, tick.by_hand = evolve(tick.inputs, self_motion=UNASKED), IDLE
        self.arms[i].resolved(tick)
        tick.scale = share
        if share < 1.0:
            tick.limits += ("tool_speed",)
        return tick


def _of_member(own: Inputs, told: Inputs, held: GraspState, T_payload_mrf: Pose) -> Inputs:
    """Return the inputs of one arm, which nothing commands alone."""
    settings = evolve(
        own.settings,
        T_wrist_mrf=held.T_wrist_payload @ T_payload_mrf,
        gains=told.settings.gains,
        at_once=told.settings.at_once,
        held=None,
    )
    return evolve(
        own, settings=settings, stick=None, jog=None, goal=None, view=None, posture=None,
        T_wrist_goal=None, wrench_desired=told.wrench_desired, at_posture=told.at_posture,
    )  # fmt: skip


# --- Joint tasks on and off, at rest: arms that each have a task alone, and that hold one payload

AT_REST = 1e-9
"""Joint rates [rad/s] and accelerations [rad/s²] below this are rounding, not motion."""


class HoldRefused(Exception):
    """Arms cannot hold a payload together, or let go of it, now: it says why."""


def held_together(
    task: JointTask, memory: Memory, q: Sequence[Array], always: bool = False
) -> Memory:
    """Return the memory with arms of a task that hold its payload from now on.

    `q` are the joints of each arm (n,) as they were measured: grasps are what they make of them.
    Raises `HoldRefused` for arms that move, that hold another payload, and for grasps that do not
    fit, but for the last if it is `always`.
    """
    for i, arm in zip(task.members, task.arms, strict=True):
        held = memory.arms[i].held
        if held is not None and held.task != task.name:
            raise HoldRefused(f"{_name(arm)} holds '{held.task}'")
    _require_rest(task, memory)
    misfit = task.grips.misfit([q[i] for i in task.members])
    if misfit > FIT_M and not always:
        raise HoldRefused(
            f"the grasps are {1e3 * misfit:.0f} mm from fitting each other: at most "
            f"{1e3 * FIT_M:.0f} mm"
        )
    measured = [
        arm.mechanism.pose_wrist(q[i]) for i, arm in zip(task.members, task.arms, strict=True)
    ]
    found = list(memory.arms)
    grasps, _ = task.grips.taken(measured, [found[i] for i in task.members])
    for i, arm, held in zip(task.members, task.arms, grasps, strict=True):
        found[i] = evolve(_idle(arm, found[i]), held=held)
    return memory._replace(arms=tuple(found))


def let_go(task: JointTask, memory: Memory) -> Memory:
    """Return the memory with arms of a task that each have a task alone from now on.

    Raises `HoldRefused` for arms that move.
    """
    _require_rest(task, memory)
    found = list(memory.arms)
    for i, arm in zip(task.members, task.arms, strict=True):
        found[i] = evolve(_idle(arm, found[i]), held=None)
    return memory._replace(arms=tuple(found))


def _idle(arm: Arm, memory: ArmMemory) -> ArmMemory:
    """Return the memory of an arm whose task was asked for nothing yet; its gains stay."""
    idle = arm.task.idle
    retreat = None if arm.retreat is None else arm.retreat.start
    return evolve(memory, task=idle._replace(gains=memory.task.gains), retreat=retreat)


def _require_rest(task: JointTask, memory: Memory) -> None:
    for part, arm in zip(task.parts, task.arms, strict=True):
        if not memory.commanded.motion.of(part).stands(AT_REST):
            raise HoldRefused(f"{_name(arm)} moves")


def _name(arm: Arm) -> str:
    """Return how an arm is called: by the mechanism that its joints bear the name of."""
    return arm.p.joints.names[0].partition(".")[0]


# --- The joint tasks of a cell, those of them that are on, and what they mean for the whole tick

LimiterOf = Callable[[tuple[tuple[int, ...], ...]], Limiter]
"""Builds the limiter of a cell in which the joints of groups of arms stop in proportion."""


class JointTasks:
    """The joint tasks of one cell."""

    def __init__(self, cell: Cell, arms: Sequence[Arm], limiter_of: LimiterOf) -> None:
        """Build them. Raises `ConfigError` where grasps do not fit at the start."""
        self.tasks = JointTask.of(cell, arms)
        self._limiter_of = limiter_of
        self._parts = parts_of([arm.p.n for arm in arms])
        # Scratch: limiters by the arms whose joints are a group.
        self._limiters: dict[tuple[tuple[int, ...], ...], Limiter] = {}

    def seeded(self, memory: Memory, on: Collection[str] | None) -> Memory:
        """Return the memory of arms at rest that hold payloads.

        Those of the tasks `on`; of those that are at start, if None.
        """
        q = [memory.commanded.motion.q[part] for part in self._parts]
        for task in self.tasks:
            if task.section.at_start if on is None else task.name in on:
                memory = held_together(task, memory, q, always=True)
        return memory

    def on(
        self,
        memories: Sequence[ArmMemory],
        commanded: Sequence[Commanded],
        inputs: Sequence[Inputs],
    ) -> list[ActiveTask]:
        """Return those that are on, with what they ask of their arms."""
        return [task.ask(memories, commanded, inputs) for task in self.tasks if task.on(memories)]

    def switched(self, name: str, on: bool, memory: Memory, q: Sequence[Array]) -> Memory:
        """Return the memory once a task is on or off; `q` are the measured joints of each arm (n,).

        Raises `HoldRefused` where that is not possible now, `KeyError` for a task that there is
        not.
        """
        task = {task.name: task for task in self.tasks}[name]
        if not on:
            return let_go(task, memory) if task.on(memory.arms) else memory
        return memory if task.on(memory.arms) else held_together(task, memory, q)

    def limiter(self, on: Sequence[ActiveTask]) -> Limiter:
        """Return the limiter of a cell in which these tasks are on."""
        groups = tuple(each.task.members for each in on)
        if groups not in self._limiters:
            self._limiters[groups] = self._limiter_of(groups)
        return self._limiters[groups]


def members_of(on: Sequence[ActiveTask]) -> dict[int, ArmTick]:
    """Return the ticks of arms in joint tasks, by the arms' places."""
    return {i: tick for each in on for i, tick in zip(each.task.members, each.members, strict=True)}


def finish(
    on: Sequence[ActiveTask],
    inputs: Sequence[Inputs],
    memories: list[ArmMemory],
    ticks: Sequence[ArmTick],
) -> None:
    """Put what is common to the arms of each joint task into their memories and ticks."""
    for each in on:
        members = each.task.members
        memories[members[0]] = each.task.finish(
            each,
            inputs[members[0]],
            [memories[i] for i in members],
            [ticks[i] for i in members],
        )
