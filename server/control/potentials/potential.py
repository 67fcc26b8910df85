"""The total potential of an arm and its slope: obstacles, joint limits, manipulability.

Scott & Carignan, eqs. 1 and 15–22: V = V_obst + V_jlim + V_manip, and τ = −∂V/∂q exactly.
"""

from typing import NamedTuple

import numpy as np

from ..frames import Array
from ..objectives import manipulability
from . import charged_link, solid, spread_link
from .charges import Charges
from .closest import closest_points
from .shape import Index, Shape


class Value(NamedTuple):
    """The potential at one posture, and its slope."""

    torque: Array
    """−∂V/∂q (n,) [N·m]."""
    parts: dict[str, float]
    """Each part's share of V [N·m = J]."""

    @property
    def total(self) -> float:
        """V [J]."""
        return sum(self.parts.values())


class Potential:
    """V and −∂V/∂q of one arm; strengths of zero are not computed."""

    def __init__(
        self,
        lower: Array,
        upper: Array,
        body: Index,
        k_limits: float,
        k_manipulability: float,
        least: float,
        smooth_lines: bool = True,
    ) -> None:
        """Build for joints between `lower` and `upper` (n,) [rad].

        `body` (m,) counts the joints inboard of each link; `least` [m] bounds distances from
        below; k_limits [N·m], k_manipulability [N·m for w in m³]. Lines are charged all along, or
        else a charge stands for each where it is closest to each link.
        """
        self._middle = 0.5 * (lower + upper)
        self._stiffness = k_limits / (upper - lower)
        self._k_manipulability = k_manipulability
        self._least = least
        self._smooth_lines = smooth_lines
        joints = np.arange(len(lower))[:, None]
        self._moves = (joints < body[None, :]).astype(float)

    def at(self, here: Shape, charges: Charges) -> Value:
        """Return V and −∂V/∂q of a shape among charges."""
        wrench, potential = self._push(here.p1, here.p2, charges)
        return self._value(here, wrench, potential)

    def both(self, here: Shape, there: Shape, charges: Charges) -> tuple[Value, Value]:
        """Return the same of two shapes of one chain, at little more than the cost of one."""
        m = here.p1.shape[1]
        p1 = np.concatenate([here.p1, there.p1], axis=1)
        p2 = np.concatenate([here.p2, there.p2], axis=1)
        wrench, potential = self._push(p1, p2, charges)
        if wrench is None:
            return self._value(here, None, potential), self._value(there, None, potential)
        return (
            self._value(here, wrench[:, :m], potential[:m]),
            self._value(there, wrench[:, m:], potential[m:]),
        )

    def _value(self, here: Shape, wrench: Array | None, potential: Array) -> Value:
        away = self._middle - here.q
        torque = self._stiffness * away
        parts = {"joint_limits": 0.5 * float(torque @ away)}
        if self._k_manipulability > 0.0:
            # The same about any point: what moves the point has determinant one.
            torque = torque + self._k_manipulability * manipulability.rate(here.screws)
            w = manipulability.manipulability(here.screws)
            parts["manipulability"] = -self._k_manipulability * w
        parts["obstacles"] = float(potential.sum())
        if wrench is not None:
            # Eqs. 15 and 16: a link's wrench acts on the joints inboard of it.
            torque = torque + ((here.screws.T @ wrench) * self._moves).sum(axis=1)
        return Value(torque, parts)

    def _push(self, p1: Array, p2: Array, c: Charges) -> tuple[Array | None, Array]:
        """Return the wrenches (6, m) of all obstacles on links, and their potentials (m,)."""
        loads = []
        least = self._least
        if len(c.k_points):
            loads.append(charged_link.load(p1, p2, c.points, c.k_points, least))
        if len(c.k_lines) and not self._smooth_lines:
            nearest = closest_points(p1, p2, c.line_start, c.line_end)
            loads.append(charged_link.load(p1, p2, nearest, c.k_lines, least))
        smooth = self._smooth_lines and len(c.k_lines)
        if smooth or len(c.k_round) or len(c.k_boxes):
            at = spread_link.points(p1, p2)
            if smooth:
                loads.append(spread_link.lines(at, c.line_start, c.line_end, c.k_lines, least))
            if len(c.k_round):
                away = solid.round_solids(at.x, c.round_start, c.round_end, c.radius)
                loads.append(spread_link.solids(at, *away, c.k_round, least))
            if len(c.k_boxes):
                away = solid.boxes(at.x, c.box_centre, c.box_axes, c.box_half)
                loads.append(spread_link.solids(at, *away, c.k_boxes, least))
        if not loads:
            return None, np.zeros(0)
        wrench, potential = loads[0]
        for load in loads[1:]:
            wrench, potential = wrench + load.wrench, potential + load.potential
        return wrench, potential
