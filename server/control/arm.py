"""One arm in a tick: the sum of its task's sources as joint rates, and what became of that."""

import math
from collections.abc import Mapping
from functools import partial
from typing import Final, Self

import numpy as np

from ...config.load import Cell
from .actuation.actuation import (
    Actuation,
    BySpeed,
    ByTorque,
    HoldingTorque,
    OnWheels,
    by_position,
)
from .actuation.torque import TorqueLaw
from .axes import FREE_TIME_S, HeldAxes, holding
from .backbone.insertion import BackboneArm
from .barriers.rows import JointLimits
from .bodies.body import Builder, SerialArm
from .bodies.gantry import GantryArm
from .bodies.rates import (
    IN_WORLD,
    NO_LEVER,
    ArmTick,
    Carrier,
    JointRates,
)
from .bodies.wheels import WheeledArm
from .compiled import evolve
from .hold import COMMANDED, MOVED, STANDS, Retreat, Stance, Standing
from .inputs import Inputs, Intent, Pursuit, Settings, VirtualLinks
from .mechanism.model import Dynamics, Mechanism
from .mechanism.redundancy import Field, LinkState, Redundancy, advance_offset, on_path
from .mechanism.resolution import FOLDING, JointMotion, at_posture, bend, resolve
from .mechanism.self_motion import IDLE, LATE, NONE_SPARE
from .mechanism.wrench import ContactWrench, Wrist
from .parameters import Parameters
from .proximity.capsules import Capsules
from .spatial import NO_TWIST, Array, Pose, nonzero, product, sizes, wrench_to
from .state import ArmMemory
from .stop.limiter import Commanded, Limited
from .task.source import Context, Granted
from .task.sources import joint_share
from .task.task import Quantities, Task, TaskMemory

# --- Actuation by operation mode ------------------------------------------------------------------


def actuation(p: Parameters, mechanism: Mechanism) -> Actuation:
    """Return the actuation of a cell's operation mode."""
    if p.operation_mode == "csv":
        return BySpeed(p.joints, p.torque.speed_gain)
    if p.operation_mode != "cst":
        if mechanism.rolling is not None:
            return OnWheels(BySpeed(p.joints, p.torque.speed_gain))
        return by_position
    law = TorqueLaw(
        Dynamics(mechanism, p.rotor_inertia, p.T_wrist_sensor),
        p.torque,
        p.friction,
        p.max_torque,
        p.resolve.characteristic_length,
        p.period_s,
        p.max_torque_rate,
        p.T_wrist_tool,
        p.rated_payload,
    )
    return ByTorque(
        p.joints.names,
        law,
        wrench_of_bias=_wrench_of_bias(p),
        most=p.max_torque,
        most_step=p.max_torque_rate * p.period_s,
    )


def _wrench_of_bias(p: Parameters) -> Array | None:
    """Return what makes a wrench at and in the Wrist of a sensor's bias (6, 6), or None."""
    T = p.T_wrist_sensor
    if T is None:
        return None
    return np.stack([wrench_to(T, column) for column in p.wrench_calibration.T], axis=1)


# --- Joint rates that come beside a task's twists: objectives that are taken whole, and a sweep ---
#
# Williams 1997, eq. 7: dq = J⁺ẋ + (1 − J⁺J) z, with ẋ the sum of all sources. Where an
# objective is taken whole, that is dq = J⁺(ẋ − J z) + z.


def summed(twists: Mapping[str, Array]) -> Array:
    """Return the sum (6,) of the sources' twists."""
    twist = np.zeros(6)
    for part in twists.values():
        if part is not NO_TWIST:
            twist += part
    return twist


def swept(dq: Array, inputs: Inputs) -> Array:
    """Return joint rates (n,) with that of an axis that sweeps."""
    sweep = inputs.beside.sweep
    if sweep is None or inputs.intent is not Intent.MOVE:
        return dq
    dq = dq.copy()
    dq[sweep[0]] = sweep[1]
    return dq


# --- Inputs of a task's sources in one tick, and telemetry of its goal ----------------------------


