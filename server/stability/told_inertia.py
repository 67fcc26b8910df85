"""Bound of the inertia that a payload may add to the torque law's model, were it not there.

The law moves joints as its model says. Where a payload is told that does not hang there, the arm
has a part of that inertia only, and answers every torque more than the law expects: below some part
the loop swings by itself (`torque_loop.py`). A light payload far out does as much as a heavy one.
"""

from functools import cached_property

import numpy as np

from ...config.agree.agree import REQUIRED_POSTURES
from ...config.load import Cell
from ..control.mechanism.dynamics import Dynamics
from ..control.mechanism.kinematics import Mechanism
from ..control.mechanism.payload import Payload
from ..control.parameters import Parameters
from .torque_loop import lightest_ratio


class ToldInertia:
    """Inertia of one cell's arm with a payload and without, judged for drives in CST."""

    def __init__(self, cell: Cell) -> None:
        self._cell = cell

    @cached_property
    def least(self) -> float:
        """Least part of the modelled inertia with which the law stands [1]."""
        return lightest_ratio(self._cell.config.torque, self._cell.config.timing.period_s)

    @cached_property
    def _dynamics(self) -> Dynamics:
        p = Parameters.from_cell(self._cell)
        return Dynamics(Mechanism.from_cell(self._cell), p.rotor_inertia, p.T_wrist_sensor)

    def part(self, payload: Payload) -> float:
        """Return the part of the modelled inertia that is there without a payload [1].

        Of the joint motion that the payload weighs upon most, at the postures that every cell has.
        """
        postures, dynamics, least = self._cell.config.mechanism.postures, self._dynamics, 1.0
        for name in REQUIRED_POSTURES:
            q = np.array(postures[name])
            dynamics.carry(payload.mass, payload.com)
            told = dynamics.terms(q, np.zeros(len(q))).M
            dynamics.carry(0.0, np.zeros(3))
            bare = dynamics.terms(q, np.zeros(len(q))).M
            least = min(least, float(np.linalg.eigvals(np.linalg.solve(told, bare)).real.min()))
        return least

    def refusal(self, payload: Payload) -> str | None:
        """Return why the law would swing if a payload were told and not there, or None."""
        if self._cell.config.mechanism.operation_mode != "cst":
            return None
        part = self.part(payload)
        if part >= self.least:
            return None
        lever = float(np.linalg.norm(payload.com))
        return (
            f"{payload.mass:g} kg with its centre {lever:.3g} m from the sensor: without it the "
            f"arm has {part:.2g} of the inertia that the torque law would move, and swings below "
            f"{self.least:.2g}; the sensor does not read that it is there"
        )
