"""Goals of the position source. `serial` tells one goal from the next.

`attempt` counts how often the same goal was taken up again from where the arm is.
"""

from dataclasses import dataclass

from ...spatial import Array, Pose


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
