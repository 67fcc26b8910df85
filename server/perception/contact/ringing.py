"""Contact that rings: force control on something stiffer than the cell declares.

The loop's gain is K_F k_e T, and of these the arm does not know k_e. Beyond the bound the force
swings at the loop's own frequency: half a swing lasts 2d + 1 periods at the bound
(`server/stability/force_loop.py`), and less beyond it; the tool leaves the wall, and comes back as
hard as before. So the turning points of the force tell: swings in a row, each no longer than that,
none much smaller than the one before; or the first touch, where the loop's gain is far beyond its
bound and the tool is thrown off. How much the force changed for the tool's way is the stiffness.

Then the whole sum of the task's sources is scaled, force control with all that it balances: the
loop's gain falls, and what a stick presses with, K_HC u / K_F, stays as it is. A goal is dropped:
its force would grow with the way that is left. The share stays until an operator sets the gains of
force control, or the arm is enabled anew; away from the contact, once nothing was touched for a
while, the arm is as quick as ever.
"""

import math
from collections import deque

import numpy as np

from ...commands.commands import Commands
from ...control.mechanism.wrist import LOAD_TIME_S
from ...control.spatial import Array
from ...control.state import Output
from ...mode import Mode
from ...runtime.events import Events
from ...stability.force_loop import ForceLoop

SLOWEST = 1.5
"""A swing lasts at most so many times half a period of the loop at its bound [1]."""
KEPT = 0.7
"""A swing of a loop that rings has at least that part of the one before [1]."""
LEAST = 0.7
"""Swings of less than that part of what is hard do not count: a peg rattles in its hole [1]."""
DEEP = 0.6
"""A loop that rings swings by that part of its peaks, for it grows until contact is lost [1]."""
TURNED = 0.3
"""A swing is over when the force has come back by that part of the one before [1]."""
CONTACT_N = 2.0
"""The stiffness is estimated from greater forces [N]."""
FREE_N = 5.0
"""Less along what rang is none: a tool that accelerates feels some, too [N]."""
SWINGS = 3
"""So many swings in a row are ringing [1]."""
RINGS = 0.75
"""If the loop's gain has that part of its bound; below, something shakes the tool [1]."""
SURELY = 2.0
"""Beyond that part, one touch that throws the tool off is [1]."""
LULLS = 2.5
"""The tool comes back within so many of a swing's longest time [1]."""
SAFE = 0.4
"""The loop's gain is lowered to that part of its bound [1]."""
AT_MOST = 0.5
"""And to this part of what it was, if that is less [1]."""
SMALLEST = 0.002
"""The smallest share [1]."""
FREE_S = 0.5
"""So long after the last contact the tool counts as free [s]."""
RAMPED_S = 5.0 * LOAD_TIME_S
"""A load or bias that is told anew is in effect after that time [s]."""
RISE = 0.05
"""The share rises again by at most so much in a tick [1]."""
SEEN = 60
"""The stiffness is estimated over so many ticks at most [1]."""


