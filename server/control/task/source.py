"""Protocol of sources: a state, and a twist of the MRF for what one tick shows it."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Generic, NamedTuple, TypeVar

import numpy as np

from ..scene import Body, Moved
from ..spatial import Array, Pose

# --- Goals of the position source. `serial` tells one goal from the next --------------------------
#
# `attempt` counts how often the same goal was taken up again from where the arm is.


@dataclass(frozen=True)
class PathGoal:
    """A target pose of the MRF in World."""

    T_world_target: Pose
    serial: int
    speed: float | None = None
    """Path speed [m/s]; the cell's when None."""
    attempt: int = 0


@dataclass(frozen=True)
class Route:
    """Target poses one after the other; legs are straight."""

    legs: tuple[PathGoal, ...]
    serial: int
    blend: float = 0.0
    """The next leg begins within this distance of a waypoint [m]; 0: at rest on it."""
    attempt: int = 0

    @property
    def T_world_target(self) -> Pose:
        """Where it ends."""
        return self.legs[-1].T_world_target


@dataclass(frozen=True)
class TwistSegment:
    """A twist for a while."""

    twist: Array
    """(6,) [m/s, rad/s] in World axes, or in those of the reference itself."""
    duration_s: float


@dataclass(frozen=True)
class TwistRoute:
    """Twists one after the other, then rest."""

    segments: tuple[TwistSegment, ...]
    serial: int
    moving_axes: bool = False
    """True: the twists are in the axes of the moving reference; False: in World's."""
    attempt: int = 0
    T_world_target: None = None


@dataclass(frozen=True)
class Pursuit:
    """A target pose that moves, such as a master's; None: come to rest, and stay there."""

    T_world_target: Pose | None
    serial: int
    attempt: int = 0


Goal = PathGoal | Route | TwistRoute | Pursuit


# --- Requests of operators and devices to one task in one tick ------------------------------------


@dataclass(frozen=True)
class StickCommand:
    """A stick twist u (6,) in the axes that `R_world_axes` (3, 3) maps to World."""

    twist: Array
    R_world_axes: Array


@dataclass(frozen=True)
class ViewGoal:
    """Where something that moves with the Wrist is to be, so that the view is the desired one."""

    T_wrist_point: Pose
    """Pose in the Wrist of the thing that is to be moved: a carried Lens, or a carried target."""
    T_world_goal: Pose
    """Where that is to be, in World."""
    R_world_lens: Array | None = None
    """Axes (3, 3) of a Lens that stands in World; None: the moved point is the Lens."""


class Asked(NamedTuple):
    """The streams, goals and frames of one task."""

    T_wrist_mrf: Pose
    T_world_crf: Pose
    redefined: int
    """How often MRF or CRF were redefined."""
    ground: str
    """The frame that motion is relative to."""
    speed_factor: float
    stick: StickCommand | None
    goal: Goal | None
    """Where the position source leads to; None while a posture is gone to."""
    T_wrist_goal: Pose
    """The point of the tool that is led to the goal."""
    paused: bool
    """The path to the goal stands still; position control goes on."""
    view: ViewGoal | None
    wrench_desired: Array
    """Wrench to exert, at the MRF (6,) [N, N·m]."""
    R_world_wrench: Array | None
    """Axes (3, 3) of that wrench; None: the MRF's."""


# --- Protocol of sources: a state, and a twist of the MRF for what one tick shows it --------------
#
# A source is one class, one row in `task.py` and one section of the cell file. It
# knows no joints, no other source, and no more of the cell than its own section.

NO_TWIST: Final[Array] = np.zeros(6)
"""Rate of a source that asks for nothing (6,); one array, which a sum leaves out."""
NO_TWIST.flags.writeable = False

State = TypeVar("State")
"""Memory of a source from tick to tick; immutable."""


class Shaping(NamedTuple):
    """Bounds of the rates of all sources of a task."""

    acceleration: Array
    """(6,) [m/s², rad/s²]."""
    jerk: Array
    """(6,) [m/s³, rad/s³]."""
    most: tuple[float, float]
    """Greatest speed of the tool [m/s], [rad/s]."""
    period_s: float


