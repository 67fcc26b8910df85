"""A task: its sources, their gains, and the sum of what they ask of one MRF.

Every source is always on; the rates add (Williams 1997, section 2). When MRF, CRF or ground are
others than a tick ago, the same motion goes on: what a source remembers is carried to the new
frames, and what its rate jumps by is owed and paid back smoothly (`feedforward.py`).
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np

from ....config.schema.sources.schedule import ScheduleSection
from ....config.schema.sources.sources import SourcesSection
from ..rigid_body import differ
from ..spatial import Array, sizes
from .feedforward import NOT_LED, Feedforward, FeedforwardState
from .gains import Gains, Quantities
from .paths.leading import PositionState
from .source import NO_TWIST, About, Context, Granted, Redefined, Shaping, Source
from .sources.force import ForceState
from .table import KINDS

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
    ) -> TaskMemory:
        """Return the memory with the gains in effect: scheduled, and ramped while moving.

        Those of the sources `at_once` fall without a ramp.
        """
        gains = self._gains.scheduled(target, quantities)
        if moving and memory.gains.keys() == gains.keys():
            gains = self._gains.ramped(memory.gains, gains, at_once)
        return memory if gains is memory.gains else memory._replace(gains=gains)

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
        asked = context.asked
        about = About(
            asked.T_wrist_mrf,
            asked.T_wrist_goal,
            None if asked.goal is None else asked.goal.serial,
            asked.ground,
            asked.T_world_crf.R,
            asked.redefined,
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
        return TaskMemory(states, gains, feedforward, about, memory.off_path), twists

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
        return TaskMemory(states, memory.gains, memory.feedforward, memory.about, off_path)

    def _jump(
        self,
        context: Context,
        redefined: Redefined,
        states: Mapping[str, Any],
        gains: Mapping[str, Array],
        twists: Mapping[str, Array],
    ) -> Array:
        """Return what the sum was more before a redefinition (6,)."""
        jump, before = np.zeros(6), redefined.before
        if redefined.grounded and context.moved is not None and context.carried is not None:
            jump += context.moved.carries(before.ground, context.T_world_mrf.p) - context.carried
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
    asked = context.asked
    other = differ(before.T_wrist_mrf, asked.T_wrist_mrf)
    grounded = before.ground != asked.ground
    jumps = other or grounded or before.redefined != asked.redefined
    if not (jumps or differ(before.T_wrist_goal, asked.T_wrist_goal)):
        return None
    way = context.T_world_wrist.R @ (asked.T_wrist_mrf.p - before.T_wrist_mrf.p)
    return Redefined(before, way if other else None, way, grounded, jumps)
