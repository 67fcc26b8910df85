"""Power stage and brake of one simulated drive: who holds the joint, and when that changes.

A drive that is set rightly holds the joint before it opens the brake, and until the brake has
closed; one that is set wrongly (`torque_delay_s`) opens the brake first, and the joint sags.
"""

from collections.abc import Callable

from .....config.schema.rig.rig import RigDriveSection
from ...physics.world import World
from ..canopen.can_node import NEVER
from ..drive_loops import DriveLoops


class PowerStage:
    """Engages and releases the loop of one joint, and moves its brake.

    `on_held` is called where a setpoint that is there already is to act, before the drive follows:
    the torque of CST.
    """

    def __init__(
        self,
        joint: int,
        loop: DriveLoops,
        world: World,
        physics: RigDriveSection,
        clock: Callable[[], float],
        on_held: Callable[[], None],
    ) -> None:
        self._joint, self._loop, self._world = joint, loop, world
        self._sag_s, self._release_s = physics.torque_delay_s, physics.brake_delay_s
        self._clock, self._on_held = clock, on_held
        self._follows_at_s = self._lets_go_at_s = NEVER

    @property
    def due_s(self) -> float:
        """Physics time at which `tick` has something to do next [s]."""
        return min(self._follows_at_s, self._lets_go_at_s)

    @property
    def coming_on(self) -> bool:
        """True from `switch_on` until the brake is open and the drive follows."""
        return self._follows_at_s < NEVER

    def switch_on(self) -> None:
        """Begin to hold the joint and to open the brake."""
        self._let_go()
        sags = self._sag_s > 0.0
        if sags:
            self._world.set_brake(self._joint, closed=False)
        else:
            self._hold()
        self._follows_at_s = self._clock() + (self._sag_s if sags else self._release_s)

    def switch_off(self, *, at_once: bool = False) -> None:
        """Close the brake, and hold the joint until it has closed; not if the power is lost."""
        self._follows_at_s = NEVER
        self._world.set_brake(self._joint, closed=True)
        delay_s = self._world.brakes.delay_s(self._joint)
        if at_once or delay_s <= 0.0:
            self._let_go()
        elif self._lets_go_at_s == NEVER:
            self._lets_go_at_s = self._clock() + delay_s

    def tick(self, now: float) -> bool:
        """Do what is due; return whether the drive follows from now on."""
        if now >= self._lets_go_at_s:
            self._let_go()
        if now < self._follows_at_s:
            return False
        self._follows_at_s = NEVER
        if self._sag_s > 0.0:
            self._hold()
        else:
            self._world.set_brake(self._joint, closed=False)
            self._on_held()
        return True

    def ramp_down(self, deceleration: float, *, from_torque: bool) -> None:
        """Bring the joint to rest by the drive's own loop [rad/s²]; `from_torque`: out of CST."""
        joint, world = self._joint, self._world
        if from_torque:
            self._loop.take_over(joint, float(world.q[joint]), float(world.dq[joint]))
        self._loop.ramp_down(joint, deceleration)

    def give_up_error(self) -> None:
        """Put the reference where the joint is: no following error is left."""
        joint, world = self._joint, self._world
        self._loop.resume_from(joint, float(world.q[joint]), float(world.dq[joint]))

    def _hold(self) -> None:
        self._loop.engage(self._joint, float(self._world.q[self._joint]))
        self._on_held()

    def _let_go(self) -> None:
        self._lets_go_at_s = NEVER
        self._loop.release(self._joint)
