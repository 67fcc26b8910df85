"""One arm of the cell and its task: what is commanded, perceived and computed for it."""

import math
from functools import partial
from typing import Final, Self

import numpy as np

from ...config.load import Cell
from ...protocols.canopen.cia402 import DriveState
from ..commands.commands import Commands, SelfMotionCommands
from ..commands.settings import CellSettings
from ..control.arm import Arm
from ..control.backbone.fit import Chain
from ..control.bodies.rates import ArmTick
from ..control.compiled import evolve
from ..control.forest import standing_on
from ..control.grasps import GraspStatus
from ..control.inputs import (
    NOTHING,
    STILL,
    UNASKED,
    Fold,
    Inputs,
    Intent,
    JointFeedforward,
    SelfMotionRequest,
)
from ..control.mechanism.model import Mechanism
from ..control.mechanism.resolution import bend
from ..control.scene import Body, Moved
from ..control.spatial import Array, Motion, Pose, jacobian_at, largest
from ..control.state import ArmMemory
from ..events import Events
from ..mode import Mode
from ..perception.ahead import Passage
from ..perception.cameras import Law
from ..perception.contact import JamMonitor
from ..perception.obstacle_map import ObstacleMap
from ..perception.perception import Perception
from ..plant import UnitReading

# --- Assembly of the tick's inputs from reading, commands and perception --------------------------

ENABLED: Final = DriveState.OPERATION_ENABLED

INTENTS = {
    Mode.BOOT: Intent.SEED,
    Mode.READY: Intent.SEED,
    Mode.ENABLED: Intent.MOVE,
    Mode.STOPPING: Intent.STOP,
    Mode.HOLD: Intent.HOLD,
    Mode.FAULT: Intent.SEED,
}
"""The tick's permission in each mode."""


def tick_inputs(
    asked: Inputs,
    mode: Mode,
    tick: int,
    reading: UnitReading,
    q: Array,
    perception: Perception,
    obstacles: ObstacleMap,
    moved: Moved,
) -> Inputs:
    """Return the inputs of a tick: what is `asked` for, as far as the mode lets it, and measured.

    `q` (n,) are the measured joints [rad], `moved` the grounds. Sources and goals act in ENABLED
    only; in the other modes the arm may give way to contact.
    """
    intent, withdraws = INTENTS[mode], perception.collisions.release.withdraws
    moving, drive = intent is Intent.MOVE, asked.drive
    if not moving:
        drive = STILL
        asked = evolve(
            asked,
            stick=None,
            jog=None,
            goal=None,
            posture=None,
            beside=NOTHING,
            self_motion=UNASKED,
        )
    if withdraws:
        # Once touched, an arm in tunnels may withdraw as a curve, and do nothing else.
        drive = drive._replace(back_only=True)
        asked = evolve(asked, jog=None, posture=None, self_motion=UNASKED)
    grounds_move = perception.moving_frames.watching
    return evolve(
        asked,
        intent=intent,
        q_measured=q,
        energised=np.array([s is ENABLED for s in reading.states]),
        wrench_sensor=reading.wrench,
        wrench_age_s=reading.wrench_lag_s,
        wrench_mean=reading.wrench_over_period,
        view=perception.vision.goal(moved.base.T) if moving else None,
        scene=obstacles.scene(tick) if obstacles.known else None,
        moved=moved if grounds_move else None,
        ground=asked.ground if grounds_move else "world",
        drive=drive,
        pushed=None if moving else perception.collisions.release.pushed,
    )


# --- The axis that sweeps to and fro: the rate at which it is asked to go, tick by tick -----------

GAIN: Final = 4.0
"""Approach to where the sweep has it [1/s]."""
MOST: Final = 0.9
"""Share of the joint's speed bound that a sweep takes at most [1]: others shall not wait for it."""


