"""Self-motion by hand: an operator moves the spare joints, and the tool stays or goes its way.

Williams 1997, eq. 7: dq = J⁺ẋ + N z, with N z the operator's. Of an arm with an arm angle φ (Scott
& Carignan 2008, section V) N z is the least motion along which φ changes at the rate that is asked
for: with g = ∂φ/∂q, N g / (gᵀ N g) for 1 rad/s. Of another redundant arm it is the spare motion
nearest to the last one: its sign is kept, and it turns as little as it must. The objectives and the
task have their room in the joints' speeds first.

Rates are those of the posture before, and joints get to them within the period: on average they
come `LATE` periods T late. So the tool would slide at LATE T (∂J/∂q · dq) dq, which is taken off
what it is asked for.
"""

import math
from typing import Final, NamedTuple, Self

import numpy as np

from ..axes import HeldAxes
from ..inputs import SelfMotionRequest
from ..joints import Joints
from ..linalg import svd
from ..spatial import Array, Kinematics, Motion
from ..stop.trajectory import VelocityPlanner
from .model import Mechanism

LATE: Final = 2.0 / 3.0
"""Rates come so late [periods]: without that a turn of 1.3 rad slides a PA-10's tool by 2.5 mm."""
RISE_S: Final = 0.4
"""From rest to the greatest rate [s]."""
APPROACH: Final = 2.0
"""Approach to an angle close to it [1/s]."""
REACHED: Final = 1e-3
"""An angle is reached within this [rad]."""
_LEAST: Final = 1e-4
"""Where gᵀ N g is below this, no spare motion turns the elbow [1]."""
_BEGINS: Final = 0.1
"""Part of a joint's own motion that is spare, from which it says how a direction begins [1]."""
_LOST: Final = 0.3
"""A direction of which less than this is spare any more begins anew [1]."""
_SLOWED: Final = 0.99
"""A rate of which less than this is left is told as slowed [1]."""

SINGULAR: Final = "arm_angle_singular"
"""Limit: no spare motion turns the elbow, or a goal has no angle to be compared with."""
BOUNDED: Final = "self_motion_speed"
"""Limit: the joints are not quick enough for the rate."""
NONE_SPARE: Final = "no_spare_joint"
"""Limit: nothing answers the rate that is asked for."""

_REST: Final = Motion.at_rest(np.zeros(1))
_NOWHERE: Final = np.zeros(0)


class HandState(NamedTuple):
    """How far an operator's self-motion has come."""

    motion: Motion = _REST
    """The rate, shaped, as a motion of one freedom."""
    direction: Array = _NOWHERE
    """Unit vector (n,) of joint rates along which it goes, or went last; (0,) before any."""
    going: Array = _NOWHERE
    """Joint rates (n,) of the command along it [rad/s]; (0,) while nothing is asked for."""
    left: float = math.nan
    """Of the way to an angle [rad]; NaN where it leads to none."""

    @property
    def moves(self) -> bool:
        """True while there is a rate, or a way to it."""
        return self.motion is not _REST and not self.motion.stands()

    def along(self, dq: Array) -> Self:
        """Return the state with what of the joint rates dq (n,) goes along its direction."""
        if not self.moves:
            return self if len(self.going) == 0 else self._replace(going=_NOWHERE)
        return self._replace(going=float(self.direction @ dq) * self.direction)


IDLE: Final = HandState()


class HandRates(NamedTuple):
    """What is made of an operator's request."""

    dq: Array
    """Joint rates (n,) beside those of task and objectives [rad/s]."""
    state: HandState
    limits: tuple[str, ...]
    """What takes something off it, by the limit's name."""


