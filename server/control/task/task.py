"""A task: its sources, their gains, and the sum of what they ask of one MRF."""

import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np

from ....config.schema.sources import ScheduleSection, SourcesSection
from ..axes import FREE_TIME_S, faded
from ..spatial import NO_TWIST, Array, Motion, differ, largest, sizes, twist_at, within
from ..stop.trajectory import VelocityPlanner
from .following import Following
from .position import Position, PositionState
from .source import About, Context, Granted, Redefined, Shaping, Source
from .sources import (
    LETS_GO_S,
    PRESSED,
    Force,
    ForceState,
    Joystick,
    PointAt,
    Reflex,
    Spring,
    Vision,
    eased,
    pressed,
)

# --- Gains in effect: what was set, times what the cell's schedules say, and every change ramped
#
# A schedule is a table: a quantity (contact force, distance to the target, time since enable)
# to a factor between 0 and 1, straight lines between its points. A factor never exceeds 1, so
# that a gain that is stable when it is set stays so whatever its schedules do.

GAIN_TIME_S = 0.15
"""Time constant with which a changed gain takes effect [s]."""


class Quantities(NamedTuple):
    """Values that schedules may depend on; None where one is not known."""

    contact_force: float | None
    """Size of the contact force at the MRF [N]; None when the sensor is stale."""
    distance: float | None
    """From the MRF to the position source's target [m]; None without one."""
    time: float
    """Since the arm was enabled or resumed [s]."""


class Gains:
    """The gains of all sources under the schedules of a cell."""

    def __init__(self, schedules: tuple[ScheduleSection, ...], period_s: float) -> None:
        self._schedules = tuple(
            (s.source, s.by, np.array(s.at), np.array(s.factor), np.array(s.axes))
            for s in schedules
        )
        self.part = 1.0 - math.exp(-period_s / GAIN_TIME_S)
        """Share of the way to a new gain that is gone in one period [1]."""

    def scheduled(
        self, gains: dict[str, Array], quantities: Callable[[], Quantities]
    ) -> dict[str, Array]:
        """Return each source's gain (6,) times the factors of its schedules.

        A force that is not known counts as the worst of its table; without a target, the distance
        to it counts as beyond the table's end.
        """
        if not self._schedules:
            return gains
        now = quantities()
        found = dict(gains)
        for source, by, at, factor, axes in self._schedules:
            value: float | None = getattr(now, by)
            if value is not None:
                f = float(np.interp(value, at, factor))
            else:
                f = float(factor.min()) if by == "contact_force" else float(factor[-1])
            found[source] = found[source] * (1.0 - axes * (1.0 - f))
        return found

    def ramped(
        self, now: dict[str, Array], target: dict[str, Array], at_once: tuple[str, ...] = ()
    ) -> dict[str, Array]:
        """Return the gains one period later on their way to the target, so that nothing jumps.

        Those of the sources that are named are there `at_once`. The target itself once all are.
        """
        if now is target:
            return target
        ramped, there = {}, True
        for name, gain in now.items():
            aim = target[name]
            way = aim - gain
            near = gain is aim or name in at_once or largest(way) < 1e-7
            ramped[name] = aim if near else gain + self.part * way
            there = there and near
        return target if there else ramped


# --- The motion of what motion is measured against, fed forward; and no jump when that changes ----
#
# Every source asks for a motion of the MRF relative to a *ground*: World, Base or Carrier. An
# arm on Base makes it so by adding the ground's own twist, seen from Base, at the MRF: so a
# target on a conveyor is followed without a steady error, and a tool keeps still in World above
# a base that sways. It is one more term of the sum (Williams 1997, section 2: rates add), and
# leaves the others as they are.
#
# What sources remember is carried to a new MRF (`Source.carry`). The rest of a redefinition,
# such as a gain that acts along other axes, or another ground, makes the sum jump while the arm
# moves. What it jumps by (`Source.jump`) is owed: added, and paid back inside the acceleration
# and jerk bounds. No more is ever owed than the tool's greatest speed, so that it is soon paid,
# however often frames change.


class FeedforwardState(NamedTuple):
    """The motion that is still owed."""

    leading: bool = False
    """Sources led the arm in the last tick."""
    owed: Motion | None = None
    """At a point of the tool that stays the same, World axes (6,)."""


NOT_LED: Final = FeedforwardState()
"""No source leads the arm."""
_LED: Final = FeedforwardState(True)
"""Sources lead the arm, and nothing is owed."""


