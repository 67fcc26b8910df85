"""Power of the drives: switched on and off with the mode, step by step with their states.

The arm is enabled from drives that are off: each is given room for where its joint stands, and the
torque that holds it there, and then led to Operation enabled.
"""

from collections.abc import Callable

from ..config.load import UrdfJoint
from .control.spatial import Array
from .plant import Plant, PlantReading
from .runtime.events import Events

OUTSIDE = 1e-4
"""A joint is outside its limit from here on: less is what an encoder rounds [rad]."""


class DrivePower:
    """Switches the drives of one cell; `holding` returns the torques (n,) that hold joints (n,)."""

    def __init__(
        self,
        joints: tuple[UrdfJoint, ...],
        plant: Plant,
        events: Events,
        holding: Callable[[Array], Array],
    ) -> None:
        self._plant, self._events, self._holding = plant, events, holding
        self._joints = joints
        self._begun = False

    def follow(self, on: bool, reading: PlantReading) -> bool:
        """Lead the drives on, or off; where they are still on their way off, that comes first.

        For READY, every tick. Returns whether it blocked, while a drive was prepared; raises
        `DeviceError` where one cannot be.
        """
        blocked = False
        if not on:
            self._begun = False
        elif not self._begun and reading.off and reading.q is not None:
            self._tell_outside(reading.q)
            blocked = self._plant.prepare(self._holding(reading.q))
            self._begun = True
        if self._begun:
            self._plant.enable()
        else:
            self._plant.disable()
        return blocked

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
