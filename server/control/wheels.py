"""A base with two driven wheels: how it rolls, where it is, and its place in the programme."""

import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from ...config.load import Cell
from ...config.schema.mechanism import WheelsSection
from .compiled import MATRIX, NUMBER, ROW, TABLE, VECTOR, compiled
from .scene import Body, Index
from .spatial import Array, Pose, pose_error, rotation_exp, sizes

# --- Wheels that are driven, in a programme of barriers: one unknown, how far along their arc -----
#
# So a base is slowed on its arc, never turned off it, and never rolls because a joint of its
# arm is at a bound.


class DrivenWheels(NamedTuple):
    """The m unknowns of n joints: each joint is one, and each pair of driven wheels is one."""

    whole: Array
    """Rates of the joints per unknown (n, m)."""
    kept: Index
    """Joints that the unknowns are named after (m,): of a pair the left wheel."""
    asked: Array
    """Rates that are asked for (m,)."""
    low: Array
    high: Array

    @classmethod
    def of(cls, dq: Array, low: Array, high: Array, wheels: Sequence[int]) -> Self:
        """Return those of rates dq (n,) within bounds (n,); `wheels` are the left ones' places.

        Between standing and what is asked, a pair keeps its proportion.
        """
        n = len(dq)
        kept = np.array([j for j in range(n) if j - 1 not in wheels], dtype=np.int64)
        whole = np.zeros((n, len(kept)))
        whole[kept, np.arange(len(kept))] = 1.0
        asked, least, most = dq[kept], low[kept], high[kept]
        for i in wheels:
            at, pair = int(np.flatnonzero(kept == i)[0]), dq[i : i + 2]
            size = float(np.abs(pair).max())
            along = pair / size if size > 0.0 else np.zeros(2)
            whole[i : i + 2, at] = along
            asked[at], least[at], most[at] = size, 0.0, size
            for turn, down, up in zip(along, low[i : i + 2], high[i : i + 2], strict=True):
                if turn != 0.0:
                    most[at] = min(most[at], max(0.0, (up if turn > 0.0 else down) / turn))
        return cls(whole, kept, asked, least, most)


# --- A base with two driven wheels rolls: where it gets to, and what one wheel's motion does ------
#
# Zhang et al. 2013, eqs. 1 to 6, with wheel angles in place of v and ω. A wheel that turns
# alone turns the base about the point where the other one stands: so its column in a Jacobian
# is that of a revolute joint there, whose axis is as long as the base turns per radian of the
# wheel. Where wheels on several axles skid, that point is farther out by the cell's slip factor,
# and ahead or behind where the load is uneven (the instantaneous centres of rotation of either
# side: Martínez et al. 2005, Mandow et al. 2007); all else is the same.


class Rolled(Pose):
    """Pose of Base in World, and the angles `wheels` (2,) [rad] at which it is there.

    As a tuple it is the pose alone; as a record, as one that is kept, it has three fields.
    """

    _fields = ("R", "p", "wheels")  # type: ignore[assignment]  # a record of one field more
    wheels: Array

    def __new__(cls, R: Array, p: Array, wheels: Array) -> Self:
        """Make one."""
        made = super().__new__(cls, R, p)
        made.wheels = wheels
        return made

    @classmethod
    def at(cls, T: Pose, wheels: Array) -> Self:
        """Return a pose with the wheels' angles."""
        return cls(T.R, T.p, wheels)


class DifferentialDrive(NamedTuple):
    """The two driven wheels of a base, left and right."""

    radius: float
    """[m]"""
    track: float
    """Between the points about which the base turns when one of them turns alone [m]: their points
    of contact; where wheels skid, farther out."""
    centre: float = 0.0
    """Those points are so far ahead of Base [m]."""

    @classmethod
    def of(cls, wheels: WheelsSection) -> Self:
        """Return those of a cell's section."""
        return cls(wheels.radius, wheels.turning_track, wheels.centre)

    @classmethod
    def from_cell(cls, cell: Cell) -> "DifferentialDrive | None":
        """Return those of a cell's mechanism; None for one that stands."""
        base = cell.config.mechanism.base
        return None if base is None else cls.of(base.wheels)

    @property
    def turn(self) -> float:
        """Angle of Base per angle of one wheel [1]."""
        return self.radius / self.track

    def wheels(self, v: float, w: float) -> Array:
        """Return the wheels' rates (2,) [rad/s] at which the base drives [m/s] and turns [rad/s].

        Zhang 2013, eq. 3 solved for the wheels.
        """
        across = 0.5 * self.track * w
        return np.array([v - across, v + across]) / self.radius

    def driven(self, rates: Array) -> tuple[float, float]:
        """Return at which v [m/s] and ω [rad/s] the base goes with the wheels' rates (2,)."""
        left, right = rates.tolist()
        return 0.5 * self.radius * (left + right), self.turn * (right - left)

    def roll(self, at: Rolled, wheels: Array) -> Rolled:
        """Return where the base is when its wheels have turned to angles (2,) [rad].

        Both turn in proportion: it rolls along an arc, exactly.
        """
        R, p = np.empty((3, 3)), np.empty(3)
        way = wheels - at.wheels
        _roll(at.R, at.p, way, 0.5 * self.radius, self.turn, self.centre, R, p)
        return Rolled.at(Pose(R, p), wheels)

    def places(self, at: Rolled, wheels: Array) -> tuple[Array, Array]:
        """Return attitudes (s, 3, 3) and places (s, 3) of Base as its wheels turn to angles (s, 2).

        From one to the next both turn in proportion.
        """
        R, p = np.empty((len(wheels), 3, 3)), np.empty((len(wheels), 3))
        for s in range(len(wheels)):
            at = self.roll(at, wheels[s])
            R[s], p[s] = at
        return R, p


