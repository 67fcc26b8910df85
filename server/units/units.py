"""All units of a cell: found by the names of task or mechanism, and asked together."""

from collections.abc import Sequence
from typing import Self

import numpy as np

from ...config.load import Cell
from ...protocols.messages.messages import CancelGoals, MechanismCommand, Message, TaskCommand
from ...protocols.messages.perception.sightings import StoreView
from ..commands.settings import CellSettings
from ..control.joint_task.several import JointTasks
from ..control.joint_task.switch import HoldRefused
from ..control.spatial import Array
from ..control.tick import Control
from ..perception.ahead.passage import Passage
from ..perception.obstacle_map import ObstacleMap
from ..refusals import Refused, Why
from ..runtime.events import Events
from .joint_unit import JointUnit, of_task
from .stop_ramps import curve_ramps
from .unit import Unit


class Units:
    """The units of a cell in the order of its joints, and what they share."""

    def __init__(
        self,
        units: Sequence[Unit],
        settings: CellSettings,
        obstacles: ObstacleMap,
        joint: Sequence[JointUnit] = (),
        tasks: JointTasks | None = None,
    ) -> None:
        """Build it of at least one unit; they have one period.

        `joint` are the tasks that several of them hold, `tasks` computes these.
        """
        self.each, self.joint = tuple(units), tuple(joint)
        self._tasks = tasks
        self.settings, self.obstacles = settings, obstacles

    @classmethod
    def from_cell(cls, cell: Cell, control: Control, events: Events) -> Self:
        """Return the units of a loaded cell; nothing is asked of them yet."""
        settings = CellSettings.from_config(cell.config)
        units = [
            Unit(part, arm, joints, settings, events)
            for part, arm, joints in zip(cell.parts, control.arms, control.parts, strict=True)
        ]
        by = {unit.mechanism: unit for unit in units}
        joint = [
            JointUnit(cell, task, [by[name] for name in task.by], settings, events)
            for task in cell.joint_tasks
        ]
        return cls(units, settings, ObstacleMap.from_cell(cell, events), joint, control.joint)

    # --- which of them is meant ------------------------------------------------------------------

    def of(self, message: Message) -> Unit | JointUnit:
        """Return the unit that a message concerns: the first where it names none.

        That is the joint task that the first arm holds a payload for, if it does; the view to be
        stored is that of whoever has the camera. Raises `Refused` for a name that the cell does not
        have, and for what is meant for one arm alone while it holds a payload with others.
        """
        unit = self.each[0]
        if isinstance(message, TaskCommand):
            for joint in self.joint:
                if joint.task == message.task:
                    if not joint.on:
                        raise Refused(Why.NOT_NOW, f"nobody holds '{joint.task}'")
                    joint.require_shared(message)
                    return joint
            if message.task is not None:
                unit = self._named(message.task, Why.UNKNOWN_TASK, "task")
            else:
                if isinstance(message, StoreView) and message.camera is not None:
                    unit = self.seeing(message.camera)
                held = self.holder_of(unit)
                if held is not None:
                    held.require_shared(message)
                    return held
        elif isinstance(message, MechanismCommand) and message.mechanism is not None:
            unit = self._named(message.mechanism, Why.UNKNOWN_MECHANISM, "mechanism")
        holder = self.holder_of(unit)
        if holder is not None:
            holder.require(message)
        return unit

    def told(self, message: Message) -> tuple[Unit | JointUnit, ...]:
        """Return the units that a command is for: all, for goals that are cancelled without a name.

        Raises `Refused` as `of` does.
        """
        if isinstance(message, CancelGoals) and message.task is None:
            return self.all
        return (self.of(message),)

    @property
    def all(self) -> tuple[Unit | JointUnit, ...]:
        """All that may be commanded: arms, and tasks that several of them hold."""
        return (*self.each, *self.joint)

    def holder_of(self, unit: Unit) -> JointUnit | None:
        """Return the joint task for which an arm holds a payload now, or None."""
        return next((joint for joint in self.joint if joint.on and unit in joint.units), None)

    def hold_together(self, name: str | None, on: bool) -> None:
        """Let the arms of a joint task hold its payload, or let go of it. Raises `Refused`."""
        joint = of_task(self.joint, name)
        memories = [unit.memory for unit in self.each if unit.memory is not None]
        q = [unit.q for unit in self.each if unit.q is not None]
        if self._tasks is None or not len(memories) == len(q) == len(self.each):
            raise Refused(Why.NOT_NOW, "where the arms are was not heard yet")
        try:
            found = self._tasks.switched(joint.task, on, memories, q)
        except HoldRefused as refused:
            raise Refused(Why.NOT_NOW, str(refused)) from None
        for unit, memory in zip(self.each, found, strict=True):
            unit.memory = memory
        told: list[Unit | JointUnit] = [joint, *joint.units]
        for unit_or_task in told:
            unit_or_task.commands.clear()
        joint.on = on
        joint.keep(None)
        joint.events.info(
            "held_together" if on else "let_go", ", ".join(unit.mechanism for unit in joint.units)
        )

    @property
    def held(self) -> tuple[str, ...]:
        """Names of the joint tasks that are on."""
        return tuple(joint.task for joint in self.joint if joint.on)

    def seeing(self, camera: str) -> Unit:
        """Return the unit whose task has a camera. Raises `Refused` for one that nobody has."""
        for unit in self.each:
            if any(c.name == camera for c in unit.cell.config.cameras):
                return unit
        known = ", ".join(c.name for unit in self.each for c in unit.cell.config.cameras) or "none"
        raise Refused(Why.UNKNOWN_CAMERA, f"{camera!r} is none of {known}")

    def ahead(self) -> Passage:
        """Return what keeps the contour ahead. Raises `Refused` in a cell that looks for none."""
        for unit in self.each:
            if unit.perception.passage is not None:
                return unit.perception.passage
        raise Refused(Why.NOT_NOW, "the cell says nothing of a contour")

    def _named(self, name: str, why: Why, kind: str) -> Unit:
        for unit in self.each:
            if getattr(unit, kind) == name:
                return unit
        known = ", ".join(getattr(unit, kind) for unit in self.each)
        raise Refused(why, f"{kind} {name!r} is none of: {known}")

    # --- asked together --------------------------------------------------------------------------

    def clear(self) -> None:
        """Drop every stream and goal: what was commanded before is dead."""
        for unit in self.all:
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

    @property
    def stop_ramps(self) -> dict[int, float]:
        """Ramps of a quick stop now, of joints that are to come to rest together [rad/s²].

        By the joints' places in the cell: those of an arm on a curve, and of arms that hold a
        payload together.
        """
        found: dict[int, float] = {}
        for unit in self.each:
            found.update(curve_ramps(unit))
        for joint in self.joint:
            if joint.on and joint.in_proportion:
                found.update(joint.stop_ramps())
        return found

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
            for name in _missed(unit, self.holder_of(unit))
        )

    @property
    def reason_to_stop(self) -> str | None:
        """Why perception lets the arms not move, or None."""
        if self.missed:
            return "sensor stale"
        for unit in self.each:
            if (frame := unit.perception.moving_frames.disputed) is not None:
                return f"news of {frame} disputed"
        if self.settings.avoid and self.obstacles.stop is not None:
            return "obstacle stale"
        if self.settings.avoid and any(unit.blind for unit in self.each):
            return "scanner silent"
        for joint in self.joint:
            if joint.reason_to_stop is not None:
                return joint.reason_to_stop
        return "touched" if self.touched else None


def _missed(unit: Unit, holder: JointUnit | None) -> tuple[str, ...]:
    """Return sensors without which an arm may not move; none holds a payload with others blind."""
    sensor = unit.perception.sensor
    return sensor.missed if holder is None else sensor.stale
