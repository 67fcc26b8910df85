"""How quickly to slide downhill: along the slope, over its own curvature.

A step down the bare slope is slow where the field is flat and unstable where it is steep. Divided
by the curvature along the way, all of it is approached at one rate, whatever the strengths are.
"""

import math
from typing import NamedTuple

import numpy as np

from ..frames import Array
from .charges import Charges
from .curvature import curvature, weighed
from .potential import Potential, Value
from .shape import Index, Shape, ahead

LOOK = 1e-5
"""Step of the finite difference for the curvature [rad]."""


class Seen(NamedTuple):
    """Where the arm is, and among what."""

    here: Shape
    charges: Charges


class Around(NamedTuple):
    """The potential where the arm is, and a small way ahead."""

    here: Shape
    value: Value
    there: Shape
    ahead: Value


class Flow:
    """Rates downhill for one arm: in its self-motions, and along a virtual link."""

    def __init__(self, potential: Potential, body: Index, flattest: float) -> None:
        """`body` (m,) counts the joints inboard of each link; curvatures count as at least
        `flattest` [N·m/rad]."""
        self._potential = potential
        self._body = body
        self._flattest = flattest

    def self_motion(self, seen: Seen, null: Array) -> tuple[Array, Value]:
        """Return the joint rates (n,) [rad/s], at a gain of 1 /s, to the least potential.

        `null` (r, n) holds orthonormal rows that span the self-motions. The potential here is
        returned with them.
        """
        around = None
        if len(null) == 1:  # there is but one way, and both its senses bend alike
            around = self._look(seen, null[0])
            value = around.value
        else:
            value = self._potential.at(seen.here, seen.charges)
        slope = (null @ value.torque) @ null
        size = math.sqrt(float(slope @ slope))
        if size < 1e-12:
            return slope, value
        way = slope / size
        if around is None:
            around = self._look(seen, way, value)
        else:
            way = null[0]
        bend = curvature(
            way,
            seen.here.screws,
            value.torque,
            around.there.screws,
            around.ahead.torque,
            LOOK,
        )
        return slope / max(abs(bend), self._flattest), value

    def along(self, seen: Seen, direction: Array, out: float, stiffness: float) -> float:
        """Return the speed [m/s], at a gain of 1 /s, of the tool along a virtual link.

        The link points along `direction` (3,), a unit vector in World, is `out` [m] now and held
        by a spring [N/m]. J_aug = [J e], and the potential is V + k d²/2.
        """
        way = _lever(seen.here, direction)
        step = LOOK / max(math.sqrt(float(way @ way)), 1e-6)
        around = self._look(seen, way * step / LOOK)
        force = float(way @ around.value.torque)
        bend = (force - float(_lever(around.there, direction) @ around.ahead.torque)) / step
        return (force - stiffness * out) / max(abs(bend + stiffness), 0.5 * stiffness)

    def _look(self, seen: Seen, way: Array, value: Value | None = None) -> Around:
        """Look at the potential here, unless its value is known, and ahead along a way (n,)."""
        there = ahead(seen.here, self._body, way, LOOK)
        if value is None:
            value, beyond = self._potential.both(seen.here, there, seen.charges)
        else:
            beyond = self._potential.at(there, seen.charges)
        return Around(seen.here, value, there, beyond)


def _lever(at: Shape, direction: Array) -> Array:
    """Return the joint rates (n,) that shift the tool along a direction (3,)."""
    twist = np.concatenate([direction, np.zeros(3)])  # a shift is the same at every point
    return np.asarray(at.screws.T @ weighed(at.screws, twist))