class ContactStability:
    """Notices that one arm's force control rings, and scales the task's motion down."""

    def __init__(
        self,
        loop: ForceLoop | None,
        commands: Commands,
        hard_n: float,
        period_s: float,
        events: Events,
    ) -> None:
        """Build it; without a `loop` it is idle. Beyond `hard_n` a touch is a hard one [N]."""
        self._commands, self._period_s, self._events = commands, period_s, events
        self._hard_n, self._least_n = hard_n, LEAST * hard_n
        self._gain = commands.settings.gains["force"]
        axes = [] if loop is None else [a for a in loop.axes(self._gain) if a is not None]
        self._idle = not axes
        self._bound = min((axis.bound for axis in axes), default=0.0)
        delay = max((axis.delay_periods for axis in axes), default=0.0)
        self._longest = math.ceil(SLOWEST * (2.0 * delay + 1.0))
        self.share = 1.0
        """Part of the task's motion towards what rang [1]."""
        self._told, self._wait_s = commands.settings.load_told, 0.0
        self._acting = 1.0
        self._normal = np.zeros(3)
        """Into what rang, in World (3,)."""
        self._free_s = math.inf
        self._forces: deque[Array] = deque(maxlen=SEEN)
        self._places: deque[Array] = deque(maxlen=SEEN)
        self._forget()

    def _forget(self) -> None:
        self._rising, self._began, self._extreme = True, 0.0, 0.0
        self._since = 0
        """Ticks since the swing began."""
        self._swings: list[float] = []
        """Sizes of quick swings in a row, the newest last [N]."""
        self._forces.clear()
        self._places.clear()

    def update(self, output: Output | None, mode: Mode) -> float:
        """Take in the tick before; return the share of the task's sum that is to act now [1]."""
        settings = self._commands.settings
        if self._idle or output is None:
            return 1.0
        if mode is Mode.READY or settings.gains["force"] is not self._gain:
            self._gain, self.share = settings.gains["force"], 1.0
        if settings.load_told != self._told or settings.sensor_share < 1.0:
            # A reading that is taken otherwise is no contact; a touch under way is forgotten.
            self._told = settings.load_told
            self._wait_s = RAMPED_S
        self._wait_s -= self._period_s
        if not (mode.energised and settings.on["force"]) or self._wait_s > 0.0:
            self._forget()
            self._acting = self.share if settings.on["force"] else 1.0
            return self._acting
        if output.wrench_mrf is not None:
            force = output.T_world_mrf_measured.R @ output.wrench_mrf[:3]
            size = math.sqrt(float(force @ force))
            touching = float(force @ self._normal) > FREE_N
            self._free_s = 0.0 if touching else self._free_s + self._period_s
            self._forces.append(force)
            self._places.append(output.T_world_mrf_measured.p)
            if self._swings_on(size):
                self._judge(output)
        self._acting = min(self._aim(output), self._acting + RISE)
        return self._acting

    def _swings_on(self, size: float) -> bool:
        """Follow the force's size [N]; return whether two swings in a row or more are quick."""
        self._since += 1
        last = self._swings[-1] if self._swings else 0.0
        if (size >= self._extreme) is self._rising:
            self._extreme = size
        elif abs(size - self._extreme) > max(0.5 * self._least_n, TURNED * last):
            swing = abs(self._extreme - self._began)
            peak = max(self._extreme, self._began)
            lasts = swing >= max(self._least_n, KEPT * last, DEEP * peak) and self._quick()
            if self._since > LULLS * self._longest:
                self._swings = []
            self._swings = [*self._swings[-3:], swing] if lasts else []
            self._began, self._extreme, self._rising = self._extreme, size, not self._rising
            self._since = 0
        ongoing, peak = abs(self._extreme - self._began), max(self._extreme, self._began)
        return bool(self._swings) and ongoing >= max(KEPT * self._swings[-1], DEEP * peak)

    def _quick(self) -> bool:
        """Return whether the force went from the swing's beginning to its extreme in time."""
        low, high = sorted((self._began, self._extreme))
        edge = 0.1 * (high - low)
        newest = np.array([*self._forces][-(self._since + 1) :])
        sizes = np.sqrt((newest**2).sum(axis=1))
        return int(((sizes > low + edge) & (sizes < high - edge)).sum()) <= self._longest

    def _judge(self, output: Output) -> None:
        """Estimate the stiffness of what is touched, and lower the loop's gain if that rings.

        Where it is far beyond the bound, a hard touch and the swing off are enough, else it takes
        a third.
        """
        stiffness, normal = self._estimated()
        gain = np.asarray(output.gains["force"])[:3]
        along = output.T_world_mrf_measured.R.T @ normal
        loop = float(gain @ along**2) * self.share * stiffness * self._period_s
        thrown = not self._rising and self._swings[-1] > self._hard_n
        if len(self._swings) < SWINGS - 1 and not (thrown and loop > SURELY * self._bound):
            return
        if loop < RINGS * self._bound:
            return
        self.share = max(SMALLEST, self.share * min(AT_MOST, SAFE * self._bound / loop))
        swing_n, self._normal, self._free_s = self._swings[-1], normal, 0.0
        self._forget()
        goals = self._commands.goals
        if goals.goal is not None:
            goals.drop()
            self._commands.dropped.append(("goal", "contact_unstable"))
        self._events.warning(
            "contact_unstable",
            f"force control rings on {stiffness / 1e3:.3g} kN/m: all that leads the tool acts at "
            f"{100.0 * self.share:.2g} % until its gains are set, or the arm is enabled anew",
            stiffness=stiffness,
            share=self.share,
            swing_n=swing_n,
        )

    def _estimated(self) -> tuple[float, Array]:
        """Return stiffness [N/m] and normal (3,) of the contact over the last ticks."""
        forces, places = np.array(self._forces), np.array(self._places)
        pressed = forces.sum(axis=0)
        normal = pressed / max(math.sqrt(float(pressed @ pressed)), 1e-9)
        f, x = forces @ normal, places @ normal
        touching = (f[1:] > CONTACT_N) & (f[:-1] > CONTACT_N)
        way = float(np.abs(np.diff(x))[touching].sum())
        return float(np.abs(np.diff(f))[touching].sum()) / max(way, 1e-9), normal

    def _aim(self, output: Output) -> float:
        """Return the share to act now: all of it away from the contact, once nothing is touched."""
        if self.share == 1.0 or self._free_s < FREE_S:
            return self.share
        others = (t[:3] for name, t in output.twists.items() if name != "force")
        towards = float(sum(others, np.zeros(3)) @ self._normal)
        return 1.0 if towards < 0.0 else self.share
