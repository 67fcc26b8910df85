"""The total potential of an arm and its slope: obstacles, joint limits, manipulability.

Scott & Carignan, eqs. 1 and 15–22: V = V_obst + V_jlim + V_manip, and τ = −∂V/∂q exactly.
"""

from typing import NamedTuple

import numpy as np

from ....compiled import ROW, VECTOR, compiled
from ....scene import Scene
from ....spatial import Array
from .. import manipulability
from .forces import push
from .geometry import Index, Shape, screws


class Strengths(NamedTuple):
    """How strongly what acts; what is zero is not computed."""

    obstacles: float
    """Of points and solids [N·m]."""
    lines: float
    """Of sight lines, per metre [N]."""
    joint_limits: float
    """[N·m]."""
    manipulability: float
    """[N·m for w in m³]."""


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
    """V and −∂V/∂q of one arm."""

    def __init__(
        self,
        lower: Array,
        upper: Array,
        body: Index,
        strengths: Strengths,
        least: float,
        smooth_lines: bool = True,
        rank: int = 6,
    ) -> None:
        """Build for joints between `lower` and `upper` (n,) [rad].

        `body` (m,) counts the joints inboard of each link; `least` [m] bounds distances from
        below. Lines are charged all along, or else a charge stands for each where it is closest to
        each link. `rank` is how many axes the arm reaches anywhere.
        """
        self._middle = 0.5 * (lower + upper)
        self._stiffness = strengths.joint_limits / (upper - lower)
        self._body = body
        self._strengths = strengths
        self._least = least
        self._smooth_lines = smooth_lines
        self._rank = rank

    def at(self, here: Shape, scene: Scene | None) -> Value:
        """Return V and −∂V/∂q of a shape in a scene; None: nothing repels its links."""
        k = self._strengths
        torque = np.empty(len(here.q))
        parts = {"joint_limits": _hold(here.q, self._middle, self._stiffness, torque)}
        if k.manipulability > 0.0:
            # With all six axes it is the same about any point: what moves the point has
            # determinant one.
            J = here.screws if self._rank == 6 else screws(here.screws, -here.tool)
            w, slope = manipulability.slope(J, self._rank)
            torque = torque + k.manipulability * slope
            parts["manipulability"] = -k.manipulability * w
        parts["obstacles"] = 0.0
        if scene is not None:
            pushed, parts["obstacles"] = push(
                here.screws,
                here.ends,
                self._body,
                scene.solids,
                k.obstacles,
                k.lines,
                self._least,
                self._smooth_lines,
            )
            torque = torque + pushed
        return Value(torque, parts)


@compiled(VECTOR, VECTOR, VECTOR, ROW)
def _hold(q: Array, middle: Array, stiffness: Array, torque: Array) -> float:
    """Write the torques (n,) of springs that hold q (n,) to `middle`, return their potential."""
    potential = 0.0
    for j in range(len(q)):
        away = middle[j] - q[j]
        torque[j] = stiffness[j] * away
        potential += 0.5 * torque[j] * away
    return potential