class SelfMotionByHand:
    """Turns what an operator asks of one mechanism's spare joints into joint rates."""

    def __init__(
        self,
        joints: Joints,
        mechanism: Mechanism,
        most: Array,
        speed: float,
        length: float,
        period_s: float,
        own: Array | None = None,
    ) -> None:
        """Build it; self-motion takes at most rates `most` (n,) [rad/s].

        `speed` bounds the rate of the angle [rad/s], `length` [m/rad] weighs rotations. Joints
        where `own` (n,) is 0 take no part; None: all do.
        """
        self._reader, self._own = mechanism.arm_angle, own
        self._rank = mechanism.rank if own is None else mechanism.arm_rank or mechanism.rank
        self._velocity, self._most, self._length = joints.velocity, most, length
        self._period_s = period_s
        self.most = 1.0 if self._reader is None else speed
        """Greatest rate: of φ [rad/s]; of an arm without it 1, its quickest joint at its bound."""
        rise = np.array([self.most / RISE_S])
        self._planner = VelocityPlanner(2.0 * rise, 4.0 * rise / RISE_S)

    def spare(self, ranks: tuple[int, int] | None) -> int:
        """Return how many freedoms are spare; of a task that leaves axes free with its `ranks`."""
        if self._own is None:
            return len(self._most) - (self._rank if ranks is None else ranks[1])
        return int(self._own.sum()) - (self._rank if ranks is None else ranks[0])

    def step(
        self,
        k: Kinematics,
        null: Array,
        asked: SelfMotionRequest,
        before: HandState,
        dq: Array,
        factor: float,
        share: float,
        held: HeldAxes | None = None,
    ) -> HandRates:
        """Return the joint rates of one tick.

        `null` (r, n) spans the spare motions, `dq` (n,) are the rates of task and objectives.
        `factor` is the reduced-speed setting, `share` (0 to 1) what avoiding leaves of it; a task
        holds the axes `held`, None: all.
        """
        rows = self._rows(k.J, null, held)
        limits: tuple[str, ...] = ()
        target, left = asked.rate, math.nan
        if self._reader is None:
            way = self._nearest(k.J, rows, before.direction)
        else:
            angle, slope = self._reader.look(k)
            spare = (rows @ slope) @ rows
            size2 = float(slope @ spare)
            way = spare / max(size2, _LEAST) if size2 > 0.0 else np.zeros(len(dq))
            if asked.angle is not None:
                left = _turned(asked.angle - angle)
                target = min(asked.rate, max(-asked.rate, APPROACH * left))
            if math.isnan(target) or size2 < _LEAST:
                target, limits = 0.0, (SINGULAR,)
        if len(rows) == 0:
            target, limits = 0.0, (NONE_SPARE,)
        aim = np.array([factor * share * target])
        motion = self._planner.shape(before.motion, aim, self._period_s)
        rate = float(motion.dq[0])
        more = rate * way
        fits = self._fitting(more, dq, factor)
        if fits < _SLOWED and not limits:
            limits = (BOUNDED,)
        size = math.sqrt(float(way @ way))
        direction = way / size if size > 0.0 else before.direction
        if len(direction) == 0:
            return HandRates(np.zeros(len(dq)), IDLE, limits)
        return HandRates(fits * more, HandState(motion, direction, before.going, left), limits)

    def _rows(self, J: Array, null: Array, held: HeldAxes | None) -> Array:
        """Return rows (r, n) that span the spare motions of the joints that take part."""
        if self._own is None:
            return null
        n, rank = len(self._own), self._rank if held is None else held.ranks[0]
        task = self._own * J if held is None else held.rows(self._own * J)
        return np.asarray(self._own * svd(task, self._length)[2][rank:, :n])

    def _nearest(self, J: Array, rows: Array, last: Array) -> Array:
        """Return the motion (n,) nearest to the `last` direction, its quickest joint at its bound.

        At first that in which the middle joint of the arm turns on, or whichever takes most part.
        """
        way = (rows @ last) @ rows if len(last) else np.zeros(0)
        size = math.sqrt(float(way @ way))
        if size < _LOST:
            moves = np.abs(J).max(axis=0) > 0.0
            if self._own is not None:
                moves &= self._own > 0.0
            part = np.where(moves, (rows**2).sum(axis=0), 0.0)
            joints = np.flatnonzero(moves)
            first = int(joints[len(joints) // 2]) if len(joints) else 0
            if part[first] < _BEGINS:
                first = int(np.argmax(part))
            way = np.where(moves, rows[:, first] @ rows, 0.0)
        fastest = float((np.abs(way) / np.maximum(self._most, 1e-12)).max(initial=0.0))
        return way / fastest if fastest > 0.0 else np.zeros(J.shape[1])

    def _fitting(self, more: Array, dq: Array, factor: float) -> float:
        """Return the share (0 to 1) of rates `more` (n,) that joints have room for beside dq."""
        size = np.maximum(np.abs(more), 1e-12)
        room = factor * self._velocity - np.sign(more) * dq
        bound = np.minimum(factor * self._most, np.maximum(room, 0.0))
        return min(1.0, float((bound / size).min()))


def _turned(angle: float) -> float:
    """Return the same angle from −π to π [rad]."""
    return math.remainder(angle, 2.0 * math.pi)
