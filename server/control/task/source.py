"""Protocol of sources: a state, and a twist of the MRF for what one tick shows it."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Final, Generic, NamedTuple, Self, TypeVar

from ..axes import HeldAxes
from ..inputs import Goal, Inputs
from ..scene import Body
from ..spatial import Array, Kinematics, Pose

# --- Protocol of sources: a state, and a twist of the MRF for what one tick shows it --------------
#
# A source is one class, one row in `task.py` and one section of the cell file. It
# knows no joints, no other source, and no more of the cell than its own section.

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

    inputs: Inputs
    moving: bool
    """The task may move the tool."""
    guided: bool
    """Nothing but the sources leads the arm: no posture, no jog."""
    k: Kinematics
    """Where the command has the arm."""
    twist: Array
    """The MRF's commanded twist (6,), seen from Base."""
    lever: Array
    """From the MRF to where it was at start (3,) [m]: what is shaped there minds no new MRF."""
    ground: Body | None
    """The body that motion is relative to, where that may move; None: World."""
    carried: Array | None
    """The ground's twist (6,) seen from Base, at the MRF; None in a cell where nothing moves."""
    wrench: Array | None
    """Wrench that the arm exerts, at and in the MRF (6,) [N, N·m]; None when stale."""
    hand: Array | None
    """The same of the mean readings."""
    wrench_at: Callable[[Pose], tuple[Array | None, Array | None]]
    """Both at and in another MRF, given in the Wrist."""
    load: Array | None
    """Payload and bias in effect (10,): mass [kg], mass · com (3,) [kg·m], bias (6,)."""
    precedence: float
    """Part that avoidance takes of following, 0 to 1 [1]."""
    off_path: Array | None
    """Where the virtual link has the tool off its path (3,) [m]."""
    folding: Array | None = None
    """Twist (6,) of the MRF of an arm that folds as a whole; None for one that does not."""
    held: HeldAxes | None = None
    """Axes of the MRF that the task holds; None: all."""

    @property
    def goal(self) -> Goal | None:
        """Where the position source leads to; None while a posture is gone to."""
        return self.inputs.goal if self.moving and self.inputs.posture is None else None

    @property
    def T_wrist_mrf(self) -> Pose:
        """The MRF of now."""
        return self.inputs.settings.T_wrist_mrf

    @property
    def T_wrist_goal(self) -> Pose:
        """The point of the tool that is led to the goal."""
        led = self.inputs.T_wrist_goal
        return self.T_wrist_mrf if led is None else led


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


SLID: Final = 0.99
"""A tool that does less than this part of what its path does has been turned off it [1]."""


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

    @classmethod
    def of(
        cls, scale: float, pace: float, twist: Array, T_world_mrf: Pose, *, stopped: bool
    ) -> Self:
        """Return that of a tool that does `scale` of its motion, and a path `pace` of its own.

        Once `stopped`, the joints go along their verified stop, and not as they were asked to.
        """
        share, on_path = (0.0, 0.0) if stopped else (scale, pace)
        return cls(share, on_path, scale < SLID * pace, twist, T_world_mrf)


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
