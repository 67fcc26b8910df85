"""An arm whose joints follow a curve through tunnels: a twist inserts it, or moves its tail.

Inside, the summed twist acts along the head's tangent, as an insertion speed. Beyond the exit an
arm of enough free joints answers the whole twist by itself, while the joints inside stand; a
drive's command inserts or withdraws it as a curve again, and its tail returns to the curve first.
"""

import math
from functools import partial
from typing import NamedTuple

import numpy as np

from ..mechanism.backbone.fit import farthest_apart
from ..mechanism.backbone.insertion import Backbone, DriveRequest, Insertion
from ..mechanism.joint_rates import Around, JointRates, Resolver, Wish
from ..mechanism.kinematics import Kinematics
from ..mechanism.null_space.redundancy import Redundancy
from ..spatial import Array
from ..stop.limiter import Judge
from ..stop.way_to_rest import Stop

STANDS = 1e-6
"""An insertion that is slower stands [m/s]."""
ARRIVED_SPEED = 2e-3
"""At its depth, an arm that is still this fast is not there yet [m/s]."""
SLOWED = 0.99
"""An insertion that gets less than this part of its asked speed is told as slowed [1]."""
LOOK_S = 0.025
"""Stops are looked at so often along the way [s]."""
WORSE = 1e-4
"""A stop may be off the tunnel's centre line by so much more than the arm is now [m]."""


class Slid(NamedTuple):
    """Joint rates of an arm on its curve."""

    found: JointRates
    insertion: Insertion | None
    together: bool
    """The joints follow the curve, and none makes up for another."""
    limits: tuple[str, ...]


class Slither:
    """Turns a twist of the tool into the joint rates of one arm with a backbone."""

    def __init__(
        self,
        backbone: Backbone,
        resolver: Resolver,
        redundancy: Redundancy,
        rank: int,
        names: tuple[str, ...],
    ) -> None:
        self.backbone, self._names = backbone, names
        self._resolver, self._redundancy, self._rank = resolver, redundancy, rank

    def rates(
        self,
        q: Array,
        k: Kinematics,
        wish: Wish,
        around: Around,
        before: Insertion | None,
        drive: DriveRequest,
        moving: bool,
        following: tuple[Array, Array] | None,
    ) -> Slid:
        """Return joint rates at the commanded posture q (n,), whose kinematics are `k`.

        `before` is where the arm was a tick ago; `drive` is the operator's,
        of an arm that is `moving`, and does not only give way. `following` are the joints (n,)
        as commanded and as measured at one instant [rad]. One with a joint that is locked may
        withdraw, and nothing else.
        """
        insertion = self.backbone.followed(before, q, following)
        if insertion is None:
            return Slid(self._none(np.zeros(len(q))), None, True, ("off_backbone",))
        if moving:
            insertion = self.backbone.ramped(insertion, drive, wish.speed_factor)
        else:
            insertion = insertion._replace(speed=0.0)
        free, locked = len(q) - insertion.beyond, insertion.locked
        back_only = drive.back_only or locked is not None
        driven = abs(insertion.speed) > STANDS or drive.speed != 0.0
        if self.backbone.arrived(insertion, drive):
            driven = abs(insertion.speed) > ARRIVED_SPEED
        if free > self._rank and not driven and not back_only:
            return self._tail(q, k, wish, around, insertion)
        head = self.backbone.head(q)
        twist = float(head @ wish.twist[:3]) if free <= self._rank else 0.0
        share = 1.0
        if around.wrench is not None:
            push = k.T_world_mrf.R @ around.wrench[:3]
            share = self.backbone.gives_way(insertion.speed, push, head)
        forward, granted = twist + insertion.speed, twist + share * insertion.speed
        if back_only:
            granted = min(0.0, granted)
        dq, speed = self.backbone.rates(insertion, q, granted)
        if not wish.spare and abs(speed) < STANDS:
            dq = np.zeros(len(q))
        slowed = abs(speed) < SLOWED * abs(forward) and abs(forward) > STANDS
        limits: tuple[str, ...] = ("insertion_speed",) if slowed else ()
        if locked is not None:
            limits += tuple(f"locked:{self._names[i]}" for i in np.flatnonzero(~np.isnan(locked)))
        return Slid(self._none(dq), insertion, True, limits)

    def off_walls(self, insertion: Insertion | None, q: Array, error: Array, dq: Array) -> float:
        """Return what share (0 to 1) of joint rates dq (n,) keeps the measured links off walls.

        At joints q (n,) that are `error` (n,) ahead of the measured ones [rad].
        """
        return 1.0 if insertion is None else self.backbone.kept_off(insertion, q, error, dq)

    def at_rest(self, q: Array) -> Slid:
        """Return what an arm does whose drives are off, at joints q (n,)."""
        return Slid(self._none(np.zeros(len(q))), None, True, ())

    def _tail(
        self, q: Array, k: Kinematics, wish: Wish, around: Around, insertion: Insertion
    ) -> Slid:
        """Return the rates of what is beyond the exit; the joints inside stand."""
        J = k.J.copy()
        J[:, : insertion.beyond] = 0.0
        found = self._resolver.rates(q, k._replace(J=J), wish, around)
        dq = found.dq.copy()
        dq[: insertion.beyond] = 0.0
        return Slid(found._replace(dq=dq), insertion._replace(speed=0.0), False, ())

    def _none(self, dq: Array) -> JointRates:
        return JointRates(dq, self._redundancy.none(), math.nan, False, None, None)

    def judge(self, insertion: Insertion | None, q: Array, error: Array) -> Judge | None:
        """Return what judges stops of an arm that is on its curve, `error` (n,) ahead [rad]."""
        if insertion is None:
            return None
        return partial(self.shortfall, insertion, q, error)

    # --- the promise along a stop --------------------------------------------------------------

    def shortfall(self, insertion: Insertion, q: Array, error: Array, stop: Stop) -> float:
        """Return by how much a stop brings links too near to the walls [m]; 0 for not.

        From joints q (n,) that are `error` (n,) ahead of the measured ones [rad].
        """
        times = _looks(stop.to_go_s)
        postures = np.empty((2 + len(times), len(q)))
        postures[0], postures[1], postures[2:] = q, q - error, stop.postures(times)
        backbone, s1 = self.backbone, insertion.s1
        points = backbone.chain.points(postures)
        lag = farthest_apart(points[0], points[1], len(q) + 1)
        bound = max(backbone.room - lag, backbone.off_centre(points[:1], s1) + WORSE)
        return max(0.0, backbone.off_centre(points[2:], s1) - bound)


def _looks(to_go_s: float) -> Array:
    """Return the instants (s,) at which a stop is looked at, now and at its end among them [s]."""
    count = max(1, math.ceil(to_go_s / LOOK_S))
    times = np.arange(count + 1, dtype=np.float64) * (to_go_s / count)
    times[-1] = to_go_s
    return times
