"""Contact of a tool by the force that is measured: where its load is not explained, or joints lead.

A load that is not explained is told from contact by how the force changes. A weight stays as it is
in World axes, a bias in the sensor's. So no attitude changes the size of either; and while the tool
turns by little, neither changes much at all. The size alone is blind to contact that takes a weight
off and adds as much of its own: pushed up by twice what hangs on it, or by friction beside, the
tool reads as before.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from ...control.spatial import GRAVITY, Array, sizes
from ...control.state import Output
from ...mode import Mode
from ..filters.collision import UNKNOWN_LOAD

LASTS = 3
"""Contact of the tool must last for so many ticks [1]."""
MARGIN_N = 2.0 * UNKNOWN_LOAD.force
"""A bias turns round as the tool does [N]."""
SETTLED_S = 0.3
"""So long what is measured may change after the load was said to be unexplained [s]."""
MEAN_OF = 4
"""The tool's acceleration is measured as a mean of so many ticks [1]."""
SEEN_WITHIN = 8
"""A command is measured within so many ticks [1]."""
STAYS_S, WITHIN_S = 0.3, 1.0
"""Contact below the threshold may last, or come and go, for so long within this time [s]."""
RELIEVED_S = 0.15
"""So long force control may take to relieve contact before the stop takes over [s]."""
TURNED = 0.2
"""A tool that has turned by more is compared with what is measured there [rad]."""


class _Load(NamedTuple):
    """Force (3,) of the load in World axes [N], and how the tool stood (3, 3)."""

    force: Array
    R: Array


