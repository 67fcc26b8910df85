"""The drives' power follows the mode: on and off by what the drives say, and never against it.

The arm is enabled from drives that are off: each is given room for where its joint stands, and then
led to Operation enabled. While the arm is energised, a drive that is anywhere else is a fault.
"""

from ..config.load import Cell
from ..drivers.device import Cause, Trouble
from ..protocols.cia402 import DriveState
from .control.frames import Array
from .events import Events
from .mode import Mode
from .plant import Plant, PlantReading

OUTSIDE = 1e-4
"""A joint is outside its limit from here on: less is what an encoder rounds [rad]."""


class Power:
    """Switches the drives of one cell."""

    def __init__(self, cell: Cell, plant: Plant, events: Events) -> None:
        self._plant, self._events = plant, events
        self._joints = cell.robot.joints
        nodes = {d.joint: d.node for d in cell.config.mechanism.drives}
        self._nodes = [nodes[j.name] for j in self._joints]
        self._begun = False

    def follow(self, on: bool, reading: PlantReading) -> bool:
        """Lead the drives on, or off; where they are still on their way off, that comes first.

        For READY, every tick. Returns whether it blocked, while a drive was given room; raises
        `DeviceError` where one cannot be.
        """
        blocked = False
        if not on:
            self._begun = False
        elif not self._begun and reading.off and reading.q is not None:
            self._tell_outside(reading.q)
            blocked = self._plant.make_room()
            self._begun = True
        if self._begun:
            self._plant.enable()
        else:
            self._plant.disable()
        return blocked

    def trouble(self, mode: Mode, reading: PlantReading) -> Trouble | None:
        """Return which drive is not on though the mode says so, or None."""
        if not mode.energised:
            return None
        for joint, node, state in zip(self._joints, self._nodes, reading.states, strict=True):
            if state is not DriveState.OPERATION_ENABLED:
                there = "no state" if state is None else state.name.lower()
                detail = f"the mode is {mode}, the drive is in {there}"
                return Trouble(Cause.STATE_LOST, joint.name, detail, {"node": node})
        return None

    def _tell_outside(self, q: Array) -> None:
        """Name every joint that stands outside its limits, and by how much."""
        for joint, angle in zip(self._joints, q.tolist(), strict=True):
            beyond = max(joint.lower - angle, angle - joint.upper)
            if beyond > OUTSIDE:
                limit = joint.lower if angle < joint.lower else joint.upper
                self._events.warning(
                    "outside_limit",
                    f"{joint.name}: {beyond:.4f} rad beyond {limit:.4f}: it can only be moved back",
                    joint=joint.name,
                    beyond_rad=beyond,
                    position_rad=angle,
                    limit_rad=limit,
                )
