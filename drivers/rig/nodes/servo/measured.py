"""Objects of a simulated drive that are measured when they are read."""

from collections.abc import Callable
from typing import Final

from .....config.schema.mechanism.mechanism import DriveSection
from .....protocols.canopen.cia402 import Object
from .....protocols.canopen.counter import wrapped
from ...physics.world import World
from ..drive_loops import DriveLoops

_I16: Final = 2**15 - 1
_REACHED_RAD: Final = 1e-3


class Measured:
    """One joint as its drive's encoder and current sensor tell it, in the drive's own units."""

    def __init__(self, drive: DriveSection, joint: int, loop: DriveLoops, world: World) -> None:
        self._drive, self._joint, self._loop, self._world = drive, joint, loop, world
        self._scale = drive.direction * drive.counts_per_radian

    def objects(self) -> dict[tuple[int, int], Callable[[], int]]:
        """Return how each object is measured."""
        return {
            (Object.POSITION_DEMAND, 0): self._demand,
            (Object.POSITION_ACTUAL, 0): self._position,
            (Object.VELOCITY_ACTUAL, 0): lambda: round(self._scale * self._world.dq[self._joint]),
            (Object.FOLLOWING_ERROR, 0): lambda: round(self._scale * self._error),
            (Object.TORQUE_ACTUAL, 0): self._torque,
            (Object.RATED_TORQUE, 0): lambda: round(self._drive.rated_torque * 1000),
        }

    @property
    def target_reached(self) -> bool:
        """Whether the joint stands at its reference."""
        return abs(self._error) < _REACHED_RAD and self._loop.at_rest(self._joint)

    @property
    def _error(self) -> float:
        return float(self._loop.error[self._joint])

    def _position(self) -> int:
        return self._to_counts(self._world.angle(self._joint))

    def _demand(self) -> int:
        return self._to_counts(self._world.angle(self._joint) + self._error)

    def _to_counts(self, angle: float) -> int:
        return wrapped(round(self._scale * (angle - self._drive.zero_rad)))

    def _torque(self) -> int:
        torque = float(self._loop.reported[self._joint])
        share = torque / self._drive.rated_torque * self._drive.direction
        return max(-_I16, min(_I16, round(share * 1000)))
