"""What one tick hands to the next. Immutable by agreement: a tick builds a new one."""

from dataclasses import dataclass, field
from typing import NamedTuple

from .actuation.torque import TorqueState
from .barriers.clearance import Levels
from .bodies.rates import Insertion, Resistance
from .grasps import GraspState
from .hold import RetreatState, Station
from .inputs import ObjectiveGains
from .mechanism.redundancy import LinkState, Near
from .mechanism.self_motion import IDLE, HandState
from .mechanism.wrench import WristMemory
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