class Feedforward:
    """Feeds the ground's motion forward; `acceleration`, `jerk` (6,) bound how debts are paid.

    No more is owed than a twist of `most` [m/s], [rad/s].
    """

    def __init__(
        self, acceleration: Array, jerk: Array, most: tuple[float, float], period_s: float
    ) -> None:
        self._planner = VelocityPlanner(acceleration, jerk)
        self._most = most
        self._period_s = period_s

    def rate(
        self, state: FeedforwardState, carried: Array | None, jump: Array | None, lever: Array
    ) -> tuple[Array, FeedforwardState]:
        """Return the twist (6,) of the MRF in World axes that is added to the sources' sum.

        `carried` (6,) is the ground's twist seen from Base, at the MRF; None where nothing moves.
        `jump` (6,) is what all was more before a redefinition, of sources and ground together.
        `lever` (3,) leads from the MRF to the point of the tool at which debts are kept [m].
        """
        owed = state.owed
        if not state.leading:
            owed = None
            jump = None if carried is None else -carried
        elif owed is not None:
            owed = self._planner.step(owed, np.zeros(6), self._period_s, synchronised=True)
            owed = None if owed.stands() else Motion(np.zeros(6), owed.dq, owed.ddq)
        if jump is not None:
            already, ddq = (np.zeros(6), np.zeros(6)) if owed is None else owed[1:]
            more = within(already + twist_at(jump, lever), self._most)
            owed = Motion(np.zeros(6), more, ddq)
        twist = NO_TWIST if carried is None else carried
        if owed is None:
            return twist, _LED
        return twist + twist_at(owed.dq, -lever), FeedforwardState(True, owed)


# --- The sources that there are: one row each, by the name of its section in the cell file --------

KINDS: Final = MappingProxyType[str, type[Source[Any]]](
    {
        "joystick": Joystick,
        "position": Position,
        "vision": Vision,
        "force": Force,
        "following": Following,
        "spring": Spring,
        "point_at": PointAt,
        "reflex": Reflex,
    }
)


# --- A task: its sources, their gains, and the sum of what they ask of one MRF --------------------
#
# Every source is always on; the rates add (Williams 1997, section 2). When MRF, CRF or ground
# are others than a tick ago, the same motion goes on: what a source remembers is carried to the
# new frames, and what its rate jumps by is owed and paid back smoothly (`task.py`).

FRAMES: Final = "frames"
"""Name of the ground's own motion among the twists."""

ORDERED: Final = 1e-3
"""A source that asks for more than this means it; below, it makes up for noise [m/s, rad/s]."""


class TaskMemory(NamedTuple):
    """Memory of one task from tick to tick."""

    states: Mapping[str, Any]
    """Each source's state by name."""
    gains: dict[str, Array]
    """The sources' gains (6,) in effect."""
    feedforward: FeedforwardState = NOT_LED
    about: About | None = None
    """The frame and point that the sources' rates of the last tick belonged to."""
    off_path: Array | None = None
    """Where the virtual link has the tool off its path, in World (3,) [m]; None where it is not."""
    held: Array | None = None
    """How far the axes of the MRF (6,) are held, from 0, free, to 1; None: all are."""
    press: Array | None = None
    """The wrench by which something is pressed, for 1 N or what counts of it (6,), in World."""

    @property
    def position(self) -> PositionState:
        """How far the goal is under way."""
        state: PositionState = self.states["position"]
        return state

    @property
    def force(self) -> ForceState:
        """Contact being bled off."""
        state: ForceState = self.states["force"]
        return state


