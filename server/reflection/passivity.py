"""Two ports of a network with delay, each kept from giving out energy that it never got.

Time-domain passivity with delayed energies (Ryu, Artigas, Preusche, Mechatronics 20, 2010; Artigas,
Ryu, Preusche, Hirzinger, IROS 2011): energy is counted at either port in two sums that never fall,
what has entered the network and what has left it. A port knows what had *entered* at the other one,
as late as the network is; it lets no more *leave* than that, and a small reserve. Late, reordered
or lost news can only make it let out less. At the arm's port the controller is an admittance: it
takes from the motion; at the handle's an impedance: it adds damping.
"""

from typing import NamedTuple

from ..control.spatial import Array

PARTS = (slice(0, 3), slice(3, 6))


class Port(NamedTuple):
    """Energy that passed a port so far [J]; neither number ever falls."""

    entered: float = 0.0
    """Into the network."""
    left: float = 0.0
    """Out of the network."""
    damped: float = 0.0
    """Taken out of what left by the port's own controller."""

    def passed(self, energy: float) -> "Port":
        """Return the port after an energy [J] went in, or out where it is negative."""
        if energy >= 0.0:
            return self._replace(entered=self.entered + energy)
        return self._replace(left=self.left - energy)


def admit(port: Port, far: float, reserve: float, force: Array, moved: Array) -> tuple[Port, Array]:
    """Return the arm's port, and the motion (6,) that it lets through of `moved` (6,) [m, rad].

    `force` (6,) [N, N·m] is what that motion works against, in the same axes: what is reflected.
    `far` [J] is what has entered at the handle. Where more would leave, a part of the motion along
    the force is taken away, never more than all of it.
    """
    works = [float(force[part] @ moved[part]) for part in PARTS]
    leaving = sum(works)
    left = far + reserve - port.left
    if leaving <= max(0.0, left):
        return port.passed(-leaving), moved
    pushing = sum(max(0.0, work) for work in works)
    share = min(1.0, (leaving - max(0.0, left)) / pushing)
    moved = moved.copy()
    for part, work in zip(PARTS, works, strict=True):
        if work > 0.0:
            moved[part] -= (share * work / float(force[part] @ force[part])) * force[part]
    return port.passed(share * pushing - leaving), moved


def damping(port: Port, far: float, reserve: float, speed2: float, step_s: float) -> float:
    """Return the damping [N·s/m] that pays within a step for what left the handle's port too much.

    `far` [J] is what has entered at the arm, `speed2` [m²/s²] the handle's speed, squared. What the
    hand never put in does not leave either, whatever the arm says.
    """
    owed = port.left - port.damped - min(far, port.entered) - reserve
    if owed <= 0.0 or speed2 <= 0.0:
        return 0.0
    return owed / (speed2 * step_s)