@compiled(MATRIX, VECTOR, VECTOR, NUMBER, NUMBER, NUMBER, TABLE, ROW)
def _roll(
    R: Array,
    p: Array,
    way: Array,
    half: float,
    turn: float,
    centre: float,
    R_new: Array,
    p_new: Array,
) -> None:
    """Write where a base at R, p gets to as its wheels turn by `way` (2,) [rad].

    What rolls along an arc is the point `centre` [m] ahead of it.
    """
    s, b = half * (way[0] + way[1]), turn * (way[1] - way[0])
    h = 0.5 * b
    chord = s * (math.sin(h) / h if abs(h) > 1e-6 else 1.0 - h * h / 6.0)
    c, d = math.cos(b), math.sin(b)
    x = chord * math.cos(h) + centre * (1.0 - c)
    y = chord * math.sin(h) - centre * d
    for i in range(3):
        p_new[i] = p[i] + x * R[i, 0] + y * R[i, 1]
        R_new[i, 0] = c * R[i, 0] + d * R[i, 1]
        R_new[i, 1] = c * R[i, 1] - d * R[i, 0]
        R_new[i, 2] = R[i, 2]


# --- Where a base on wheels is: odometry of the commanded and of the measured wheels. Pure --------
#
# The pose of the base is no function of the wheels' angles, so it is carried on from tick to
# tick. The commanded base is what all is computed with; the measured one lags it as the joints
# do. News of where Base is corrects both alike, by a little each tick.


class Odometry(NamedTuple):
    """Where the base is, by its wheels."""

    commanded: Rolled
    measured: Rolled
    drift: Array
    """Correction still to be made (6,): a turn about the measured base, World axes [m, rad]."""

    @staticmethod
    def at(T_world_base: Pose, wheels: Array) -> "Odometry":
        """Return that of a base whose wheels stand at angles (2,) [rad]."""
        rolled = Rolled.at(T_world_base, wheels)
        return Odometry(rolled, rolled, np.zeros(6))

    def rolled(
        self, rolling: DifferentialDrive, commanded: Array | None, measured: Array
    ) -> "Odometry":
        """Return it with the wheels at these angles (2,) [rad], commanded and measured.

        None of a base that is not commanded: it is where it is measured.
        """
        found = rolling.roll(self.measured, measured)
        if commanded is None:
            return self._replace(commanded=found, measured=found)
        return self._replace(commanded=rolling.roll(self.commanded, commanded), measured=found)

    def forget(self, commanded: Array, measured: Array) -> "Odometry":
        """Return it with wheels whose counts began anew: the base has not moved by that."""
        return self._replace(
            commanded=Rolled.at(self.measured, commanded),
            measured=Rolled.at(self.measured, measured),
        )

    def seen(self, T_then: Pose, T_world_base: Pose) -> "Odometry":
        """Return it with news of where Base was, when the odometry had it at `T_then`."""
        return self._replace(drift=pose_error(T_world_base, T_then))

    def slid(self, T_then: Pose, x: float, y: float, yaw: float) -> "Odometry":
        """Return it with news that Base slid: by x, y [m] and `yaw` [rad], seen from `T_then`.

        It had missed that motion; what was still to be corrected before stays so.
        """
        way = np.concatenate((T_then.R @ (x, y, 0.0), T_then.R @ (0.0, 0.0, yaw)))
        return self._replace(drift=self.drift + way)

    def corrected(self, most: tuple[float, float], period_s: float) -> tuple["Odometry", Array]:
        """Return it a period further on its way to what news said, and the twist (6,) of that.

        The twist is that of the commanded base, at its origin in World axes; it is at most `most`
        [m/s], [rad/s].
        """
        if not np.count_nonzero(self.drift):
            return self, np.zeros(6)
        off, turned = sizes(self.drift)
        shares = [
            min(1.0, bound * period_s / max(size, 1e-12))
            for size, bound in zip((off, turned), most, strict=True)
        ]
        step = self.drift * np.repeat(shares, 3)
        turn, about = rotation_exp(step[3:]), self.measured.p

        def moved(at: Rolled) -> Rolled:
            p = about + step[:3] + turn @ (at.p - about)
            return Rolled.at(Pose(turn @ at.R, p), at.wheels)

        commanded = moved(self.commanded)
        twist = np.concatenate((commanded.p - self.commanded.p, step[3:])) / period_s
        found = Odometry(commanded, moved(self.measured), self.drift - step)
        return found, twist

    def body(self, twist: Array) -> Body:
        """Return the commanded base as what moves of itself only as far as it is corrected."""
        return Body(self.commanded, twist)