class Task:
    """The sources of one task."""

    def __init__(
        self, sections: SourcesSection, schedules: tuple[ScheduleSection, ...], shaping: Shaping
    ) -> None:
        self._sources = {
            name: kind(getattr(sections, name), shaping) for name, kind in KINDS.items()
        }
        self._no_orders = {name for name, kind in KINDS.items() if not kind.ORDERS}
        self._feedforward = Feedforward(
            shaping.acceleration, shaping.jerk, shaping.most, shaping.period_s
        )
        self._gains = Gains(schedules, shaping.period_s)
        self.part = self._gains.part
        """Share of the way to a new gain that is gone in one period [1]."""
        self._fading = shaping.period_s / FREE_TIME_S
        self._most_press, self._letting_go = sections.force.most_press, shaping.period_s / LETS_GO_S
        self._acceleration = float(shaping.acceleration[:3].max())
        self._advancing = tuple(
            (name, source)
            for name, source in self._sources.items()
            if type(source).advance is not Source.advance
        )
        self._idle = {name: source.idle() for name, source in self._sources.items()}
        self.idle = TaskMemory(MappingProxyType(self._idle), {})
        """The memory of a task that was asked for nothing yet."""

    def tuned(
        self,
        memory: TaskMemory,
        target: dict[str, Array],
        quantities: Callable[[], Quantities],
        moving: bool,
        at_once: tuple[str, ...] = (),
        held: Array | None = None,
    ) -> TaskMemory:
        """Return the memory with the gains in effect: scheduled, and ramped while moving.

        Those of the sources `at_once` fall without a ramp. `held` (6,) are the axes that the task
        is to hold, 1 for held and 0 for free; None: all.
        """
        gains = self._gains.scheduled(target, quantities)
        if moving and memory.gains.keys() == gains.keys():
            gains = self._gains.ramped(memory.gains, gains, at_once)
            held = faded(memory.held, held, self._fading)
        if gains is memory.gains and held is memory.held:
            return memory
        return memory._replace(gains=gains, held=held)

    def twists(self, memory: TaskMemory, context: Context) -> tuple[TaskMemory, dict[str, Array]]:
        """Return each source's twist (6,) in World axes, and last the ground's own motion.

        A source without a gain asks for nothing.
        """
        redefined = _redefined(memory.about, context)
        before, gains = memory.states, memory.gains
        if redefined is not None:
            before = {
                name: source.carry(before[name], context, redefined)
                for name, source in self._sources.items()
            }
        twists: dict[str, Array] = {}
        states: dict[str, Any] = {}
        for name, source in self._sources.items():
            gain = gains.get(name)
            if gain is None:
                twists[name], states[name] = NO_TWIST, self._idle[name]
            else:
                twists[name], states[name] = source.rate(context, before[name], gain)
        frames, feedforward = NO_TWIST, NOT_LED
        settings, goal = context.inputs.settings, context.goal
        about = About(
            settings.T_wrist_mrf,
            context.T_wrist_goal,
            None if goal is None else goal.serial,
            context.inputs.ground,
            settings.T_world_crf.R,
            settings.redefined,
            twists,
        )
        if context.guided:
            jump = None
            if redefined is not None and redefined.jumps and memory.feedforward.leading:
                jump = self._jump(context, redefined, before, gains, twists)
            frames, feedforward = self._feedforward.rate(
                memory.feedforward, context.carried, jump, context.lever
            )
        twists[FRAMES] = frames
        rest = memory.off_path, memory.held, memory.press
        return TaskMemory(states, gains, feedforward, about, *rest), twists

    def eased(
        self,
        memory: TaskMemory,
        twists: Mapping[str, Array],
        wrench: Array | None,
        R_world_mrf: Array,
        arms: int = 1,
        mass: float = 0.0,
    ) -> tuple[TaskMemory, Array | None]:
        """Return the twist (6,) that keeps sources from pressing harder than the cell's bound.

        `wrench` (6,) is what so many arms together exert, at and in the MRF, None where that is
        not known. What speeds up a `mass` [kg] is in it, too. None: they press less.
        """
        least = PRESSED * self._most_press + mass * self._acceleration
        press = pressed(memory.press, wrench, R_world_mrf, least, self._letting_go)
        if press is None:
            return (memory if memory.press is None else memory._replace(press=None)), None
        asked = sum((twist for name, twist in twists.items() if name != "force"), np.zeros(6))
        gain = memory.gains.get("force", NO_TWIST) / arms
        take = eased(asked, press, gain, R_world_mrf, self._most_press)
        return memory._replace(press=press), take

    def orders(self, twists: Mapping[str, Array]) -> bool:
        """Return whether any of the twists (6,) is an operator's or a device's wish to move."""
        return any(
            max(sizes(twist)) > ORDERED
            for name, twist in twists.items()
            if twist is not NO_TWIST and name not in self._no_orders
        )

    def advanced(
        self, memory: TaskMemory, granted: Granted, off_path: Array | None = None
    ) -> TaskMemory:
        """Return the memory after a tick that granted so much of what was asked for.

        `off_path` (3,) is where the virtual link has the tool off its path now.
        """
        states = dict(memory.states)
        for name, source in self._advancing:
            states[name] = source.advance(states[name], granted)
        return memory._replace(states=states, off_path=off_path)

    def _jump(
        self,
        context: Context,
        redefined: Redefined,
        states: Mapping[str, Any],
        gains: Mapping[str, Array],
        twists: Mapping[str, Array],
    ) -> Array:
        """Return what the sum was more before a redefinition (6,)."""
        jump, before, moved = np.zeros(6), redefined.before, context.inputs.moved
        if redefined.grounded and moved is not None and context.carried is not None:
            jump += moved.carries(before.ground, context.k.T_world_mrf.p) - context.carried
        for name, source in self._sources.items():
            if name in gains:
                more = source.jump(context, redefined, states[name], gains[name], twists[name])
                if more is not None:
                    jump += more
        return jump


def _redefined(before: About | None, context: Context) -> Redefined | None:
    """Return the frames of now and before where they differ, else None."""
    if before is None:
        return None
    settings = context.inputs.settings
    other = differ(before.T_wrist_mrf, settings.T_wrist_mrf)
    grounded = before.ground != context.inputs.ground
    jumps = other or grounded or before.redefined != settings.redefined
    if not (jumps or differ(before.T_wrist_goal, context.T_wrist_goal)):
        return None
    way = context.k.T_world_wrist.R @ (settings.T_wrist_mrf.p - before.T_wrist_mrf.p)
    return Redefined(before, way if other else None, way, grounded, jumps)
