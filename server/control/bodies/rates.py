"""One arm in one tick: what is measured, what its body is asked for and answers, what is asked."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from ..axes import HeldAxes
from ..grasps import GraspState, GraspStatus
from ..hold import STANDS, RetreatState, Stance
from ..inputs import Inputs, Intent, ObjectiveGains
from ..mechanism.redundancy import (
    NO_DIRECTIONS,
    FieldReading,
    LinkState,
    Near,
    SelfMotion,
)
from ..mechanism.self_motion import IDLE, HandState
from ..mechanism.wrench import WristMemory
from ..proximity.capsules import Placed
from ..proximity.pairs import Gap, Shown
from ..scene import Index
from ..spatial import NO_TWIST, Array, Kinematics, Motion, Pose, jacobian_at, product
from ..stop.limiter import Commanded
from ..task.task import TaskMemory

NO_LEVER: Final = np.zeros(3)


class Following(NamedTuple):
    """Which joints follow their commands: what both were when each joint moved last."""

    commanded: Array
    """(n,) [rad]"""
    measured: Array
    """(n,) [rad]"""
    stood: Array
    """How long each has stood (n,) that was asked to move [s]."""
    locked: Array | None = None
    """Angles (n,) of joints that do not follow, NaN for the others [rad]; None where all do."""


class Insertion(NamedTuple):
    """Where along its curve an arm is."""

    s1: float
    """Free length, base to entrance [m]."""
    q: Array
    """The fit there (n,) [rad]."""
    rates: Array
    """∂q/∂s1 of the fit (n,) [rad/m]."""
    speed: float
    """Insertion speed that the operator's drive asks for, ramped [m/s]."""
    beyond: int
    """The first joint that is beyond the exit; n for none."""
    following: Following | None = None
    """None before the joints were looked at."""

    @property
    def locked(self) -> Array | None:
        """Angles (n,) of joints that do not follow, NaN for the others; None where all do."""
        return None if self.following is None else self.following.locked


class Carrier(NamedTuple):
    """The torso that an arm stands on: joints that move its Base."""

    joints: slice
    """Where they are among the cell's; none for an arm that stands in World."""
    p: Array
    """A point (3,) that moves with what it carries, in World [m]."""
    J: Array
    """Jacobian of that point (6, k)."""
    dq: Array
    """At what rates its joints are told to move now (k,) [rad/s]."""

    def at(self, p: Array) -> "Carrier":
        """Return the same of another point p (3,) that it carries."""
        if not len(self.dq):
            return self
        return self._replace(p=p, J=jacobian_at(self.J, p - self.p))

    @property
    def twist(self) -> Array:
        """At which the joints are told to move the point now (6,) [m/s, rad/s]."""
        return product(self.J, self.dq) if len(self.dq) else NO_TWIST


IN_WORLD: Final = Carrier(slice(0, 0), NO_LEVER, np.zeros((6, 0)), np.zeros(0))
"""What an arm stands on that stands in World."""


class JointRates(NamedTuple):
    """Joint rates that do what a body is asked for."""

    dq: Array
    """(n,) [rad/s]."""
    self_motion: SelfMotion
    sigma_min: float = math.nan
    limits: tuple[str, ...] = ()
    """What takes something off the twist, by the limit's name."""
    field: FieldReading | None = None
    """The potential field; None where nothing follows it."""
    give_way: Array | None = None
    """Velocity along the virtual links (3,) [m/s]; None where they do not act."""
    links: Array = NO_DIRECTIONS
    """Where the virtual links point (k, 3), unit vectors in World."""
    synchronized: bool = False
    """The joints follow a curve: one that is held up holds up all."""
    wheels_commanded: bool = False
    """Wheels go as they are driven: barriers may slow them, together, and nothing else."""
    insertion: Insertion | None = None
    """Where along its curve the arm is."""
    n_locked: int = 0
    """So many joints, the first ones, stand."""
    by_hand: HandState = IDLE
    """How far an operator's self-motion has come."""


