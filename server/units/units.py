"""All units of a cell: found by the names of task or mechanism, and asked together."""

from collections.abc import Sequence
from typing import Self

import numpy as np

from ...config.load import Cell
from ...protocols.messages.messages import CancelGoals, MechanismCommand, Message, TaskCommand
from ..commands.settings import CellSettings
from ..control.spatial import Array
from ..control.tick import Control
from ..perception.obstacle_map import ObstacleMap
from ..refusals import Refused, Why
from ..runtime.events import Events
from .unit import Unit


class Units:
    """The units of a cell in the order of its joints, and what they share."""

    def __init__(
        self, units: Sequence[Unit], settings: CellSettings, obstacles: ObstacleMap
    ) -> None:
        """Build it of at least one unit; they have one period."""
        self.each = tuple(units)
        self.settings, self.obstacles = settings, obstacles

    @classmethod
    def from_cell(cls, cell: Cell, control: Control, events: Events) -> Self:
        """Return the units of a loaded cell; nothing is asked of them yet."""
        settings = CellSettings.from_config(cell.config)
        units = [
            Unit(part, arm, joints, settings, events)
            for part, arm, joints in zip(cell.parts, control.arms, control.parts, strict=True)
        ]
        return cls(units, settings, ObstacleMap.from_cell(cell, events))

    # --- which of them is meant ------------------------------------------------------------------

    def of(self, message: Message) -> Unit:
        """Return the unit that a message concerns: the first where it names none.

        Raises `Refused` for a name that the cell does not have.
        """
        if isinstance(message, TaskCommand) and message.task is not None:
            return self._named(message.task, Why.UNKNOWN_TASK, "task")
        if isinstance(message, MechanismCommand) and message.mechanism is not None:
            return self._named(message.mechanism, Why.UNKNOWN_MECHANISM, "mechanism")
        return self.each[0]

    def told(self, message: Message) -> tuple[Unit, ...]:
        """Return the units that a command is for: all, for goals that are cancelled without a name.

        Raises `Refused` as `of` does.
        """
        if isinstance(message, CancelGoals) and message.task is None:
            return self.each
        return (self.of(message),)

    def seeing(self, camera: str) -> Unit:
        """Return the unit whose task has a camera; the first for one that nobody has."""
        for unit in self.each:
            if any(c.name == camera for c in unit.cell.config.cameras):
                return unit
        return self.each[0]

    def _named(self, name: str, why: Why, kind: str) -> Unit:
        for unit in self.each:
            if getattr(unit, kind) == name:
                return unit
        known = ", ".join(getattr(unit, kind) for unit in self.each)
        raise Refused(why, f"{kind} {name!r} is none of: {known}")

    # --- asked together --------------------------------------------------------------------------

    def clear(self) -> None:
        """Drop every stream and goal: what was commanded before is dead."""
        for unit in self.each:
            unit.commands.clear()

    def forget(self) -> None:
        """Void what was computed: the next tick begins where the joints are."""
        for unit in self.each:
            unit.memory = None

    @property
    def at_rest(self) -> bool:
        """True while all arms are told to stand."""
        return all(unit.output is not None and unit.output.at_rest for unit in self.each)

    @property
    def following_error(self) -> Array | None:
        """How far all joints (n,) are behind their commands [rad]; None before the first tick."""
        errors = [u.output.following_error for u in self.each if u.output is not None]
        if len(errors) < len(self.each):
            return None
        return errors[0] if len(errors) == 1 else np.concatenate(errors)

    def holding(self, q: Array) -> Array:
        """Return the torques (n,) that hold all joints at rest at q (n,) [N·m]."""
        held = [unit.holding(q[unit.joints]) for unit in self.each]
        return held[0] if len(held) == 1 else np.concatenate(held)

    @property
    def touched(self) -> bool:
        """True while something unseen pushes an arm, which stopped for it."""
        return any(unit.perception.touched for unit in self.each)

    @property
    def missed(self) -> tuple[str, ...]:
        """Sensors that are stale, and without which nothing may move."""
        return tuple(
            f"{unit.cell.prefix}{name}"
            for unit in self.each
            for name in unit.perception.sensor.missed
        )

    @property
    def reason_to_stop(self) -> str | None:
        """Why perception lets the arms not move, or None."""
        if self.missed:
            return "sensor stale"
        if self.settings.avoid and self.obstacles.stop is not None:
            return "obstacle stale"
        return "touched" if self.touched else None
