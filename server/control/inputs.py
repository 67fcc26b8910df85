"""What a tick looks at: what was asked for, settings, and what was measured."""

from dataclasses import dataclass, field
from enum import Enum, auto
from typing import Final, NamedTuple, Self

import numpy as np

from ...config.schema.null_space import VirtualLinkSection
from .scene import Moved, Scene
from .spatial import Array, Pose

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


# --- Requests of operators and devices in one tick ------------------------------------------------


@dataclass(frozen=True)
class StickCommand:
    """A stick twist u (6,) in the axes that `R_world_axes` (3, 3) maps to World."""

    twist: Array
    R_world_axes: Array


class Picture(NamedTuple):
    """Corners as they are seen, and as a stored picture has them."""

    points: Array
    """Where they are (k, 3) [m]: before a carried Lens in World, else in the carried target."""
    wanted: Array
    """Their normalised image coordinates in the stored picture (k, 2) [1]."""


NO_PICTURE: Final = Picture(np.zeros((0, 3)), np.zeros((0, 2)))


@dataclass(frozen=True)
class ViewGoal:
    """Where something that moves with the Wrist is to be, so that the view is the desired one."""

    T_wrist_point: Pose
    """Pose in the Wrist of the thing that is to be moved: a carried Lens, or a carried target."""
    T_world_goal: Pose
    """Where that is to be, in World, by the poses that were seen."""
    T_world_lens: Pose | None = None
    """A Lens that stands in World; None: the moved point is the Lens."""
    picture: Picture = NO_PICTURE
    """The picture to come to, in place of the pose; without points the pose counts."""


class DriveRequest(NamedTuple):
    """How the operator drives the arm as a whole: into its tunnels, or on its wheels."""

    speed: float = 0.0
    """Of the insertion [m/s]; at most, where it is to a depth. Of a base, ahead."""
    depth: float | None = None
    """The tip's way from the entrance to go to [m]; None: at the speed."""
    turn: float = 0.0
    """Of a base [rad/s]."""
    back_only: bool = False
    """Something in the tunnel pushes the arm: it may withdraw, and do nothing else."""


STILL = DriveRequest()


class SelfMotionRequest(NamedTuple):
    """How the operator moves the spare joints, whatever the tool does."""

    rate: float = 0.0
    """Of the arm angle [rad/s]; of an arm without one as a part of its quickest [1]. At most, where
    it is to an angle."""
    angle: float | None = None
    """Arm angle to go to [rad]; None: at the rate."""
    kept: bool = False
    """The angle was reached, and is kept."""

    @property
    def acts(self) -> bool:
        """True while the spare joints are the operator's."""
        return self.rate != 0.0 or self.angle is not None

    @property
    def orders(self) -> bool:
        """True while they are told to move."""
        return self.acts and not self.kept


UNASKED = SelfMotionRequest()


class Fold(NamedTuple):
    """A posture that the arm folds to."""

    posture: Array
    """(n,) [rad]; NaN for joints that it does not concern."""
    speed: float
    """The tool goes at most so quickly [m/s]."""


class JointFeedforward(NamedTuple):
    """Requests to the joints in one tick."""

    fold: Fold | None = None
    sweep: tuple[int, float] | None = None
    """A joint that sweeps, and its rate [rad/s]."""


NOTHING: Final = JointFeedforward()


class VirtualLinks(NamedTuple):
    """Links along which the tool may leave its path, as they are set."""

    directions: tuple[tuple[float, float, float], ...] = ()
    """Of each, in its `axes`; square to each other."""
    axes: str = "world"
    """World's, or those of "mrf", "crf" or a straight "path"."""
    always: bool = False
    """Off a path too."""
    stiffness: float = 0.0
    """Of each one's spring [N/m]."""

    @classmethod
    def of(cls, section: VirtualLinkSection) -> Self:
        """Return those of a cell's section."""
        return cls(section.directions, section.axes, section.always, section.stiffness)


# --- Settings and inputs of one tick --------------------------------------------------------------


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
class Payload:
    """Load outboard of the sensor."""

    mass: float
    """Mass [kg]."""
    com: Array
    """Centre of mass in the Sensor frame (3,) [m]."""


class ObjectiveGains(NamedTuple):
    """Gains of the redundancy objectives, and the posture that one of them pulls to."""

    gains: dict[str, float]
    posture: Array
    """Joint angles (n,) that the posture objective pulls to [rad]."""


class Pushed(NamedTuple):
    """Unseen contact as the watch over the drives' torques estimates it (n,) [N·m]."""

    external: Array
    """Torques that nothing explains."""
    excused: Array
    """The part of that which may be friction and inertia."""
    bound: Array
    """Bound beyond that which means contact."""
    touched: bool = False
    """The arm was stopped for it, and is to give way."""
    lasting: bool = False
    """It has not been released since."""
    free: Array | None = None
    """`external` before it was touched; None where that is not known."""
    wrench: Array | None = None
    """Wrench on the tool by the force/torque sensor (6,), at the MRF in World axes [N, N·m]."""
    steady: Array | None = None
    """The mean of that over the last ticks: the arm's own jerks are not in it."""
    free_wrench: Array | None = None
    """The same before it was touched; None where that is not known."""
    tool_bound: float | None = None
    """Change of that force that means contact of the tool [N]; None: the tool was not touched."""


class ToldTunnel(NamedTuple):
    """The tunnel that an operator told, from the entrance on."""

    pieces: tuple[tuple[float, ...], ...]
    """Length [m], bend, climb and roll [rad] of each. Of a gap seven numbers: length [m], and place
    [m], roll, pitch and yaw [rad] of the next passage's entrance in World."""
    open: int = 0
    """So many of them, the last ones, have no walls."""


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
    held: Array | None = None
    """Axes of the MRF (6,) that the task holds: 1 held, 0 free; None: all are held."""
    tunnel: ToldTunnel | None = None
    """None: the cell's own."""
    shares: Array | None = None
    """Diagonals of W (k, 6) of a payload in k hands: the dearer, the less one carries; None: the
    cell's own."""
    links: VirtualLinks | None = None
    """None: the cell's own, if it has any."""


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
    self_motion: SelfMotionRequest = UNASKED
    """How the operator moves the spare joints."""

    @property
    def pace(self) -> float:
        """The factor of reduced speed on joints [1]: giving way, which is slow, has all of it."""
        pushed = self.pushed
        gives_way = self.intent is Intent.HOLD and pushed is not None and pushed.touched
        return 1.0 if gives_way else self.settings.speed_factor
