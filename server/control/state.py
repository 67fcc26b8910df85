"""Inputs, memory and outputs of a tick.

Time is an input. All values are immutable by agreement: a tick builds new ones.
"""

from dataclasses import dataclass, field
from enum import Enum, auto
from typing import NamedTuple

import numpy as np

from .actuation.torque import TorqueState
from .barriers.clearance import Gap, Levels, Shown
from .barriers.rows import Resistance
from .bodies.body import STILL, DriveRequest, Insertion
from .grasps.held import GraspState, GraspStatus
from .hold import Pushed, RetreatState, Station
from .mechanism.field import FieldReading
from .mechanism.joint_rates import NOTHING, JointFeedforward
from .mechanism.redundancy import Near, ObjectiveGains, SelfMotion
from .mechanism.wrench import Payload, WristMemory
from .scene import Moved, Scene
from .spatial import Array, Motion, Pose
from .stop.profile import Stop
from .task.position import Progress
from .task.source import Goal, StickCommand, ViewGoal
from .task.task import TaskMemory


class Intent(Enum):
    """Permission of the daemon's mode to the tick."""

    SEED = auto()
    """Drives are not enabled: the command is where the joints are."""
    MOVE = auto()
    """Sources and goals act."""
    STOP = auto()
    """The stored, verified stop runs out."""
    HOLD = auto()
    """Stand; bleed off contact beyond the threshold, give way to what was touched."""


@dataclass(frozen=True)
class Settings:
    """Settings that an operator may change while running; the tick ramps every change."""

    gains: dict[str, Array]
    """Effective gain (6,) of each source by name; zeros where it is switched off. One that is left
    out asks for nothing."""
    T_wrist_mrf: Pose
    T_world_crf: Pose
    wrench_bias: Array
    """Sensor reading without load, Sensor axes, sign of the exerted wrench (6,) [N, N·m]."""
    speed_factor: float = 1.0
    payload: Payload | None = None
    """None: the cell's own."""
    objectives: ObjectiveGains | None = None
    """How strongly each redundancy objective acts; as the cell says when None."""
    avoid: bool = False
    """Clearances are kept."""
    at_once: tuple[str, ...] = ()
    """Sources whose gains are not ramped: a load that is told anew is, and they must miss it."""
    redefined: int = 0
    """How often MRF or CRF were redefined."""
    contact_share: float = 1.0
    """Part of the task's sum that acts: less on what force control rang on [1]."""
    untold: Array | None = None
    """Wrench (6,) that the arm exerts at the MRF, in World axes, on nobody's hand; None: none."""


@dataclass(frozen=True)
class Inputs:
    """Everything that one tick may look at."""

    time_s: float
    intent: Intent
    q_measured: Array
    settings: Settings
    energised: Array | None = None
    """Which drives (n,) are already on while the arm is being enabled: they keep their command."""
    wrench_sensor: Array | None = None
    """Wrench that the arm exerts, at and in the Sensor frame (6,) [N, N·m]; None when stale."""
    wrench_age_s: float = 0.0
    """How much older the wrench's sample is than the joints' [s]."""
    wrench_mean: tuple[Array, float] | None = None
    """The mean of a period's samples (6,) and its age [s]; None: the newest stands for all."""
    stick: StickCommand | None = None
    jog: Array | None = None
    goal: Goal | None = None
    paused: bool = False
    """The path to the goal stands still; position control goes on."""
    view: ViewGoal | None = None
    """Where the desired view is; None without one, or when pictures are stale."""
    posture: Array | None = None
    at_posture: bool = False
    """A posture was reached, or the arm just enabled, and nothing was asked for since: no
    self-motion leads away from there."""
    wrench_desired: Array = field(default_factory=lambda: np.zeros(6))
    """Wrench to exert, at the MRF (6,) [N, N·m]."""
    scene: Scene | None = None
    """Obstacles, where they are known to be now; None where there are none."""
    R_world_wrench: Array | None = None
    """Axes (3, 3) of the wrench to exert; None: the MRF's."""
    moved: Moved | None = None
    """Base and Carrier in a cell where they may move; None: Base stands."""
    ground: str = "world"
    """Frame that sources move the MRF relative to; a goal is placed on it."""
    T_wrist_goal: Pose | None = None
    """The point of the tool that is led to the goal: the MRF of when it was ordered; None: the MRF
    of now."""
    pushed: Pushed | None = None
    """Unseen contact by the drives' torques; None where it is not known."""
    drive: DriveRequest = STILL
    """How the operator drives an arm with a backbone as a whole."""
    beside: JointFeedforward = NOTHING
    """Joint rates that are asked for beside the task's twists."""


@dataclass(frozen=True)
class Memory:
    """Memory that one tick hands to the next."""

    motion: Motion
    """Commanded joints: what the drives were last told to reach."""
    stop: Stop
    """The verified way to rest from `motion`."""
    sent: tuple[Array, Array, Array]
    """The last three commanded postures, newest first."""
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
    levels: Levels = field(default_factory=dict)
    """Best gap so far of pairs of links and obstacles that are below their bounds."""
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


class Output(NamedTuple):
    """Decisions of one tick, and their reasons."""

    q: Array
    """Joint command (n,) [rad]."""
    dq: Array
    command: Array
    """Setpoints of the drives (n,): rad, rad/s or N·m."""
    refusal: str | None
    """Why the gate refused the command; the drives must quick-stop then."""
    at_rest: bool
    following_error: Array
    T_world_mrf: Pose
    T_world_mrf_measured: Pose
    T_wrist_mrf: Pose
    """The MRF that all this is about."""
    wrench_mrf: Array | None
    twists: dict[str, Array]
    """Each source's twist of the MRF, World axes (6,)."""
    twist: Array
    """Their sum, before limiting."""
    scale: float
    """Share of the asked tool motion that was granted, 0 to 1."""
    limits: tuple[str, ...]
    """Names of what limited this tick."""
    sigma_min: float
    gains: dict[str, Array]
    """Each source's gain (6,) in effect: ramped, and as its schedules say."""
    objectives: ObjectiveGains
    """The redundancy objectives' gains in effect."""
    self_motion: SelfMotion
    """Joint rates that were asked of the null space."""
    at_goal: bool
    """True when a position or posture goal is reached."""
    bleeding: bool = False
    path: Progress | None = None
    """How far the goal is under way, if any."""
    T_world_path: Pose | None = None
    """Where the path has the MRF now, if there is one."""
    field: FieldReading | None = None
    """The potential field; None where nothing follows it."""
    off_path: Array | None = None
    """Where the virtual link has the tool off its path, in World (3,) [m]."""
    shown: Shown | None = None
    """The pairs of links and obstacles that are near; None where clearances are not kept."""
    near: Near | None = None
    """Obstacles near the virtual spheres; None in a cell without any."""
    insertion: Insertion | None = None
    """Where along its curve the arm is; None for a plain arm, and for one that is not on it."""
    stop_worsened: bool = False
    """News made the stored stop fall short of a clearance; the least bad one was taken."""
    held: GraspStatus | None = None
    """The payload that it holds with others; None for an arm with a task alone."""
    shared: "Output | None" = None
    """The same of a joint task, at its shared MRF; told by its first arm only."""

    @property
    def gaps(self) -> tuple[Gap, ...]:
        """The nearest pairs of links and obstacles, nearest first: told when somebody looks."""
        return () if self.shown is None else self.shown.gaps()