class ToolContact:
    """Detects contact by a change of the force, or of its size, which no attitude changes."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self.touched = self.found = False
        """`touched` is a reason to stop; `found` says that in this tick something touches."""
        self.known_n = self.off_n = self.bound_n = 0.0
        self._lasting = 0
        self._excused_n = self._told_s = 0.0
        self._load: _Load | None = None
        self._moving = False
        self._measured: deque[Array] = deque(maxlen=MEAN_OF + 2)
        self._told: deque[Array] = deque(maxlen=SEEN_WITHIN + 2)

    @property
    def free(self) -> bool:
        """True while nothing touches the tool for all that the sensor says."""
        return self.off_n <= UNKNOWN_LOAD.force + self._excused_n

    def rest(self) -> None:
        """Forget: the load is explained."""
        self.touched = self.found = False
        self._excused_n, self._lasting, self._told_s, self._load = 0.0, 0, 0.0, None
        self._measured.clear()
        self._told.clear()

    def update(
        self, known_n: float, wrench: Array, weight_n: float, output: Output, moving: bool
    ) -> None:
        """Compare a wrench (6,), World axes, with a load [N], of which `weight_n` is told."""
        if known_n != self.known_n:
            self.known_n, self._load = known_n, None
        began, self._moving = moving and not self._moving, moving
        self._place(output)
        self.off_n = self._off(wrench, output.T_world_mrf_measured.R)
        if began:
            self._excused_n = self.off_n
        # An arm whose load was told wrong may still sink as that is noticed.
        settled, self._told_s = self._told_s > SETTLED_S, self._told_s + self._period_s
        keep = min if settled else max
        self._excused_n = keep(self._excused_n, self.off_n)
        self.bound_n = MARGIN_N + UNKNOWN_LOAD.angle * (known_n + weight_n) + self._excused_n
        # What is moved needs a force as well.
        self.bound_n += 1.5 * known_n / -float(GRAVITY[2]) * self._acceleration()
        beyond = self.off_n > self.bound_n
        self._lasting = self._lasting + 1 if beyond else 0
        self.found = self._lasting >= LASTS
        self.touched = moving and (self.found or (self.touched and beyond))

    def _off(self, wrench: Array, R: Array) -> float:
        """Return by how much a wrench (6,), measured with the tool at R (3, 3), is off [N]."""
        size = abs(sizes(wrench)[0] - self.known_n)
        force, load = wrench[:3], self._load
        if load is None:
            self._load = _Load(force, R)
            return size
        turned = math.acos(min(1.0, max(-1.0, 0.5 * (float(np.sum(R * load.R)) - 1.0))))
        change = force - load.force
        # As much of it as the load may be a bias, which turns with the tool.
        change_n = math.sqrt(float(change @ change)) - 2.0 * math.sin(0.5 * turned) * self.known_n
        if turned > TURNED and max(size, change_n) <= UNKNOWN_LOAD.force:
            self._load = _Load(force, R)
        return max(size, change_n)

    def _place(self, output: Output) -> None:
        """Take in where the tool is, and was told to be."""
        self._measured.append(output.T_world_mrf_measured.p)
        self._told.append(output.T_world_mrf.p)

    def _acceleration(self) -> float:
        """Return what the tool accelerates by, or was told to lately [m/s²].

        As a mean of some ticks: where it chatters on something, each is the contact's own.
        """
        if len(self._measured) < MEAN_OF + 2:
            return 0.0
        steps = np.diff(np.array(self._measured), axis=0)
        mean = sizes(np.append(steps[-1] - steps[0], (0.0, 0.0, 0.0)))[0] / (len(steps) - 1)
        told = np.diff(np.array(self._told), n=2, axis=0)
        return max(mean, float(np.sqrt((told**2).sum(axis=1).max()))) / self._period_s**2


class PressedTool(ToolContact):
    """Detects contact beyond the cell's threshold while joints are commanded themselves.

    A jog or a posture leads the joints wherever the tool presses. What it pressed with when that
    began may be a load that nobody told of, or contact that the joints lead out of: it counts by
    how much more there is than the least since then. So does contact that is lighter and stays, or
    comes and goes, where the joints lead into it more slowly than force control relieves it.
    """

    def __init__(self, threshold_n: float, period_s: float) -> None:
        super().__init__(period_s)
        self._threshold_n = threshold_n
        self._met_s: float | None = None
        self._stays: deque[bool] = deque(maxlen=round(WITHIN_S / period_s))
        """Of the last ticks: whether there was contact."""
        self._most_of = round(STAYS_S / period_s)
        self.watching = False
        """Joints are commanded themselves, or the arm has stopped since."""

    @property
    def free(self) -> bool:
        """True while the tool presses with no more than it did at the least."""
        return self.off_n <= UNKNOWN_LOAD.force

    def rest(self) -> None:
        """Forget: the sources lead the arm."""
        super().rest()
        self.watching, self._met_s = False, None
        self._stays.clear()

    def follow(self, output: Output | None, by_joint: bool, mode: Mode) -> None:
        """Take in the tick before; `by_joint` says that the joints are commanded themselves."""
        moving = mode is Mode.ENABLED
        lost = output is None or output.wrench_mrf is None
        if lost or not mode.energised or (moving and not by_joint):
            if self.watching:
                self.rest()
            return
        if output is None or output.wrench_mrf is None or not (by_joint or self.watching):
            return
        force_n = sizes(output.wrench_mrf)[0]
        if not self.watching:
            self.watching, self.known_n = True, force_n
        self.known_n = min(self.known_n, force_n)
        self._place(output)
        self.off_n = force_n - self.known_n
        most = (1.0 + UNKNOWN_LOAD.angle) * self.known_n + MARGIN_N
        # What is moved needs a force as well.
        most += 1.5 * self.known_n / -float(GRAVITY[2]) * self._acceleration()
        self.bound_n = max(self._threshold_n, most) - self.known_n
        beyond = self.off_n > self.bound_n
        self._lasting = self._lasting + 1 if beyond else 0
        self._stays.append(force_n > most)
        if self._met_s is not None:
            self._met_s += self._period_s
        elif self._lasting >= LASTS or sum(self._stays) > self._most_of:
            self._met_s = 0.0
        # Force control relieves the contact meanwhile, as quickly as a stop would be, and further.
        relieving = beyond and bool(output.twists["force"].any())
        self.found = self._met_s is not None and not (relieving and self._met_s < RELIEVED_S)
        self.touched = moving and self.found
