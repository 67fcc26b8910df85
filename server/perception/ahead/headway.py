"""Headway of a base that is driven ahead: whether it comes on, and a name for what holds it.

The reflex tells why there is no way through. What it takes for one, and is none, is told here: no
base stands for ever without a reason.
"""

from typing import Final

STANDS: Final = 1e-3
"""A base that is slower stands [m/s]."""
HEADWAY_M: Final = 0.02
"""A base that has come so much farther ahead makes headway [m]."""
LEAST_SHARE: Final = 0.5
"""One that is driven slowly is asked for this share of its way in `HELD_S` [1]."""
HELD_S: Final = 4.0
"""Clearances hold a base when they slowed it for so long without headway [s]."""
WAITING_S: Final = 30.0
"""Deciding and folding take less [s]: what waits longer will wait for ever."""
HELD_BACK, NO_HEADWAY = "held_back", "no_headway"
REASONS: Final = (HELD_BACK, NO_HEADWAY)


class Headway:
    """Follows how far a base came while it was asked to go ahead."""

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self.forget()

    def forget(self) -> None:
        """Know nothing: the base is not driven ahead, or why it stands is told already."""
        self.reason = ""
        """Why the base makes no headway; empty while it does, or while that is not known yet."""
        self._mark_m: float | None = None
        self._since = self._newest = self._held = 0

    def lapse(self, tick: int) -> None:
        """Know nothing any more where nobody was driven in the tick before."""
        if tick > self._newest + 1:
            self.forget()

    def step(self, asked: float, way: float, tick: int, *, held: bool) -> None:
        """Take in one tick of a base that is asked for a speed ahead [m/s].

        `way` [m] is how far its wheels have rolled, from anywhere; `held` whether clearances are
        what slows it.
        """
        self.lapse(tick)
        if asked <= STANDS:
            self.forget()
        self._newest = tick
        if asked <= STANDS:
            return
        least = min(HEADWAY_M, LEAST_SHARE * asked * HELD_S)
        if self._mark_m is None or way - self._mark_m >= least:
            self.reason, self._mark_m, self._since, self._held = "", way, tick, 0
            return
        self._held += held
        if self.reason:
            return
        if self._held * self._period_s >= HELD_S:
            self.reason = HELD_BACK
        elif (tick - self._since) * self._period_s >= WAITING_S:
            self.reason = NO_HEADWAY
