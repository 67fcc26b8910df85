"""Time-optimal, jerk-limited motions: the one place that knows Ruckig.

Joint and Cartesian states are triples of arrays: position, velocity, acceleration. All functions
are pure; the objects here only keep scratch memory.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import ruckig

from ..spatial import Array, Motion, arriving
from .profile import Stop, shape, step_and_stop, stepped, stopping, stopping_in_proportion


class TrajectoryError(Exception):
    """There is no way from a state, or under a bound: it says which."""


class Plan(NamedTuple):
    """Everything that a planned motion follows from: planned again, it is the same one."""

    start: Motion
    target: Array
    bounds: tuple[Array, Array, Array]
    """On velocity, acceleration and jerk (n,) each."""
    straight: bool


class Profile(NamedTuple):
    """A planned motion to a target."""

    trajectory: "ruckig.Trajectory"
    duration_s: float
    plan: Plan
    elapsed_s: float = 0.0

    def advanced(self, by_s: float) -> "Profile":
        """Return the same, further along."""
        return self._replace(elapsed_s=self.elapsed_s + by_s)

    @property
    def finished(self) -> bool:
        """True once the end is reached."""
        return self.elapsed_s >= self.duration_s

    def at(self, ahead_s: float = 0.0) -> Motion:
        """Return the motion `ahead_s` after now."""
        return _state(self.trajectory.at_time(self.elapsed_s + ahead_s))

    def now(self) -> tuple[Array, Array]:
        """Return position and velocity (n,) now."""
        q, dq, _ = self.trajectory.at_time(self.elapsed_s)
        return np.array(q), np.array(dq)


def _state(at_time: tuple[list[float], list[float], list[float]]) -> Motion:
    q, dq, ddq = at_time
    return Motion(np.array(q), np.array(dq), np.array(ddq))


def _phases(trajectory: "ruckig.Trajectory") -> Array:
    """Return the phases (2, k, n) of a trajectory: how long each lasts, and its jerk."""
    (profiles,) = trajectory.profiles
    return np.array(
        [[[*p.brake.t, *p.t] for p in profiles], [[*p.brake.j, *p.j] for p in profiles]]
    ).transpose(0, 2, 1)


def _calculated(
    planner: "ruckig.Ruckig", i: "ruckig.InputParameter", start: Motion, kind: str, target: Array
) -> "ruckig.Trajectory":
    """Return the trajectory from `start`; raises `TrajectoryError` that names state and target."""
    i.current_position, i.current_velocity, i.current_acceleration = start
    trajectory = ruckig.Trajectory(len(start.q))
    try:
        result = planner.calculate(i, trajectory)
    except (ruckig.RuckigError, ValueError) as error:  # of results that its enum does not name
        raise TrajectoryError(f"{kind} target {target} from {start}: {error}") from error
    if result not in (ruckig.Result.Working, ruckig.Result.Finished):
        raise TrajectoryError(f"{kind} target {target} from {start}: {result.name}")
    return trajectory


class VelocityPlanner:
    """Velocity targets for n degrees of freedom under acceleration and jerk bounds (n,).

    Steps may be told to take a part of the acceleration; stops take all of it.

    Freedoms of a group brake in proportion, so that the slowest decides: along a straight line, if
    their accelerations are already in proportion to their velocities. Others brake on their own.
    """

    def __init__(
        self,
        acceleration: Array,
        jerk: Array,
        groups: Sequence[Sequence[int]] = (),
        parts: Sequence[slice] = (),
    ) -> None:
        """Build it; `groups` holds the indices of freedoms that belong together.

        Those of each of the `parts` arrive together, all of them where there are none; a group is
        made of whole parts, or is inside of one.

        Raises `ValueError` for a freedom in two groups, and for one that there is not.
        """
        n = len(acceleration)
        members = [i for group in groups for i in group]
        if len(set(members)) < len(members):
            raise ValueError(f"groups {groups}: a freedom is in two of them")
        if any(not 0 <= i < n for i in members):
            raise ValueError(f"groups {groups}: there are {n} freedoms")
        self._n = n
        self._groups = [np.array(group) for group in groups]
        self._parts = arriving(n, parts, self._groups)
        self._ends = np.array([part.stop for part in parts] or [n])
        self._ruckig = ruckig.Ruckig(n)
        self._input = ruckig.InputParameter(n)
        self._input.control_interface = ruckig.ControlInterface.Velocity
        self._input.synchronization = ruckig.Synchronization.Phase
        self._input.max_jerk = jerk
        self._bounds = acceleration, jerk
        self.scale(1.0)

    def scale(self, factor: float) -> None:
        """Let steps take a part of the acceleration bound."""
        self._stepping = factor * self._bounds[0]

    def step(self, motion: Motion, target: Array, period_s: float, synchronised: bool) -> Motion:
        """Return the motion one period later on the way to velocities `target` (n,).

        Those of a group always arrive together.
        """
        acceleration, jerk = self._stepping, self._bounds[1]
        try:
            if not self._parts:
                together = synchronised or bool(self._groups)
                moved = stepped(*motion, target, acceleration, jerk, period_s, together)
            else:
                moved = np.empty((3, self._n))
            for part, grouped in self._parts:
                moved[:, part] = stepped(
                    *motion.of(part),
                    target[part],
                    acceleration[part],
                    jerk[part],
                    period_s,
                    synchronised or grouped,
                )
        except ValueError as error:
            raise TrajectoryError(f"velocity target {target} from {motion}: {error}") from error
        return Motion(moved[0], moved[1], moved[2])

    def step_and_stop(
        self, motion: Motion, target: Array, period_s: float, synchronised: bool
    ) -> tuple[Motion, Stop]:
        """Return the motion one period later, as `step`, and the quickest stop from there."""
        if self._groups:
            candidate = self.step(motion, target, period_s, synchronised)
            return candidate, self.stop(candidate)
        n = self._n
        moved, phases, low, high = np.empty((3, n)), np.zeros((2, 4, n)), np.empty(n), np.empty(n)
        try:
            duration_s = step_and_stop(
                *motion, target, self._stepping, *self._bounds, period_s, synchronised, self._ends,
                moved, phases, low, high,
            )  # fmt: skip
        except ValueError as error:
            raise TrajectoryError(f"velocity target {target} from {motion}: {error}") from error
        candidate = Motion(moved[0], moved[1], moved[2])
        return candidate, Stop(candidate, phases, low, high, duration_s)

    def shape(self, motion: Motion, target: Array, period_s: float) -> Motion:
        """Return velocities one period later on the way to `target` (n,), which arrive together.

        Their position, which nobody asks for, stays. It is the motion itself while all stands and
        is told to.
        """
        moved = np.empty((2, self._n))
        try:
            if not shape(motion.dq, motion.ddq, target, *self._bounds, period_s, moved):
                return motion
        except ValueError as error:
            raise TrajectoryError(f"velocity target {target} from {motion}: {error}") from error
        return Motion(motion.q, moved[0], moved[1])

    def straight(self, motion: Motion, target: Array, period_s: float) -> tuple[Motion, Stop]:
        """Return the motion one period later on the way to velocities `target` (n,), and its stop.

        Both in a straight line, as far as the motion of now allows: all freedoms keep their shares.
        """
        moved = _state(self._straight(motion, target, self._stepping).at_time(period_s))
        stop = self._straight(moved, np.zeros(self._n), self._bounds[0])
        return moved, Stop.along(moved, _phases(stop))

    def stop(self, motion: Motion) -> Stop:
        """Return the quickest stop: of each group in proportion, of other freedoms on their own."""
        acceleration, jerk = self._bounds
        try:
            phases = stopping(motion.dq, motion.ddq, acceleration, jerk)
            for g in self._groups:
                phases[:, :, g] = stopping_in_proportion(
                    motion.dq[g], motion.ddq[g], acceleration[g], jerk[g], phases[:, :, g]
                )
        except ValueError as error:
            raise TrajectoryError(f"stop from {motion}: {error}") from error
        return Stop.along(motion, phases)

    def _straight(self, motion: Motion, target: Array, acceleration: Array) -> "ruckig.Trajectory":
        self._input.target_velocity, self._input.max_acceleration = target, acceleration
        return _calculated(self._ruckig, self._input, motion, "velocity", target)


class PositionPlanner:
    """Position targets for n degrees of freedom, ending at rest, in straight lines where it can."""

    def __init__(self, n: int, straight: bool = True) -> None:
        """Build for n freedoms; not `straight`, each goes its own way, which is always feasible."""
        self._straight = straight
        self._ruckig = ruckig.Ruckig(n)
        self._input = ruckig.InputParameter(n)
        self._input.synchronization = (
            ruckig.Synchronization.Phase if straight else ruckig.Synchronization.No
        )

    def plan(self, motion: Motion, target: Array, bounds: tuple[Array, Array, Array]) -> Profile:
        """Return the way from `motion` to rest at `target` (n,).

        `bounds` are velocity, acceleration and jerk (n,) each.
        """
        i = self._input
        i.max_velocity, i.max_acceleration, i.max_jerk = bounds
        i.target_position = target
        trajectory = _calculated(self._ruckig, i, motion, "position", target)
        plan = Plan(motion, target, bounds, self._straight)
        return Profile(trajectory, trajectory.duration, plan)
