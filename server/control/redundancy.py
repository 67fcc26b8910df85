"""What the spare degrees of freedom do: the objectives' rates, summed, projected and bounded.

Williams 1997, eq. 7: dq = J⁺ẋ + (I − J⁺J) z. Every objective has a gain, which is ramped like the
sources' gains; one whose gain is zero is not computed.
"""

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from .frames import Array
from .mechanism import Mechanism
from .objectives import least_energy, manipulability, posture
from .objectives.mid_range import MidRange
from .parameters import Parameters

NOTHING: Final[Mapping[str, Array]] = MappingProxyType({})
"""What objectives ask for that look at obstacles, where none does."""

TASK = 6
"""Freedoms of the task: with no more joints than these, nothing is spare."""


class Pulls(NamedTuple):
    """How strongly each objective acts."""

    gains: dict[str, float]
    posture: Array
    """Joint angles (n,) that the posture objective pulls to [rad]."""


class SelfMotion(NamedTuple):
    """What the null space is asked to do."""

    dq: Array
    """Joint rates (n,) in the null space [rad/s]."""
    norms: dict[str, float]
    """Size of each objective's own part of it [rad/s]; they may cancel."""


class Redundancy:
    """Composes the objectives of one mechanism."""

    def __init__(self, p: Parameters, mechanism: Mechanism) -> None:
        self._mechanism = mechanism
        self._mid_range = MidRange(p.lower, p.upper)
        self._spare = p.n > TASK
        self._velocity = p.velocity
        self._bound = p.redundancy.max_rate * p.velocity
        self.pulls = Pulls(p.redundancy.gains, p.pull_posture)
        """Those of the cell file."""

    def none(self) -> SelfMotion:
        """Return an idle null space."""
        return SelfMotion(np.zeros(len(self._bound)), {})

    def ramped(self, now: Pulls, target: Pulls, part: float) -> Pulls:
        """Return the pulls a `part` (0 to 1) of the way from those in effect to the set ones."""
        if now is target:
            return target
        gains = {}
        for name, goal in target.gains.items():
            way = goal - now.gains[name]
            gains[name] = goal if abs(way) < 1e-6 else now.gains[name] + part * way
        away = target.posture - now.posture
        if not now.gains["posture"] or float(np.abs(away).max()) < 1e-6:
            part = 1.0  # a pull that does not act yet may be aimed anew at once
        if gains == target.gains and part == 1.0:
            return target
        return Pulls(gains, now.posture + part * away)

    def rate(
        self,
        q: Array,
        J: Array,
        dq_task: Array,
        null: Array,
        pulls: Pulls,
        factor: float,
        outside: Mapping[str, Array] = NOTHING,
    ) -> SelfMotion:
        """Return the self-motion at q (n,), with J (6, n) and the task's rates (n,).

        `null` (n − 6, n) has orthonormal rows that span the spare motions; `factor` is the
        reduced-speed setting, which scales the bound of the self-motion; `outside` holds what the
        objectives that look at obstacles ask for (n,) at a gain of 1. Of all that, the task leaves
        s room: the most with |dq_task + s dq| ≤ V, so that no self-motion slows the tool.
        """
        if not self._spare:
            return self.none()
        parts = {
            name: gain * ((null @ self._part(name, q, J, dq_task, null, pulls, outside)) @ null)
            for name, gain in pulls.gains.items()
            if gain > 0.0
        }
        dq = np.zeros(len(q))
        for part in parts.values():
            dq = dq + part
        bound = np.maximum(factor * self._bound, 1e-12)
        share = 1.0 / max(1.0, float((np.abs(dq) / bound).max()))
        share *= self._room(dq_task, share * dq, factor)
        norms = {name: share * math.sqrt(float(z @ z)) for name, z in parts.items()}
        return SelfMotion(share * dq, norms)

    def _room(self, dq_task: Array, dq: Array, factor: float) -> float:
        """Return the share (0 to 1) of a self-motion (n,) that fits beside the task's rates."""
        V = factor * self._velocity
        task = dq_task / max(1.0, float((np.abs(dq_task) / V).max()))
        room = np.maximum(V - np.sign(dq) * task, 0.0)
        return min(1.0, float((room / np.maximum(np.abs(dq), 1e-12)).min()))

    def _part(
        self,
        name: str,
        q: Array,
        J: Array,
        dq_task: Array,
        null: Array,
        pulls: Pulls,
        outside: Mapping[str, Array],
    ) -> Array:
        """Return what an objective asks for (n,) at gain 1."""
        match name:
            case "field" | "spheres":
                return outside.get(name, np.zeros(len(q)))
            case "mid_range":
                return self._mid_range.rate(q)
            case "manipulability":
                return manipulability.slope(J)[1]
            case "posture":
                return posture.rate(q, pulls.posture)
            case _:
                return least_energy.rate(dq_task, null, self._mechanism.mass_matrix(q))
