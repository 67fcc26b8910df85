"""What of the asked joint rates every barrier allows.

Scaled to the joint speed bounds first; then the nearest rates that keep every barrier: self-motion
is spent first, then speed along the path, and only then the path.
"""

from typing import NamedTuple

import numpy as np

from .avoidance.joint_room import JointRoom
from .avoidance.nearest import nearest
from .frames import Array
from .mechanism import Kinematics
from .parameters import Parameters


class Allowed(NamedTuple):
    """Joint rates that keep every barrier."""

    dq: Array
    scale: float
    """Share of the asked tool motion that is left, 0 to 1."""
    limits: tuple[str, ...]
    """Names of what took the rest."""


class Allow:
    """The barriers of one cell, composed."""

    def __init__(self, p: Parameters) -> None:
        self._p = p
        T = p.period_s
        self.room = JointRoom(p.lower, p.upper, p.acceleration, p.jerk, p.velocity, p.leash, T)

    def nearest(self, q: Array, k: Kinematics, dq: Array, error: Array, factor: float) -> Allowed:
        """Return the rates nearest to dq (n,) [rad/s] that all bounds allow at q (n,) [rad].

        `error` (n,) [rad] is the command's lead over the joints, which the leash bounds; `factor`
        the reduced-speed setting.
        """
        V = factor * self._p.velocity
        limits: tuple[str, ...] = ()
        share = 1.0 / max(1.0, float((np.abs(dq) / V).max()))
        if share < 1.0:
            limits += ("joint_speed",)
        dq = np.clip(share * dq, -V, V)  # rounding is no reason to name a limit
        room = self.room.limits(q)
        leash = self.room.leash(error)
        low = np.maximum(np.maximum(room.low, leash.low), -V)
        high = np.minimum(np.minimum(room.high, leash.high), V)
        low, high = np.minimum(low, high), np.maximum(low, high)
        if ((dq < low) | (dq > high)).any():
            limits += self._reasons(dq, room.low, room.high, "joint_limit")
            limits += self._reasons(dq, leash.low, leash.high, "leash")
            found = nearest(dq, k.J, low, high, V, self._p.resolve.characteristic_length)
            dq, share = found.dq, share * found.share
        return Allowed(dq, share, limits)

    def _reasons(self, dq: Array, low: Array, high: Array, name: str) -> tuple[str, ...]:
        beyond = (dq < low) | (dq > high)
        return tuple(f"{name}:{self._p.joints[i]}" for i in np.flatnonzero(beyond))
