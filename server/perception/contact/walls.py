"""Wall monitor: tells of links beyond a wall of their tunnel, and of joints that do not follow.

Limits slow what leads into a wall. What stands in one already, since it was enabled there, a joint
does not follow, or the tunnel is not where the cell says, is slowed by none of them: it is told.
"""

from typing import Final

from ...control.arm.arm import Arm
from ...control.spatial import Array
from ...control.state import Memory
from ...runtime.events import Events

LOOK_S: Final = 0.1
"""Walls are looked at so often [s]."""
BEYOND: Final = 1e-3
"""A link that is less beyond a wall may as well touch it [m]."""
WORSE: Final = 5e-3
"""One that has gone so much farther since it was told is told again [m]."""


class WallMonitor:
    """Tells when links come to stand beyond a wall, go farther, and are out of it again."""

    def __init__(self, arm: Arm, period_s: float, events: Events) -> None:
        self._arm, self._events = arm, events
        self._every = max(1, round(LOOK_S / period_s))
        self._ticks = 0
        self._told = 0.0
        """How far beyond it was when that was told last; 0: it is not beyond any [m]."""
        self._locked: frozenset[str] = frozenset()

    def update(self, memory: Memory | None, q: Array | None) -> None:
        """Look at the measured joints q (n,) [rad], now and then."""
        self._ticks += 1
        if self._ticks % self._every or memory is None or q is None:
            return
        self._tell_locked(self._arm.locked_joints(memory))
        beyond = self._arm.beyond_wall(memory, q)
        if beyond > BEYOND and (not self._told or beyond > self._told + WORSE):
            self._told = beyond
            self._events.warning(
                "beyond_wall",
                f"a link stands {1e3 * beyond:.1f} mm beyond the wall of its tunnel",
                beyond_m=beyond,
            )
        elif self._told and beyond <= 0.0:
            self._told = 0.0
            self._events.info("off_wall", "no link stands beyond a wall any more")

    def _tell_locked(self, locked: dict[str, float]) -> None:
        for joint in locked.keys() - self._locked:
            self._events.warning(
                "joint_locked",
                f"{joint} stands at {locked[joint]:.3f} rad and does not follow",
                joint=joint,
                angle_rad=locked[joint],
            )
        self._locked = frozenset(locked)