class SweptAxis:
    """One axis: which joint, and where it should be now."""

    def __init__(
        self,
        joint: int,
        low: float,
        high: float,
        period_s: float,
        velocity: float,
        control_period_s: float,
    ) -> None:
        self.joint = joint
        """Its place among the joints of its mechanism."""
        self._low, self._high = low, high
        self._rate = 2.0 * (high - low) / period_s
        self._velocity, self._period_s = velocity, control_period_s
        self._at, self._up = low, True

    @classmethod
    def from_cell(cls, cell: Cell) -> Self | None:
        """Return that of a mechanism; None where nothing sweeps."""
        mechanism = cell.config.mechanism
        sweep = mechanism.sweep
        if sweep is None:
            return None
        joint = [j.name for j in cell.robot.joints].index(sweep.joint)
        return cls(
            joint,
            sweep.low,
            sweep.high,
            sweep.period_s,
            mechanism.drives[joint].max_velocity,
            cell.config.timing.period_s,
        )

    def rate(self, q: float, factor: float) -> float:
        """Return the rate [rad/s] for the next period; the axis is commanded to be at q [rad].

        `factor` is the reduced-speed setting: then it sweeps as quickly as it may.
        """
        most = MOST * factor * self._velocity
        rate = min(self._rate, most)
        ahead = rate * self._period_s
        self._at += ahead if self._up else -ahead
        if self._at > self._high:
            self._at, self._up = 2.0 * self._high - self._at, False
        elif self._at < self._low:
            self._at, self._up = 2.0 * self._low - self._at, True
        asked = (rate if self._up else -rate) + GAIN * (self._at - q)
        return min(max(asked, -most), most)


# --- Effect of a contour ahead on a tick: a base that is driven ahead slows down, the arm folds ---
#
# An axis that sweeps goes on sweeping. Avoidance switched off leaves the rest to the operator.


class LookingAhead:
    """The reflex of one arm, between what operators ask for and the tick."""

    def __init__(self, sweep: SweptAxis | None, speed: float) -> None:
        """Build it; the tool folds at most at a speed [m/s]."""
        self._sweep, self._speed = sweep, speed

    @classmethod
    def from_cell(cls, cell: Cell) -> Self | None:
        """Return that of a cell; None for one that neither sweeps nor looks ahead."""
        sweep, contour = SweptAxis.from_cell(cell), cell.config.contour
        if sweep is None and contour is None:
            return None
        return cls(sweep, 0.0 if contour is None else contour.speed)

    def applied(
        self,
        asked: Inputs,
        passage: Passage | None,
        q: Array,
        tick: int,
        way: float = 0.0,
        *,
        cleared: bool = False,
    ) -> Inputs:
        """Return what is asked for with that applied; joints are commanded to be at q (n,).

        `way` [m] is how far the base's wheels have rolled, `cleared` whether clearances limited the
        last tick.
        """
        fold = None
        if passage is not None and asked.settings.avoid:
            passage.follow(asked.drive.speed, way, tick, cleared=cleared)
            drive, share = asked.drive, passage.share(asked.drive.speed)
            turn = passage.turn(drive.speed, drive.turn)
            if share < 1.0 or turn != drive.turn:
                # In proportion: it stays on the arc that it is driven on.
                drive = drive._replace(speed=share * drive.speed, turn=share * turn)
                asked = evolve(asked, drive=drive)
            posture = passage.posture(tick)
            if posture is not None:
                # Nothing else leads the spare joints meanwhile.
                fold, asked = Fold(posture, self._speed), evolve(asked, at_posture=True)
        if self._sweep is None:
            return evolve(asked, beside=JointFeedforward(fold))
        joint, factor = self._sweep.joint, asked.settings.speed_factor
        sweep = (joint, self._sweep.rate(float(q[joint]), factor))
        if asked.posture is not None:
            posture = asked.posture.copy()
            posture[joint] = q[joint]
            asked = evolve(asked, posture=posture)
        return evolve(asked, beside=JointFeedforward(fold, sweep))


# --- One arm of the cell and its task: what is commanded, perceived and computed for it -----------

LED = 1e-3
"""A hand that asks for more than this leads the tool [m/s, rad/s]."""


