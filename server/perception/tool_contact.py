"""Contact of a tool whose load is not explained, by the size of the wrench that is measured."""

from collections import deque

import numpy as np

from ..control.spatial import GRAVITY, Array
from ..control.state import Output
from .filters.collision import UNKNOWN_LOAD

LASTS = 3
"""Contact of the tool must last for so many ticks [1]."""
MARGIN_N = 2.0 * UNKNOWN_LOAD.force
"""A bias turns round as the tool does [N]."""


class ToolContact:
    """Detects contact by a change of the wrench's size, which no attitude changes."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self.touched = self.told = False
        self.off_n = self.bound_n = 0.0
        self._lasting = 0
        self._excused_n = 0.0
        self._moving = False
        self._places: deque[Array] = deque(maxlen=4)

    def rest(self) -> None:
        """Forget: the load is explained."""
        self.touched, self._excused_n, self._lasting = False, 0.0, 0
        self._places.clear()

    def update(
        self, known_n: float, size_n: float, weight_n: float, output: Output, moving: bool
    ) -> None:
        """Compare the size of a force with that of the load [N], of which `weight_n` is told."""
        began, self._moving = moving and not self._moving, moving
        self.told = False
        self._places.append(output.T_world_mrf_measured.p)
        self.off_n = abs(size_n - known_n)
        if began:
            self._excused_n = self.off_n
        self._excused_n = min(self._excused_n, self.off_n)
        self.bound_n = MARGIN_N + UNKNOWN_LOAD.angle * (known_n + weight_n) + self._excused_n
        # What is moved needs a force as well.
        self.bound_n += 1.5 * known_n / -float(GRAVITY[2]) * self._acceleration()
        beyond = self.off_n > self.bound_n
        self._lasting = self._lasting + 1 if beyond else 0
        found = self._lasting >= LASTS and moving
        self.told = found and not self.touched
        self.touched = found or (self.touched and beyond and moving)

    def _acceleration(self) -> float:
        if len(self._places) < 3:
            return 0.0
        places = np.array(self._places)
        second = np.diff(places, n=2, axis=0)
        return float(np.sqrt((second**2).sum(axis=1).max())) / self._period_s**2
