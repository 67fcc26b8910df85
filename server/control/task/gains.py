"""Gains in effect: what was set, times what the cell's schedules say, and every change ramped.

A schedule is a table: a quantity (contact force, distance to the target, time since enable) to a
factor between 0 and 1, straight lines between its points. A factor never exceeds 1, so that a gain
that is stable when it is set stays so whatever its schedules do.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ....config.schema.sources.schedule import ScheduleSection
from ..spatial import Array

GAIN_TIME_S = 0.15
"""Time constant with which a changed gain takes effect [s]."""


class Quantities(NamedTuple):
    """Values that schedules may depend on; None where one is not known."""

    contact_force: float | None
    """Size of the contact force at the MRF [N]; None when the sensor is stale."""
    distance: float | None
    """From the MRF to the position source's target [m]; None without one."""
    time: float
    """Since the arm was enabled or resumed [s]."""


class Gains:
    """The gains of all sources under the schedules of a cell."""

    def __init__(self, schedules: tuple[ScheduleSection, ...], period_s: float) -> None:
        self._schedules = tuple(
            (s.source, s.by, np.array(s.at), np.array(s.factor), np.array(s.axes))
            for s in schedules
        )
        self.part = 1.0 - math.exp(-period_s / GAIN_TIME_S)
        """Share of the way to a new gain that is gone in one period [1]."""

    def scheduled(
        self, gains: dict[str, Array], quantities: Callable[[], Quantities]
    ) -> dict[str, Array]:
        """Return each source's gain (6,) times the factors of its schedules.

        A force that is not known counts as the worst of its table; without a target, the distance
        to it counts as beyond the table's end.
        """
        if not self._schedules:
            return gains
        now = quantities()
        found = dict(gains)
        for source, by, at, factor, axes in self._schedules:
            value: float | None = getattr(now, by)
            if value is not None:
                f = float(np.interp(value, at, factor))
            else:
                f = float(factor.min()) if by == "contact_force" else float(factor[-1])
            found[source] = found[source] * (1.0 - axes * (1.0 - f))
        return found

    def ramped(
        self, now: dict[str, Array], target: dict[str, Array], at_once: tuple[str, ...] = ()
    ) -> dict[str, Array]:
        """Return the gains one period later on their way to the target, so that nothing jumps.

        Those of the sources that are named are there `at_once`. The target itself once all are.
        """
        if now is target:
            return target
        ramped, there = {}, True
        for name, gain in now.items():
            aim = target[name]
            way = aim - gain
            near = gain is aim or name in at_once or np.abs(way).max() < 1e-7
            ramped[name] = aim if near else gain + self.part * way
            there = there and near
        return target if there else ramped