class Context(NamedTuple):
    """Inputs of the sources in one tick. Poses are in World, twists in World axes."""

    asked: Asked
    moving: bool
    """The task may move the tool."""
    guided: bool
    """Nothing but the sources leads the arm: no posture, no jog."""
    holding: bool
    """The arm is in HOLD."""
    T_world_wrist: Pose
    T_world_mrf: Pose
    """Where the command has the MRF."""
    twist: Array
    """The MRF's commanded twist (6,), seen from Base."""
    lever: Array
    """From the MRF to where it was at start (3,) [m]: what is shaped there minds no new MRF."""
    moved: Moved | None
    """Base and Carrier in a cell where they may move."""
    ground: Body | None
    """The body that motion is relative to, where that may move; None: World."""
    carried: Array | None
    """The ground's twist (6,) seen from Base, at the MRF; None in a cell where nothing moves."""
    wrench: Array | None
    """Wrench that the arm exerts, at and in the MRF (6,) [N, N·m]; None when stale."""
    hand: Array | None
    """The same of the mean readings."""
    wrench_at: Callable[[Pose], Array | None]
    """The wrench at and in another MRF, given in the Wrist."""
    load: Array | None
    """Payload and bias in effect (10,): mass [kg], mass · com (3,) [kg·m], bias (6,)."""
    precedence: float
    """Part that avoidance takes of following, 0 to 1 [1]."""
    off_path: Array | None
    """Where the virtual link has the tool off its path (3,) [m]."""
    untold: Array | None = None
    """Part of `hand` that is nobody's, if that reads no more: in World axes (6,); None: none."""
    folding: Array | None = None
    """Twist (6,) of the MRF of an arm that folds as a whole; None for one that does not."""

    @property
    def T_wrist_mrf(self) -> Pose:
        """The MRF of now."""
        return self.asked.T_wrist_mrf


class About(NamedTuple):
    """Frames that the rates of one tick were about, and the rates."""

    T_wrist_mrf: Pose
    T_wrist_goal: Pose
    """The point of the tool that was led to the goal."""
    serial: int | None
    """Of the goal; None without one."""
    ground: str
    R_world_crf: Array
    redefined: int
    """How often MRF or CRF had been redefined."""
    twists: Mapping[str, Array]
    """The twist that each source asked for (6,)."""


class Redefined(NamedTuple):
    """Frames of now and of the tick before, where they are not the same."""

    before: About
    lever: Array | None
    """From the MRF of before to that of now (3,) [m]; None where it is the same."""
    way: Array
    """The same, zeros where it is the same."""
    grounded: bool
    """Another ground."""
    jumps: bool
    """The sum may jump: more is new than the point of the tool that is led."""


class Granted(NamedTuple):
    """How much of one tick's asked motion was let through."""

    share: float
    """Of the tool's motion, 0 to 1 [1]."""
    pace: float
    """Of a path's progress, 0 to 1 [1]: along a barrier, it goes on where the tool slides."""
    slid: bool
    """A barrier turned the tool off its path."""
    twist: Array
    """The sum that was asked for (6,)."""
    T_world_mrf: Pose


class Source(ABC, Generic[State]):
    """Asks for a twist of the MRF."""

    ORDERS: ClassVar[bool] = True
    """Somebody wants the motion that it asks for; False: noise of a sensor asks for some, too."""

    def __init__(self, section: Any, shaping: Shaping) -> None:
        """Build it from its section of the cell file."""

    @abstractmethod
    def idle(self) -> State:
        """Return the state of a source that asks for nothing."""

    @abstractmethod
    def rate(self, context: Context, state: State, gain: Array) -> tuple[Array, State]:
        """Return the twist (6,) of the MRF in World axes, and the next state; `gain` is (6,)."""

    def advance(self, state: State, granted: Granted) -> State:
        """Return the state after a tick that granted so much."""
        return state

    def carry(self, state: State, context: Context, redefined: Redefined) -> State:
        """Return the state told about the frames of now: the same motion of the rigid body."""
        return state

    def jump(
        self,
        context: Context,
        redefined: Redefined,
        state: State,
        gain: Array,
        twist: Array,
    ) -> Array | None:
        """Return how much more it asked for before a redefinition (6,), at the MRF of now.

        That is paid back smoothly. `state` and `gain` are those of this tick, `twist` (6,) its
        rate. None: what it asks for is shaped, or was carried on.
        """
        return None
