"""Checks of commands that are given joint by joint."""

from typing import Self

import numpy as np

from ...config.drives.joint_bounds import JointBounds, joint_bounds
from ...config.load import Cell
from ..control.spatial import Array
from ..refusals import Refused, Why


class JointCommands:
    """The joints of one cell, and the angles and rates that may be asked of them."""

    def __init__(self, names: tuple[str, ...], bounds: JointBounds, velocity: Array) -> None:
        self._names, self._velocity = names, velocity
        self._lower, self._upper = np.array(bounds.lower), np.array(bounds.upper)

    @classmethod
    def from_cell(cls, cell: Cell) -> Self:
        """Return those of a cell's mechanism."""
        joints, drives = cell.robot.joints, cell.config.mechanism.drives
        velocity = np.array([drive.max_velocity for drive in drives])
        return cls(tuple(j.name for j in joints), joint_bounds(joints, drives), velocity)

    def check_rates(self, rates: tuple[float, ...]) -> None:
        """Raise `Refused` for rates (n,) [rad/s] that no drive may be told."""
        asked = self._vector(rates, "rates")
        beyond = np.abs(asked) > self._velocity * (1 + 1e-9)
        if beyond.any():
            j = int(np.argmax(beyond))
            raise Refused(
                Why.OUT_OF_RANGE,
                f"rates: {self._names[j]} {asked[j]:g} rad/s, at most {self._velocity[j]:g}",
            )

    def angles(self, q: tuple[float, ...]) -> Array:
        """Return a posture (n,) [rad]. Raises `Refused` for one outside the joints' bounds."""
        asked = self._vector(q, "q")
        beyond = (asked < self._lower) | (asked > self._upper)
        if beyond.any():
            j = int(np.argmax(beyond))
            raise Refused(
                Why.OUT_OF_RANGE,
                f"q: {self._names[j]} {asked[j]:g} rad, between "
                f"{self._lower[j]:.4f} and {self._upper[j]:.4f}",
            )
        return asked

    def _vector(self, values: tuple[float, ...], field: str) -> Array:
        if len(values) != len(self._names):
            raise Refused(
                Why.WRONG_JOINTS, f"{field}: {len(values)} values for {len(self._names)} joints"
            )
        return np.array(values)
