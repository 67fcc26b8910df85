"""How quickly to slide downhill: along the slope, over its own curvature.

A step down the bare slope is slow where the field is flat and unstable where it is steep. Divided
by the curvature along the way, all of it is approached at one rate, whatever the strengths are.
"""

import math
from typing import NamedTuple

import numpy as np

from ....compiled import MATRIX, ROW, VECTOR, compiled
from ....scene import Scene
from ....spatial import Array
from .curvature import curvature, weighed
from .geometry import Index, Shape, ahead
from .potential import Potential, Value

LOOK = 1e-5
"""Step of the finite difference for the curvature [rad]."""


class FieldView(NamedTuple):
    """Where the arm is, among what, and its potential there."""

    here: Shape
    scene: Scene | None
    """None where nothing repels the links."""
    value: Value


class FieldFlow:
    """Rates downhill for one arm: in its self-motions, and along a virtual link."""

    def __init__(self, potential: Potential, body: Index, flattest: float) -> None:
        """`body` (m,) counts the joints inboard of each link; curvatures count as at least
        `flattest` [N·m/rad]."""
        self._potential = potential
        self._body = body
        self._flattest = flattest

    def look(self, here: Shape, scene: Scene | None) -> FieldView:
        """Return what there is to know of the field where the arm is."""
        return FieldView(here, scene, self._potential.at(here, scene))

    def self_motion(self, seen: FieldView, null: Array) -> tuple[Array, float]:
        """Return the joint rates (n,) [rad/s], at a gain of 1 /s, to the least potential.

        `null` (r, n) holds orthonormal rows that span the self-motions. The size of the slope
        along them, |Pτ| [N·m], is returned with the rates.
        """
        slope = np.zeros(null.shape[1])
        size = _project(null, seen.value.torque, slope)
        if size < 1e-12:
            return slope, size
        # Where there is but one way, both its senses bend alike.
        way = null[0] if len(null) == 1 else slope / size
        there = self._ahead(seen, way)
        bend = curvature(
            way,
            seen.here.screws,
            seen.value.torque,
            there.here.screws,
            there.value.torque,
            LOOK,
        )
        return slope / max(abs(bend), self._flattest), size

    def along(self, seen: FieldView, direction: Array, out: float, stiffness: float) -> float:
        """Return the speed [m/s], at a gain of 1 /s, of the tool along a virtual link.

        The link points along `direction` (3,), a unit vector in World, is `out` [m] now and held
        by a spring [N/m]. J_aug = [J e], and the potential is V + k d²/2.
        """
        way = _lever(seen.here, direction)
        step = LOOK / max(math.sqrt(float(way @ way)), 1e-6)
        there = self._ahead(seen, way * step / LOOK)
        force = float(way @ seen.value.torque)
        bend = (force - float(_lever(there.here, direction) @ there.value.torque)) / step
        return (force - stiffness * out) / max(abs(bend + stiffness), 0.5 * stiffness)

    def _ahead(self, seen: FieldView, way: Array) -> FieldView:
        """Look a small way ahead along joint rates (n,)."""
        return self.look(ahead(seen.here, self._body, way, LOOK), seen.scene)


def _lever(at: Shape, direction: Array) -> Array:
    """Return the joint rates (n,) that shift the tool along a direction (3,)."""
    twist = np.concatenate([direction, np.zeros(3)])  # a shift is the same at every point
    return np.asarray(at.screws.T @ weighed(at.screws, twist))


@compiled(MATRIX, VECTOR, ROW)
def _project(null: Array, torque: Array, slope: Array) -> float:
    """Write the part (n,) of torques along the rows of `null` (r, n), and return its size.

    `slope` is zeros before.
    """
    size2 = 0.0
    for row in range(len(null)):
        part = 0.0
        for j in range(len(torque)):
            part += null[row, j] * torque[j]
        for j in range(len(torque)):
            slope[j] += part * null[row, j]
    for j in range(len(torque)):
        size2 += slope[j] * slope[j]
    return math.sqrt(size2)
