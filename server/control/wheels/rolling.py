"""A base with two driven wheels rolls: where it gets to, and what one wheel's motion does.

Zhang et al. 2013, eqs. 1 to 6, with wheel angles in place of v and ω. A wheel that turns alone
turns the base about the point where the other one stands: so its column in a Jacobian is that of a
revolute joint there, whose axis is as long as the base turns per radian of the wheel.
"""

import math
from typing import NamedTuple, Self

import numpy as np

from ....config.load import Cell
from ..compiled import MATRIX, NUMBER, ROW, TABLE, VECTOR, compiled
from ..spatial import Array, Pose


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


class Rolling(NamedTuple):
    """The two driven wheels of a base, left and right."""

    radius: float
    """[m]"""
    track: float
    """Between their points of contact [m]."""

    @classmethod
    def from_cell(cls, cell: Cell) -> "Rolling | None":
        """Return those of a cell's mechanism; None for one that stands."""
        base = cell.config.mechanism.base
        return None if base is None else cls(base.wheels.radius, base.wheels.track)

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
        _roll(at.R, at.p, way, 0.5 * self.radius, self.turn, R, p)
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

    def columns(self, T_world_base: Pose, p: Array) -> Array:
        """Return the Jacobian (6, 2) of the wheels at a point p (3,) of World, World axes.

        Zhang 2013, eq. 6: its first two columns, for the rates of left and right wheel.
        """
        R, origin = T_world_base
        found = np.empty((6, 2))
        arm = np.cross(R[:, 2], p - origin)
        for k, turn in enumerate((-self.turn, self.turn)):
            found[:3, k] = 0.5 * self.radius * R[:, 0] + turn * arm
            found[3:, k] = turn * R[:, 2]
        return found


@compiled(MATRIX, VECTOR, VECTOR, NUMBER, NUMBER, TABLE, ROW)
def _roll(
    R: Array, p: Array, way: Array, half: float, turn: float, R_new: Array, p_new: Array
) -> None:
    """Write where a base at R, p gets to as its wheels turn by `way` (2,) [rad]."""
    s, b = half * (way[0] + way[1]), turn * (way[1] - way[0])
    h = 0.5 * b
    chord = s * (math.sin(h) / h if abs(h) > 1e-6 else 1.0 - h * h / 6.0)
    x, y = chord * math.cos(h), chord * math.sin(h)
    c, d = math.cos(b), math.sin(b)
    for i in range(3):
        p_new[i] = p[i] + x * R[i, 0] + y * R[i, 1]
        R_new[i, 0] = c * R[i, 0] + d * R[i, 1]
        R_new[i, 1] = c * R[i, 1] - d * R[i, 0]
        R_new[i, 2] = R[i, 2]
