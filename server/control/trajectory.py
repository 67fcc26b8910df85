"""Time-optimal, jerk-limited motions: the one place that knows Ruckig.

Joint and Cartesian states are triples of arrays: position, velocity, acceleration. All functions
are pure; the objects here only keep scratch memory.
"""

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import ruckig

from .compiled import NUMBER, VECTOR, compiled
from .evolve import evolve
from .frames import Array
from .velocity_profile import stepped


class Motion(NamedTuple):
    """Position, velocity and acceleration of n degrees of freedom."""

    q: Array
    dq: Array
    ddq: Array

    @staticmethod
    def at_rest(q: Array) -> "Motion":
        """Return rest at q (n,)."""
        return Motion(q.copy(), np.zeros_like(q), np.zeros_like(q))

    def stands(self, below: float = 0.0) -> bool:
        """Return whether no speed and no acceleration is as large as `below`, or any at all."""
        return _stands(self.dq, self.ddq, below)


@compiled(VECTOR, VECTOR, NUMBER)
def _stands(dq: Array, ddq: Array, below: float) -> bool:
    for i in range(len(dq)):
        for size in (abs(dq[i]), abs(ddq[i])):
            if not (size == 0.0 or size < below):  # nor what is not a number
                return False
    return True


class TrajectoryError(Exception):
    """Ruckig refused a state or a bound: carries its words."""


@dataclass(frozen=True)
class Profile:
    """A planned motion, and how far along it is."""

    trajectory: "ruckig.Trajectory"
    elapsed_s: float
    duration_s: float

    def at(self, ahead_s: float = 0.0) -> Motion:
        """Return the motion `ahead_s` after now."""
        return _state(self.trajectory.at_time(self.elapsed_s + ahead_s))

    def advanced(self, by_s: float) -> Self:
        """Return the same profile, further along."""
        return evolve(self, elapsed_s=self.elapsed_s + by_s)

    @property
    def to_go_s(self) -> float:
        """Time until the end [s]."""
        return max(0.0, self.duration_s - self.elapsed_s)

    @property
    def finished(self) -> bool:
        """True once the end is reached."""
        return self.elapsed_s >= self.duration_s


@dataclass(frozen=True)
class Stop(Profile):
    """A jerk-limited way to rest."""

    origin: Array
    """Where it began (n,): the trajectory counts from there."""
    low: Array
    """Least position of each joint along the whole stop (n,)."""
    high: Array
    """Greatest position of each joint along the whole stop (n,)."""

    def postures(self, ahead_s: Array) -> Array:
        """Return the positions (s, n) at times (s,) after now."""
        at_time, since = self.trajectory.at_time, self.elapsed_s
        ways = np.array([at_time(since + t)[0] for t in ahead_s.tolist()])
        return np.asarray(self.origin + ways)

    def at(self, ahead_s: float = 0.0) -> Motion:
        """Return the motion `ahead_s` after now."""
        way, dq, ddq = super().at(ahead_s)
        return Motion(self.origin + way, dq, ddq)


def _state(at_time: tuple[list[float], list[float], list[float]]) -> Motion:
    q, dq, ddq = at_time
    return Motion(np.array(q), np.array(dq), np.array(ddq))


def _calculated(
    planner: "ruckig.Ruckig", i: "ruckig.InputParameter", start: Motion, kind: str, target: Array
) -> "ruckig.Trajectory":
    """Return the trajectory from `start`; raises `TrajectoryError` that names state and target."""
    i.current_position, i.current_velocity, i.current_acceleration = start
    trajectory = ruckig.Trajectory(len(start.q))
    try:
        result = planner.calculate(i, trajectory)
    except ruckig.RuckigError as error:
        raise TrajectoryError(str(error)) from error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise TrajectoryError(f"{kind} target {target} from {start}: {result.name}")
    return trajectory


class VelocityPlanner:
    """Velocity targets for n degrees of freedom under acceleration and jerk bounds (n,)."""

    def __init__(self, acceleration: Array, jerk: Array) -> None:
        n = len(acceleration)
        self._n = n
        self._ruckig = ruckig.Ruckig(n)
        self._input = ruckig.InputParameter(n)
        self._input.control_interface = ruckig.ControlInterface.Velocity
        self._input.target_acceleration = [0.0] * n
        self._input.max_velocity = [1e6] * n
        self.set_bounds(acceleration, jerk)

    def set_bounds(self, acceleration: Array, jerk: Array) -> None:
        """Change the acceleration and jerk bounds (n,)."""
        self._bounds = acceleration, jerk
        self._input.max_acceleration = acceleration
        self._input.max_jerk = jerk

    def _plan(
        self, motion: Motion, target: Array, how: "ruckig.Synchronization"
    ) -> "ruckig.Trajectory":
        i = self._input
        i.synchronization = how
        i.target_velocity = target
        return _calculated(self._ruckig, i, motion, "velocity", target)

    def step(self, motion: Motion, target: Array, period_s: float, synchronised: bool) -> Motion:
        """Return the motion one period later on the way to velocities `target` (n,)."""
        try:
            return Motion(*stepped(*motion, target, *self._bounds, period_s, synchronised))
        except ValueError as error:
            raise TrajectoryError(f"velocity target {target} from {motion}: {error}") from error

    def straight(self, motion: Motion, target: Array, period_s: float) -> tuple[Motion, Stop]:
        """Return the motion one period later on the way to velocities `target` (n,), and its stop.

        Both in a straight line, as far as the motion of now allows: all freedoms keep their shares.
        """
        phase = ruckig.Synchronization.Phase
        moved = _state(self._plan(motion, target, phase).at_time(period_s))
        return moved, self._stopped(moved, phase)

    def stop(self, motion: Motion) -> Stop:
        """Return the quickest stop of each degree of freedom on its own."""
        return self._stopped(motion, ruckig.Synchronization.No)

    def _stopped(self, motion: Motion, how: "ruckig.Synchronization") -> Stop:
        # Ruckig counts a target position of zero to the extrema: so let zero be where it starts.
        start = Motion(np.zeros(self._n), motion.dq, motion.ddq)
        trajectory = self._plan(start, np.zeros(self._n), how)
        extrema = trajectory.position_extrema
        low = motion.q + [e.min for e in extrema]
        high = motion.q + [e.max for e in extrema]
        return Stop(trajectory, 0.0, trajectory.duration, motion.q, low, high)


class PositionPlanner:
    """Position targets for n degrees of freedom, ending at rest, in straight lines where it can."""

    def __init__(self, n: int, straight: bool = True) -> None:
        """Build for n freedoms; not `straight`, each goes its own way, which is always feasible."""
        self._ruckig = ruckig.Ruckig(n)
        self._input = ruckig.InputParameter(n)
        self._input.synchronization = (
            ruckig.Synchronization.Phase if straight else ruckig.Synchronization.No
        )
        self._input.target_velocity = [0.0] * n
        self._input.target_acceleration = [0.0] * n

    def plan(self, motion: Motion, target: Array, bounds: tuple[Array, Array, Array]) -> Profile:
        """Return the way from `motion` to rest at `target` (n,).

        `bounds` are velocity, acceleration and jerk (n,) each.
        """
        i = self._input
        i.max_velocity, i.max_acceleration, i.max_jerk = bounds
        i.target_position = target
        trajectory = _calculated(self._ruckig, i, motion, "position", target)
        return Profile(trajectory, 0.0, trajectory.duration)