class Resistance(NamedTuple):
    """Memory of a resistance that holds an arm up."""

    error: Array
    """Lead of the command over the joints in the last tick (n,) [rad]."""
    pressed: Array
    """The way of a tick (n,) [rad] on which a joint fell behind last; zero: none did."""


@dataclass
class ArmTick:
    """What one tick finds out and decides of one arm, stage by stage; nobody changes it after.

    The one record of `control` that is filled in as the tick goes on: each stage writes what it
    found. What of it the next tick needs, `ArmMemory` takes over.
    """

    # What is measured.
    inputs: Inputs
    kinematics: Kinematics
    """Of the commanded posture."""
    T_world_wrist_measured: Pose
    error: Array
    """How far the command was ahead of the joints (n,) [rad], which the leash bounds."""
    commanded: Commanded
    """What its joints were last told."""
    lever: Array = field(default_factory=lambda: NO_LEVER)
    """From the MRF to the point of the tool at which singularities are judged, and whose rates are
    shaped: where the MRF was at start (3,) [m]. A new MRF is no new point."""
    wrench: Array | None = None
    """Wrench that the arm exerts, at and in the MRF (6,) [N, N·m]; None when stale."""
    hand: Array | None = None
    """The same of the mean readings."""
    wrist: WristMemory = field(default_factory=WristMemory)
    """Readings of the force/torque sensor."""
    placed: Placed | None = None
    """Its links at the commanded posture, where they are known already."""
    near: Near | None = None
    """Obstacles near its control points; None in a cell without any."""
    T_world_base: Pose | None = None
    """Where a Base that moves is; None: Base stands."""
    below: Carrier = IN_WORLD
    """What Base stands on, at the MRF."""

    # What is remembered, and changed on the way.
    insertion: Insertion | None = None
    """Where along its curve it was a tick ago."""
    by_hand: HandState = IDLE
    """How far an operator's self-motion had come."""
    retreat: RetreatState | None = None
    """How far the arm gave way, and from `Arm.answer` on gives way now."""
    grasp: GraspState | None = None
    """Memory of the payload that it holds with others."""
    resistance: Resistance | None = None
    """What holds the arm up: a tick ago, and from the barriers on now."""

    # What the task asks for.
    task: TaskMemory = field(init=False)
    """Memory of the sources: the gains in effect, and how far the goal is under way."""
    gains: ObjectiveGains = field(init=False)
    """Gains of the redundancy objectives in effect, whichever of them act."""
    objectives: ObjectiveGains = field(init=False)
    """Gains of those that act."""
    moving_since_s: float | None = None
    """When the arm was last enabled or resumed, None while it may not move [s]."""
    settled: bool = False
    """The arm is at a posture, where spare joints stand."""
    held: HeldAxes | None = None
    """Axes of the MRF that the task holds; None: all."""
    links: LinkState | None = None
    """The virtual links in effect; None for an arm without any."""
    off_path: Array | None = None
    """Where the virtual links have the tool off its path, in World (3,) [m]."""
    way: Array = field(default_factory=lambda: NO_LEVER)
    """Where the links' straight path goes as a whole, in World (3,) [m]; zeros without one."""
    twists: Mapping[str, Array] = field(default_factory=dict)
    """What each source asks for (6,) [m/s, rad/s]."""
    twist: Array = field(init=False)
    """Their sum (6,)."""
    whole: Mapping[str, Array] = field(default_factory=dict)
    """Rates (n,) of objectives that are taken whole, by name."""
    by_joint: bool = False
    """The joints are commanded themselves: jogged, or led to a posture."""
    stance: Stance = STANDS
    """How the arm meets what comes."""
    scale: float = 1.0
    """Share of that which bounds of the tool's speed leave, 0 to 1."""
    asked: Array = field(default_factory=lambda: NO_TWIST)
    """The twist (6,) that the body is to resolve, of the MRF in World axes [m/s, rad/s]."""

    # What the body makes of it.
    found: JointRates = field(init=False)
    """What the body resolved, before anything came beside it."""
    dq_asked: Array = field(init=False)
    """Joint rates (n,) that are asked for in all [rad/s]."""

    # What barriers leave.
    path: Array | None = None
    """Jacobian of the motion that a tool on a driven base keeps, in the arm's own joints (6, n), or
    in all that move the tool; None: the tool's own."""
    motion_commanded: bool = True
    """False of an arm that accommodates at most: it makes no way for what comes."""
    allowed: Array = field(init=False)
    """Joint rates (n,) that keep every barrier [rad/s]."""
    share: float = 1.0
    """Of the asked tool motion: what barriers leave, on its path or sliding, 0 to 1."""
    pace: float = 1.0
    """Share of its own speed at which a path may go on, 0 to 1: it leads a tool that slides, and
    waits for one that the leash holds."""
    made_way: bool = False
    """The arm was to go out of the way of something that comes."""
    shown: Shown | None = field(init=False, default=None)
    """The pairs of links and obstacles that are near; None where clearances are not kept."""

    # What is sent, and told.
    motion: Motion = field(init=False)
    """Command of the joints (n,)."""
    stop_worsened: bool = field(init=False, default=False)
    """News made the stored stop fall short of a clearance; the least bad one was taken."""
    command: Array = field(init=False)
    """Setpoints of the drives (n,): rad, rad/s or N·m."""
    refusal: str | None = field(init=False, default=None)
    """Why the gate refused the command; the drives must quick-stop then."""
    limits: tuple[str, ...] = ()
    """Names of what limited this tick, at each stage."""
    at_rest: bool = field(init=False)
    T_world_mrf_measured: Pose = field(init=False)
    at_goal: bool = field(init=False)
    """True when a position or posture goal is reached."""
    bleeding: bool = field(init=False)
    T_world_path: Pose | None = field(init=False)
    """Where the path has the MRF now, if there is one."""
    holding: GraspStatus | None = field(init=False, default=None)
    """The payload that it holds with others; None for an arm with a task alone."""
    shared: "ArmTick | None" = field(init=False, default=None)
    """The same of a joint task, at its shared MRF; told by its first arm only."""

    def tool_jacobian(self, part: slice) -> tuple[Array, slice | Index]:
        """Return the tool's Jacobian (6, m) in all joints that move it, and where those are.

        The arm's own are a `part` of the cell's.
        """
        if not len(self.below.dq):
            return self.kinematics.J, part
        J = np.concatenate((self.below.J, self.kinematics.J), axis=1)
        return J, np.r_[self.below.joints, part]

    @property
    def moving(self) -> bool:
        """The arm may move, and does not only give way."""
        return self.inputs.intent is Intent.MOVE

    @property
    def precedence(self) -> float:
        """Part that avoidance takes of following, 0 to 1 [1]."""
        return 0.0 if self.near is None else self.near.alpha

    @property
    def q(self) -> Array:
        """Joint command (n,) [rad]."""
        return self.motion.q

    @property
    def dq(self) -> Array:
        """Commanded joint rates (n,) [rad/s]."""
        return self.motion.dq

    @property
    def granted(self) -> float:
        """Share of the asked tool motion that was granted, 0 to 1."""
        return self.scale * self.share

    @property
    def T_wrist_mrf(self) -> Pose:
        """The MRF that all this is about."""
        return self.inputs.settings.T_wrist_mrf

    @property
    def T_world_mrf(self) -> Pose:
        """Where the command had the MRF."""
        return self.kinematics.T_world_mrf

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """The nearest pairs of links and obstacles, nearest first: told when somebody looks."""
        return () if self.shown is None else self.shown.gaps()

    @property
    def may_move(self) -> bool:
        """False of an arm that gives way at most."""
        return self.moving_since_s is not None

    @property
    def spare(self) -> bool:
        """Spare joints may move."""
        return self.moving and not self.settled

    @property
    def led_by_hand(self) -> bool:
        """An operator moves the spare joints, or did until now."""
        return self.moving and (self.inputs.self_motion.acts or self.by_hand.moves)

    @property
    def led_in_world(self) -> bool:
        """The tool is led, and whatever carries Base shall not carry it along."""
        return not self.by_joint and self.inputs.ground != "base"