def context_of(tick: ArmTick, off_path: Array | None, wrist: Wrist) -> Context:
    """Return what the sources see; the virtual link has the tool `off_path` (3,) [m]."""
    inputs, k = tick.inputs, tick.kinematics
    moved = inputs.moved
    return Context(
        inputs=inputs,
        moving=tick.moving,
        guided=tick.moving and inputs.posture is None and inputs.jog is None,
        k=k,
        twist=product(k.J, tick.commanded.motion.dq) + tick.below.twist,
        lever=tick.lever,
        ground=None if moved is None else moved.body(inputs.ground),
        carried=None if moved is None else moved.carries(inputs.ground, k.T_world_mrf.p),
        wrench=tick.wrench,
        hand=tick.hand,
        wrench_at=partial(wrist.contact.at_mrf, tick.wrist.wrench),
        load=tick.wrist.load,
        precedence=tick.precedence,
        off_path=off_path,
        held=tick.held,
    )


def quantities(tick: ArmTick, time_s: float) -> Quantities:
    """Return what gains may depend on; the arm moves for a time [s]."""
    inputs, k, wrench = tick.inputs, tick.kinematics, tick.wrist.wrench.wrench
    target = None if inputs.goal is None else _in_world(inputs, inputs.goal.T_world_target)
    way = None
    if target is not None:
        led = inputs.T_wrist_goal
        way = target.p - (k.T_world_mrf if led is None else k.T_world_wrist @ led).p
    return Quantities(
        contact_force=None if wrench is None else sizes(wrench)[0],
        distance=None if way is None else math.sqrt(float(way @ way)),
        time=time_s,
    )


def path_of_mrf(inputs: Inputs, T: Pose | None) -> Pose | None:
    """Return where the path has the MRF in World, from where it has the point that it leads."""
    T, led = _in_world(inputs, T), inputs.T_wrist_goal
    if T is None or led is None:
        return T
    return T @ (led.inverse() @ inputs.settings.T_wrist_mrf)


def _in_world(inputs: Inputs, T: Pose | None) -> Pose | None:
    """Return where a pose on the present ground is in World."""
    ground = None if inputs.moved is None else inputs.moved.body(inputs.ground)
    return T if ground is None or T is None else ground.T @ T


# --- One arm --------------------------------------------------------------------------------------

LATELY = 0.9
"""Share that is left after a tick of the greatest acceleration that the tool was told [1]."""

STANDING = 1e-9
"""Joint rates [rad/s] and accelerations [rad/s²] below this are rounding, not motion."""

BODIES: Final = (BackboneArm, WheeledArm, GantryArm, SerialArm)
"""Kinds of bodies; a mechanism's is the first that the cell has a section for."""

TOUCHING = 3e-3
"""Force control that asks for more than this answers a contact, and no noise [m/s, rad/s]."""