class Unit:
    """Commands, perception and memory of one arm; `joints`: where its own are among the cell's."""

    def __init__(
        self, cell: Cell, arm: Arm, joints: slice, settings: CellSettings, events: Events
    ) -> None:
        """Build it for one part of a cell; `settings` are those that all units share."""
        self.cell, self.arm, self.joints = cell, arm, joints
        self.events = events.of(cell.prefix.removesuffix("."))
        self.task, self.mechanism = cell.task, cell.config.mechanism.name
        self.commands = Commands.from_cell(cell, settings)
        self.commands.self_motion = SelfMotionCommands(
            cell.config.timing.stream_timeout_s,
            self._spare,
            arm.body.by_hand.most,
            angled=arm.mechanism.arm_angle is not None,
        )
        self.ahead = LookingAhead.from_cell(cell)
        """The reflex to what is ahead, and the scanner's axis; None without either."""
        self.perception = Perception(cell, arm, self.commands, self.events)
        self.vision = self.perception.vision
        """The views of its cameras, as far as known."""
        self.jam = JamMonitor(cell.config.timing.period_s, self.events)
        """Whether contact holds up what is asked of the tool."""
        self.memory: ArmMemory | None = None
        """None before the arm's joints were heard, and after its devices were configured anew."""
        self.q: Array | None = None
        """Where the joints (n,) were measured last [rad]."""
        self.output: ArmTick | None = None
        """Results of the last tick; None before the first."""

    @property
    def commanded(self) -> Motion | None:
        """What the joints were last told; None before they were heard, and once that is void."""
        return None if self.memory is None or self.output is None else self.output.motion

    @property
    def grasps(self) -> dict[str, GraspStatus]:
        """Grasps of one payload: a joint task's alone."""
        return {}

    def keep_view(self, camera: str | None, *, again: bool, law: Law | None) -> dict[str, float]:
        """Keep a camera's view of now, or its stored one; return it. Raises `Refused`."""
        return self.vision.store(camera, again=again, law=law)

    @property
    def T_world_mrf(self) -> Pose | None:
        """Where the command has the MRF in force; None before the joints were heard."""
        return None if self.output is None else mrf_in_force(self.output, self.commands)

    @property
    def arm_angle(self) -> float | None:
        """Where the commanded elbow is on its circle [rad]; None where it is on none."""
        reader = self.arm.mechanism.arm_angle
        if reader is None or self.output is None:
            return None
        angle = reader.look(self.output.kinematics).angle
        return None if math.isnan(angle) else angle

    def holding(self, q: Array) -> Array:
        """Return the torques (n,) that hold the arm at rest at q (n,) [N·m]."""
        payload, moved = self.commands.settings.payload, self.commands.frames.moved
        return self.arm.holding(q, payload, moved.T_world_base_measured.R)

    def stand_on(self, torso: "Unit", told: Motion, q: Array) -> None:
        """Bring Base to where the torso has it that is `told` a motion, and measured at q (n,)."""
        mechanism, T_on = torso.arm.mechanism, standing_on(self.cell)
        k = mechanism.kinematics(told.q, Pose.identity())
        base = k.T_world_wrist @ T_on
        at_base = jacobian_at(k.J, base.p - k.T_world_mrf.p)
        acceleration = at_base @ told.ddq + bend(at_base, told.dq, told.dq, 1.0)
        self.commands.frames.moved = self.perception.moving_frames.carry(
            Moved(
                Body.standing(base),
                self.commands.frames.moved.carrier,
                mechanism.pose_wrist(q) @ T_on,
                acceleration,
            )
        )

    def perceive(self, reading: UnitReading, mode: Mode, now_s: float) -> None:
        """Update all monitors."""
        self.q = reading.q if reading.q is not None else self.q
        self.perception.update(reading, self.memory, self.output, mode, now_s)

    @property
    def base_measured(self) -> Pose | None:
        """Where a Base that may move was measured last; None for one that stands."""
        moving, moved = self.perception.moving_frames.watching, self.commands.frames.moved
        return moved.T_world_base_measured if moving else None

    def follow_frames(self, tick: int, mode: Mode) -> None:
        """Bring the frames that may move up to this tick."""
        if not self.perception.moving_frames.watching:
            return
        moving = mode in (Mode.ENABLED, Mode.STOPPING)
        self.commands.frames.moved = self.perception.moving_frames.step(
            tick, moving=moving, commanded=self.commanded, q=self.q
        )

    def inputs(
        self,
        q_command: Array,
        mode: Mode,
        tick: int,
        now_s: float,
        reading: UnitReading,
        q: Array,
        obstacles: ObstacleMap,
    ) -> Inputs:
        """Return what this tick may look at; joints (n,) as commanded and as measured [rad]."""
        commands, perception = self.commands, self.perception
        moved = commands.frames.moved
        asked = commands.in_force(now_s, partial(self._place_mrf, q_command))
        if asked.posture is not None:
            posture = self.arm.body.posture(asked.posture, q_command)
            asked = evolve(asked, posture=posture)
        if self.ahead is not None and mode is Mode.ENABLED:
            limits = () if self.output is None else self.output.limits
            asked = self.ahead.applied(
                asked,
                perception.passage,
                q_command,
                tick,
                self.arm.body.ahead(q_command),
                cleared=any(name.startswith("clearance") for name in limits),
            )
        return tick_inputs(asked, mode, tick, reading, q, perception, obstacles, moved)

    def _place_mrf(self, q_command: Array) -> Pose:
        """Return where joints that are commanded to be at q (n,) [rad] have the MRF in force."""
        frames = self.commands.frames
        base = frames.moved.base.T if self.perception.moving_frames.watching else None
        return self.arm.mechanism.pose_wrist(q_command, base) @ frames.T_wrist_mrf

    @property
    def blind(self) -> bool:
        """True while the base goes ahead, and nobody looks there."""
        passage, commanded = self.perception.passage, self.commanded
        if passage is None or commanded is None:
            return False
        return passage.blind(self.arm.body.ahead(commanded.dq))

    def _spare(self) -> int:
        """Return how many freedoms the task of now leaves to an operator."""
        settings, insertion = self.commands.settings.for_control(), None
        if self.memory is not None:
            insertion = self.memory.insertion
        held, ranks = settings.held, None
        if held is not None:
            ranks = self.arm.mechanism.held_ranks(held == 1.0, settings.T_wrist_mrf)
        return self.arm.body.spare(insertion, ranks)

    def keep(self, tick: int, memory: ArmMemory, output: ArmTick) -> None:
        """Take in what a tick decided."""
        commands, goals = self.commands, self.commands.goals
        self._tell_station(memory, output)
        if commands.self_motion.goal is not None:
            self._tell_arm_angle(commands.self_motion.goal, tick, output)
        self.memory, self.output = memory, output
        if commands.reflector is not None:
            commands.reflector.reflect(
                output.wrench,
                output.task.gains,
                output.T_world_mrf_measured.R,
                commands.master.translation,
                goals.pursuing,
            )
        if self.vision.watching:
            self.perception.remember(tick, output)
        # A payload's jam is told by its own task.
        self.jam.update(output if output.holding is None else None)
        if output.at_goal and goals.posture is not None:
            goals.finish_posture()
            self.events.info("posture_reached")
        elif goals.at_rest and largest(output.twists["following"]) > LED:
            goals.led_by_hand()

    def _tell_station(self, memory: ArmMemory, output: ArmTick) -> None:
        """Tell when an arm that stands makes way for something that comes, and is back."""
        before = None if self.memory is None else self.memory.station
        if before is None and memory.station is not None:
            gaps = [gap for gap in output.gaps if gap.active]
            detail = f"{gaps[0].link} for {gaps[0].other}" if gaps else ""
            self.events.info("made_way", detail)
        elif before is not None and memory.station is None and output.at_rest:
            self.events.info("came_back")

    def _tell_arm_angle(self, goal: SelfMotionRequest, tick: int, output: ArmTick) -> None:
        """Tell when the elbow is where it was to go, and when it gets no nearer."""
        now_s, target = tick * self.cell.config.timing.period_s, goal.angle
        found = self.commands.self_motion.look(output.found.by_hand, now_s)
        if found is None or target is None:
            return
        if found:
            self.events.info("arm_angle_reached", f"{target:.3f} rad")
            return
        at = self.arm_angle
        stands = "on no circle" if at is None else f"at {at:.3f} rad"
        by = f", by {', '.join(output.limits)}" if output.limits else ""
        self.events.warning("arm_angle_unreachable", f"{target:.3f} rad: it stands {stands}{by}")

    @property
    def outputs(self) -> dict[str, bool]:
        """Commanded states of the outputs, by the names of their devices."""
        told = self.commands.settings.outputs
        return {f"{self.cell.prefix}{name}": on for name, on in told.items()}


