"""Memory and outputs of a tick. Immutable by agreement: a tick builds new ones."""

from dataclasses import dataclass, field
from typing import NamedTuple

from .actuation.torque import TorqueState
from .barriers.clearance import Gap, Levels, Shown
from .bodies.rates import ArmMeasurement, ArmTick, Insertion, Resistance
from .grasps import GraspState, GraspStatus
from .hold import RetreatState, Station
from .inputs import ObjectiveGains
from .mechanism.redundancy import LinkState, Near
from .mechanism.self_motion import IDLE, HandState
from .mechanism.wrench import WristMemory
from .spatial import Array, Motion, Pose
from .stop.limiter import Commanded
from .task.task import TaskMemory


@dataclass(frozen=True)
class ArmMemory:
    """What one arm remembers of the ticks before."""

    objectives: ObjectiveGains
    """The redundancy objectives' gains in effect."""
    task: TaskMemory
    """Memory of the sources."""
    wrist: WristMemory = field(default_factory=WristMemory)
    """Readings of the force/torque sensor."""
    max_tool_acceleration: float = 0.0
    """Greatest acceleration that the tool was lately told [m/s²]."""
    moving_since_s: float | None = None
    """When the arm was last enabled or resumed, None while it may not move [s]."""
    near: Near | None = None
    """Obstacles near the virtual spheres; None in a cell without any."""
    torque: TorqueState | None = None
    """Memory of the torque law, with drives in CST."""
    retreat: RetreatState | None = None
    """The way that led here, and how far the arm gave way on it; None in a cell that feels nothing.
    """
    station: Station | None = None
    """Where the arm was told to stand, while it is away to make way; None for one that is not."""
    resistance: Resistance | None = None
    """The resistance that holds the arm up; None before the first tick."""
    held: GraspState | None = None
    """The payload that it holds with others; None for an arm with a task alone."""
    insertion: Insertion | None = None
    """Where along its curve the arm is; None for a plain arm, and for one that is not on it."""
    by_hand: HandState = IDLE
    """How far an operator's self-motion has come."""
    links: LinkState | None = None
    """The virtual links in effect; None for an arm without any, and before it moves."""


class Memory(NamedTuple):
    """Memory that one tick hands to the next: of all joints of a cell, and of each arm."""

    commanded: Commanded
    arms: tuple[ArmMemory, ...]
    levels: Levels
    """Best gap so far of pairs of links and obstacles that are below their bounds."""


class Output(NamedTuple):
    """Decisions of one tick, and their reasons."""

    motion: Motion
    """Command of the joints (n,)."""
    command: Array
    """Setpoints of the drives (n,): rad, rad/s or N·m."""
    refusal: str | None
    """Why the gate refused the command; the drives must quick-stop then."""
    at_rest: bool
    desired: ArmTick
    """What was measured, asked of the joints and left by barriers; of a joint task, at its shared
    MRF."""
    task: TaskMemory
    """The gains in effect, and how far the goal is under way."""
    objectives: ObjectiveGains
    """The redundancy objectives' gains in effect."""
    T_world_mrf_measured: Pose
    scale: float
    """Share of the asked tool motion that was granted, 0 to 1."""
    limits: tuple[str, ...]
    """Names of what limited this tick."""
    at_goal: bool
    """True when a position or posture goal is reached."""
    bleeding: bool = False
    T_world_path: Pose | None = None
    """Where the path has the MRF now, if there is one."""
    shown: Shown | None = None
    """The pairs of links and obstacles that are near; None where clearances are not kept."""
    stop_worsened: bool = False
    """News made the stored stop fall short of a clearance; the least bad one was taken."""
    held: GraspStatus | None = None
    """The payload that it holds with others; None for an arm with a task alone."""
    shared: "Output | None" = None
    """The same of a joint task, at its shared MRF; told by its first arm only."""

    @property
    def seen(self) -> ArmMeasurement:
        """What the tick began with."""
        return self.desired.seen

    @property
    def q(self) -> Array:
        """Joint command (n,) [rad]."""
        return self.motion.q

    @property
    def dq(self) -> Array:
        """Commanded joint rates (n,) [rad/s]."""
        return self.motion.dq

    @property
    def T_wrist_mrf(self) -> Pose:
        """The MRF that all this is about."""
        return self.seen.inputs.settings.T_wrist_mrf

    @property
    def T_world_mrf(self) -> Pose:
        """Where the command had the MRF."""
        return self.seen.kinematics.T_world_mrf

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """The nearest pairs of links and obstacles, nearest first: told when somebody looks."""
        return () if self.shown is None else self.shown.gaps()