class Arm:
    """One mechanism with its task. Holds constants and scratch memory only, no state of a run."""

    def __init__(self, p: Parameters, mechanism: Mechanism, build: Builder = SerialArm) -> None:
        """Build it; `build` makes its body."""
        self.p, self.mechanism = p, mechanism
        self.shared: Capsules | None = None
        """The arm's capsules, where barriers look at the same ones: they are placed once."""
        T, joints = p.period_s, p.joints
        self.task = Task(p.sources, p.schedules, p.shaping)
        if (held := holding(p.resolve.free_axes)) is not None:
            mechanism.held_ranks(held == 1.0, p.T_wrist_tool)  # known before a tick asks for it
        contact = ContactWrench(
            p.T_wrist_sensor or Pose.identity(),
            p.wrench_smoothing,
            T,
            p.wrench_calibration,
            p.wrench_inertia,
            p.limits.acceleration,
        )
        self.wrist = Wrist(contact, p.payload, T)
        dynamics = Dynamics(mechanism, p.rotor_inertia, p.T_wrist_sensor)
        self.redundancy = Redundancy(joints, dynamics, p.redundancy, p.pull_posture)
        field = Field(joints, p.potential, p.capsules, mechanism.rank)
        self.links = field.links
        """Virtual links of the cell file; None without any."""
        self.body = build(p, mechanism, self.redundancy, field)
        room = JointLimits(joints, T)
        self.joint_motion = JointMotion(joints.velocity, room.approach)
        self.retreat = None
        if p.retreat_leash is not None:
            self.retreat = Retreat(
                p.retreat_leash, T, bound=self.body.on_curve, gives_way=p.gives_way
            )
        self.standing = Standing(p.avoidance, p.capsules, joints.velocity)
        self.actuate = actuation(p, mechanism)
        self.holding = HoldingTorque(
            Dynamics(mechanism, p.rotor_inertia, p.T_wrist_sensor),
            None if p.T_wrist_sensor is None else p.payload,
        )

    @classmethod
    def of(cls, cell: Cell) -> Self:
        """Build that of a cell's only mechanism. Raises `ConfigError`."""
        p, mechanism = Parameters.from_cell(cell), Mechanism.from_cell(cell)
        builders = (kind.builder(cell) for kind in BODIES)
        return cls(p, mechanism, next(build for build in builders if build is not None))

    def seed(self) -> ArmMemory:
        """Return the memory of an arm that was told nothing yet."""
        return ArmMemory(
            objectives=self.redundancy.objectives,
            task=self.task.idle,
            retreat=None if self.retreat is None else self.retreat.start,
        )

    def seeded(self, memory: ArmMemory) -> ArmMemory:
        """Return the same, but for what the torque law and a grasp remember."""
        return evolve(self.seed(), torque=memory.torque, held=memory.held)

    def solve(self, memory: ArmMemory, commanded: Commanded, inputs: Inputs) -> ArmTick:
        """Return what the task asks of the joints."""
        tick = self.ask(memory, commanded, inputs)
        self.answer(tick)
        return tick

    def ask(
        self,
        memory: ArmMemory,
        commanded: Commanded,
        inputs: Inputs,
        carrier: Carrier = IN_WORLD,
    ) -> ArmTick:
        """Return what the task asks of the tool, or of the joints where they are commanded.

        It is not known yet what of that the arm's own joints do.
        """
        moved = inputs.moved
        self.body.prepare(inputs.settings)
        T_world_wrist_measured = self.mechanism.pose_wrist(
            inputs.q_measured, None if moved is None else moved.T_world_base_measured
        )
        wrist = self.wrist.measure(
            memory.wrist, inputs, T_world_wrist_measured, memory.max_tool_acceleration
        )
        if inputs.intent is Intent.SEED:
            memory = self.seeded(memory)
        motion, mrf = commanded.motion, inputs.settings.T_wrist_mrf
        base = None if moved is None else moved.base.T
        k = self.mechanism.kinematics(motion.q, mrf, base)
        placed, near = None, memory.near
        if self.shared is not None and inputs.settings.avoid:
            placed = self.shared.place(motion.q[None], base)
        if self.p.priority is not None:
            near = self.p.priority.look(motion.q, inputs.scene, near, base)
        wrench, hand = self.wrist.contact.at_mrf(wrist.wrench, mrf)
        tick = ArmTick(
            inputs,
            k,
            T_world_wrist_measured,
            commanded.sent[1] - inputs.q_measured,
            commanded,
            # A new MRF is no new point of the tool: singularities and rates are told there.
            lever=product(k.T_world_wrist.R, self.p.T_wrist_tool.p - mrf.p),
            wrench=wrench,
            hand=hand,
            wrist=wrist,
            placed=placed,
            near=near,
            T_world_base=base,
            below=carrier.at(k.T_world_mrf.p),
            insertion=memory.insertion,
            by_hand=memory.by_hand,
            settled=inputs.at_posture,
            retreat=memory.retreat,
            grasp=memory.held,
            resistance=memory.resistance,
        )
        self.tuned(memory, tick)
        task = tick.task
        if self.links is not None:
            tick.links = self._links(memory, inputs, self.links)
        if task.held is not None:
            ranks = self.mechanism.held_ranks(task.held == 1.0, mrf)
            tick.held = HeldAxes.of(task.held, k.T_world_mrf.R, ranks)
        context = context_of(tick, task.off_path, self.wrist)
        if (folding := self._whole(tick)) is not None:
            context = context._replace(folding=folding)
        task, twists = self.task.twists(task, context)
        take: Array | None = None
        if context.guided:
            task, take = self.task.eased(task, twists, context.wrench, k.T_world_mrf.R)
        if take is not None:
            twists = {**twists, "force": twists["force"] + take}
        tick.task, tick.twists, tick.off_path = task, twists, task.off_path
        if tick.links is not None:
            tick.way = task.position.way
        tick.stance = stance = self._stance(memory, tick)
        if tick.settled and stance.alert and self._roused(stance, inputs):
            tick.objectives, tick.settled = self.standing.of_outside(tick.gains), False
        self.led(tick)
        if take is not None:
            tick.limits += ("press",)
        return tick

    def answer(self, tick: ArmTick, carried: Array = NO_TWIST) -> None:
        """Resolve what is asked for, as `solve` does.

        Others carry the tool at a twist `carried` (6,), which the joints need not do.
        """
        self._resolve(tick, carried)
        self._come_back(tick)
        tick.dq_asked = swept(tick.dq_asked, tick.inputs)
        self._give_way(tick)
        share = self.body.wall_scale(tick)
        if share < 1.0:
            tick.dq_asked, tick.limits = share * tick.dq_asked, (*tick.limits, "wall")

    # --- gains -------------------------------------------------------------------------------

    def tuned(self, memory: ArmMemory, tick: ArmTick) -> None:
        """Write to the tick the gains of sources and objectives, and since when the arm moves.

        Gains are scheduled, and ramped while the arm may move. While an operator moves the spare
        joints, only objectives that look at obstacles act.
        """
        inputs, settings, moving = tick.inputs, tick.inputs.settings, tick.moving
        objectives = settings.objectives or self.redundancy.objectives
        since_s = memory.moving_since_s if memory.moving_since_s is not None else inputs.time_s
        tick.task = self.task.tuned(
            memory.task,
            settings.gains,
            lambda: quantities(tick, inputs.time_s - since_s),
            moving,
            settings.at_once,
            settings.held,
        )
        if moving and (inputs.self_motion.acts or memory.by_hand.moves):
            objectives = self.standing.of_outside(objectives)
        if moving and memory.task.gains:
            objectives = self.redundancy.ramped(memory.objectives, objectives, self.task.part)
        tick.gains = tick.objectives = objectives
        tick.moving_since_s = since_s if moving else None

    def _links(self, memory: ArmMemory, inputs: Inputs, own: VirtualLinks) -> LinkState:
        """Return the virtual links in effect, `own` ones where no others were told.

        They change smoothly while the arm moves.
        """
        told, before = inputs.settings.links or own, memory.links
        if before is None or inputs.intent is not Intent.MOVE:
            return LinkState(told)
        return before.changed(told, self.p.period_s / FREE_TIME_S)

    # --- what is asked for -------------------------------------------------------------------

    def resolved(self, tick: ArmTick) -> ArmTick:
        """Resolve the sum of the sources' twists, or take joint rates where those are commanded."""
        self.led(tick)
        self._resolve(tick)
        return tick

    def led(self, tick: ArmTick) -> None:
        """Sum the sources' twists, or take joint rates where those are commanded."""
        inputs, twists = tick.inputs, tick.twists
        twist, k, q = summed(twists), tick.kinematics, tick.commanded.motion.q
        left = twist
        if tick.whole:
            apart = {name: twists[name] - k.J @ z for name, z in tick.whole.items()}
            left = summed({**twists, **apart})  # what the others ask for is to the last bit
        if (held := tick.held) is not None:
            # The rows belong to the MRF: singularities are judged there, too.
            twist, left = held.part(twist), held.part(left)
            tick.lever = NO_LEVER
        factor = inputs.settings.speed_factor
        joint_rates: Array | None = None
        if inputs.intent is Intent.MOVE:
            joint_rates = self.joint_motion.rates(q, inputs.jog, inputs.posture, factor)
            if joint_rates is not None:
                bounds = self.p.limits
                most = bounds.posture_speed if inputs.jog is None else bounds.jog_speed
                share = self.tool_share(k.J @ joint_rates, factor, most)
                if share < 1.0:
                    joint_rates, tick.limits = share * joint_rates, ("tool_speed",)
            if joint_rates is not None and inputs.jog is None:
                joint_rates = self.body.with_drive(joint_rates, inputs.drive, factor)
        if joint_rates is not None:
            relief = twists["force"]
            tick.twists = {**dict.fromkeys(twists, NO_TWIST), "force": relief}
            if relief is not NO_TWIST and tick.wrench is not None:
                joint_rates = self._relieved(joint_rates, relief, k.J, tick.wrench)
            twist = k.J @ joint_rates
        tick.twist, tick.scale = twist, self.tool_share(twist, factor)
        if tick.scale < 1.0:
            tick.limits = ("tool_speed",)
        if joint_rates is not None:
            tick.by_joint, tick.dq_asked = True, tick.scale * joint_rates
            return
        if inputs.settings.contact_share < 1.0:
            tick.scale *= inputs.settings.contact_share
            tick.limits += ("contact",)
        tick.asked = left if tick.scale == 1.0 else tick.scale * left
        if tick.led_by_hand:
            self._led_by_hand(tick)

    def _resolve(self, tick: ArmTick, carried: Array = NO_TWIST) -> None:
        """Resolve a twist less what others carry the tool at (6,)."""
        if tick.by_joint:
            tick.found = JointRates(tick.dq_asked, self.redundancy.none())
            return
        inputs, k, held = tick.inputs, tick.kinematics, tick.held
        if carried is not NO_TWIST:
            tick.asked = tick.asked - (carried if held is None else held.part(carried))
        tick.found = found = self.body.rates(tick)
        tick.dq_asked = found.dq
        for z in tick.whole.values():
            tick.dq_asked = tick.dq_asked + tick.scale * z
        if held is not None:
            # Self-motion moves the tool along axes that are free.
            share = self.tool_share(k.J @ tick.dq_asked + carried, inputs.settings.speed_factor)
            if share < 1.0:
                tick.dq_asked, tick.scale = share * tick.dq_asked, share * tick.scale
                tick.limits += ("tool_speed",)
        tick.limits += found.limits
        idle = found.by_hand is IDLE
        if inputs.self_motion.orders and idle and NONE_SPARE not in tick.limits:
            tick.limits += (NONE_SPARE,)

    def _led_by_hand(self, tick: ArmTick) -> None:
        """Ask for what an operator who moves the spare joints leaves to do.

        Obstacles are looked at at a posture, too. The twist that the spare joints move the tool by,
        since their rates come late, is taken off.
        """
        if tick.settled:
            tick.settled, tick.objectives = False, self.standing.of_outside(tick.objectives)
        going = tick.by_hand.going
        if len(going) > 0:
            slides = bend(tick.kinematics.J, going, going, 1.0)
            tick.asked = tick.asked - LATE * self.p.period_s * slides

    def _whole(self, tick: ArmTick) -> Array | None:
        """Write what is taken whole; return the twist (6,) of an arm that folds, at a gain of 1.

        None: it does not fold, as joints that are led themselves.
        """
        inputs, q, J = tick.inputs, tick.commanded.motion.q, tick.kinematics.J
        fold = inputs.beside.fold
        led = inputs.posture is not None or inputs.jog is not None
        if fold is None or led or not tick.moving:
            return None
        z = self.joint_motion.folding(fold, q, J, inputs.settings.speed_factor)
        tick.whole = self.redundancy.whole(q, J, tick.objectives, {FOLDING: z})
        return np.asarray(J @ z)

    def _relieved(self, joint_rates: Array, relief: Array, J: Array, wrench: Array) -> Array:
        """Return commanded joint rates (n,) in contact: less of them into it, and what relieves it.

        `relief` (6,) is the twist that force control asks for, `wrench` (6,) what the arm exerts.
        All joints relieve it, as quick as they are: no attitude of the tool is asked for.
        """
        towards = J[:3].T @ relief[:3]
        if float(towards @ joint_rates) < 0.0:
            threshold = self.p.sources.force.hold_threshold
            joint_rates = joint_share(sizes(wrench)[0], threshold) * joint_rates
        back = self.body.relief * towards
        speed, along = float(relief[:3] @ relief[:3]), float(towards @ back)
        most = float((self.p.joints.velocity / np.maximum(np.abs(back), 1e-12)).min())
        return np.asarray(joint_rates + min(speed / max(along, 1e-12), most) * back)

    def _stance(self, memory: ArmMemory, tick: ArmTick) -> Stance:
        """Return how the arm meets what comes: as one that is told to move, or one that stands."""
        q, T_world_mrf, inputs = tick.commanded.motion.q, tick.T_world_mrf, tick.inputs
        moving, pushed = tick.moving, inputs.pushed
        if moving and self._told(tick):
            return COMMANDED
        standing, station = self.standing, memory.station
        felt = pushed is not None and pushed.touched
        # Where Base moves, joints that stand are nowhere in World.
        held = inputs.intent is Intent.HOLD
        if felt or inputs.moved is not None or not standing.may_leave(moving, held):
            return STANDS
        led = inputs.goal is not None
        if station is not None and standing.is_home(station, q, T_world_mrf.p, led):
            station = None
        return standing.stance(station, q, tick.placed)

    def _told(self, tick: ArmTick) -> bool:
        """Return whether the arm is told to move; staying where a goal has led it is not."""
        position, twists, inputs = tick.task.position, tick.twists, tick.inputs
        over = position.path is not None and position.path.finished
        if isinstance(inputs.goal, Pursuit) or not (over or inputs.paused):
            return self.motion_commanded(twists, inputs)
        return self.motion_commanded({**twists, "position": NO_TWIST}, inputs)

    def _roused(self, stance: Stance, inputs: Inputs) -> bool:
        """Return whether an arm at a posture looks for a better one: something comes, or came."""
        comes = inputs.scene is not None and inputs.scene.comes
        return inputs.intent is Intent.MOVE and (comes or stance.station is not None)

    def _come_back(self, tick: ArmTick) -> None:
        """Add the way back of an arm that is off its station, where no goal leads it there.

        Contact holds it: what is there now may not be known.
        """
        stance, station = tick.stance, tick.stance.station
        if station is None:
            return
        tick.limits += ("off_station",)
        if tick.twists["position"] is NO_TWIST and max(sizes(tick.twists["force"])) < TOUCHING:
            standing, factor, k = self.standing, tick.inputs.settings.speed_factor, tick.kinematics
            back = standing.back(station, tick.commanded.motion.q, k.J, factor)
            if stance.tool_stays:
                twist = factor * standing.tool_back(station, k.T_world_mrf)
                found = resolve(k.J, twist, self.p.resolve, None, self.mechanism.rank)
                back = found.dq + found.null.T @ (found.null @ back)
            tick.dq_asked = tick.dq_asked + back

    def _give_way(self, tick: ArmTick) -> None:
        """Add what gives way after a touch to the joint rates asked for."""
        state, retreat = tick.retreat, self.retreat
        if retreat is None or state is None:
            return
        inputs, error, J, leash = tick.inputs, tick.error, tick.kinematics.J, self.p.joints.leash
        q, now_s, held = tick.commanded.motion.q, inputs.time_s, inputs.intent is Intent.HOLD
        relieving = tick.by_joint and bool(tick.twists["force"].any())
        held_up: Array | float = 0.0
        if held:
            held_up = np.where(2.0 * np.abs(error) > leash, np.sign(error), 0.0)
        state, dq = retreat.step(
            state, q, tick.dq_asked, J, inputs.pushed, now_s, held, relieving, held_up
        )
        if held:
            state, dq = retreat.yielded(state, dq, error, leash)
        tick.retreat, tick.dq_asked = state, dq

    def motion_commanded(self, twists: Mapping[str, Array], inputs: Inputs) -> bool:
        """Return whether anything but accommodation tells the arm to move.

        News of obstacles needs no lease: it shall lead no arm away that nobody tells to move.
        """
        told = inputs.jog is not None or inputs.posture is not None or inputs.self_motion.orders
        told = told or nonzero(inputs.wrench_desired)
        return told or self.task.orders(twists)

    def tool_share(self, twist: Array, factor: float, most: float = math.inf) -> float:
        """Return the share (0 to 1) of a twist (6,) that the tool's speed bounds allow.

        `most` bounds its speed, too [m/s].
        """
        v, w = sizes(twist)
        limits = self.p.limits
        return min(
            1.0,
            factor * min(limits.speed, most) / max(v, 1e-12),
            factor * limits.angular_speed / max(w, 1e-12),
        )

    # --- what barriers have to know, and what became of it ----------------------------------

    def before_barriers(self, tick: ArmTick, beside: bool) -> None:
        """Tell the barriers what they have to know; `beside` tells whether clearances are kept."""
        k = tick.kinematics
        path = self.body.path(k, tick.inputs.ground == "base")
        if len(tick.below.dq) and not tick.led_in_world:
            path = k.J
        if tick.held is not None and not tick.by_joint:
            path = tick.held.keep @ (tick.tool_jacobian(slice(0))[0] if path is None else path)
        tick.path = path
        tick.motion_commanded = not beside or self.motion_commanded(tick.twists, tick.inputs)

    def finish(
        self,
        memory: ArmMemory,
        tick: ArmTick,
        limited: Limited,
        part: slice,
    ) -> ArmMemory:
        """Write to the tick what to send, once it is decided how joints move; return the memory.

        `memory` is the one that the tick began with; the arm's joints are a `part` of those that
        are `limited`.
        """
        inputs, motion, found = tick.inputs, limited.motion.of(part), tick.found
        tick.motion, tick.stop_worsened = motion, limited.worsened
        tick.limits += ("verified_stop",) if limited.stopped else ()
        torque = self.actuate(tick, memory.torque)
        station = tick.stance.station
        leaves = inputs.at_posture and max(found.self_motion.norms.values(), default=0.0) > MOVED
        if station is None and tick.stance.alert and (tick.made_way or leaves):
            station = self.standing.begun(tick.commanded.stop, tick.T_world_mrf)
        lately = 0.0 if inputs.intent is Intent.SEED else LATELY * memory.max_tool_acceleration
        tick.task = self._advanced(tick, limited.stopped)
        tick.at_rest, tick.at_goal = motion.stands(STANDING), self._at_goal(tick)
        tick.T_world_mrf_measured = tick.T_world_wrist_measured @ inputs.settings.T_wrist_mrf
        tick.bleeding = tick.task.force.bleeding
        tick.T_world_path = path_of_mrf(inputs, tick.task.position.T_world_path)
        return ArmMemory(
            objectives=tick.gains,
            task=tick.task,
            wrist=tick.wrist,
            max_tool_acceleration=max(sizes(product(tick.kinematics.J, motion.ddq))[0], lately),
            moving_since_s=tick.moving_since_s,
            near=tick.near,
            torque=torque,
            retreat=tick.retreat,
            station=station,
            resistance=tick.resistance,
            held=tick.grasp,
            insertion=found.insertion,
            by_hand=found.by_hand.along(motion.dq),
            links=tick.links,
        )

    def _advanced(self, tick: ArmTick, stopped: bool) -> TaskMemory:
        """Return the task's next memory, by what of its motion and its path's was granted."""
        T_world_mrf, task, pace = tick.T_world_mrf, tick.task, tick.scale * tick.pace
        granted = Granted.of(tick.granted, pace, tick.twist, T_world_mrf, stopped=stopped)
        off_path = advance_offset(
            task.off_path, tick.found.give_way, granted.share * self.p.period_s
        )
        return self.task.advanced(task, granted, off_path)

    def _at_goal(self, tick: ArmTick) -> bool:
        inputs = tick.inputs
        if inputs.intent is not Intent.MOVE:
            return False
        if inputs.posture is not None:
            return at_posture(tick.q, inputs.posture)
        if (arrived := self.body.arrived(tick.found.insertion, inputs.drive)) is not None:
            return arrived
        return tick.task.position.at_goal and on_path(tick.task.off_path)

    # --- what others ask of an arm ----------------------------------------------------------

    def weight(self, T_world_mrf: Pose, settings: Settings) -> Array:
        """Return the sensor reading (6,) of the payload's weight with the MRF at a pose."""
        mrf, payload, bias = settings.T_wrist_mrf, settings.payload, settings.wrench_bias
        return self.wrist.weight(T_world_mrf, mrf, payload, bias)

    def locked_joints(self, memory: ArmMemory) -> dict[str, float]:
        """Return the angles of joints that stand and do not follow, by name [rad].

        Looked for where an arm goes through a tunnel, and cannot leave its curve.
        """
        locked = None if memory.insertion is None else memory.insertion.locked
        if locked is None:
            return {}
        each = zip(self.p.joints.names, locked.tolist(), strict=True)
        return {name: angle for name, angle in each if not math.isnan(angle)}