def mrf_in_force(output: ArmTick, commands: Commands) -> Pose:
    """Return where the command has the MRF in force, in World.

    The tick that made the output may have had another one.
    """
    then, now, T = output.T_wrist_mrf, commands.frames.T_wrist_mrf, output.T_world_mrf
    return T if then is now else T @ (then.inverse() @ now)


# --- Telemetry of what is driven as a whole: an arm in its tunnels, a base on wheels --------------


def described_insertion(part: Cell) -> dict[str, float] | None:
    """Return how fast and how deep an arm may be inserted; None for one without a backbone."""
    backbone = part.config.mechanism.backbone
    if backbone is None:
        return None
    return {"speed": backbone.speed, "depth": Chain.from_cell(part).length - backbone.least}


def described_base(part: Cell) -> dict[str, float] | None:
    """Return how fast a base may be driven; None for an arm that has none."""
    base = part.config.mechanism.driven
    return None if base is None else dict(zip(("speed", "angular_speed"), base.most, strict=True))


def described_self_motion(part: Cell) -> dict[str, float] | None:
    """Return how fast spare joints may be moved by hand; None where the task holds them all."""
    section, mechanism = part.config.mechanism, Mechanism.from_cell(part)
    others = {*section.beside_chain, *(() if section.gantry is None else section.gantry.joints)}
    if mechanism.n - len(others) <= (mechanism.arm_rank or mechanism.rank):
        return None
    if mechanism.arm_angle is None:
        return {"share": 1.0}
    return {"arm_angle": part.config.redundancy.arm_angle_speed}
