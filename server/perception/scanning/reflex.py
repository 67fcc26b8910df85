"""Reflex of an arm that drives under something: when to wait, where to fold, when to unfold.

A state machine over contours. It moves nothing: it says which posture the arm should take, and how
quickly the base may drive forward meanwhile. The tick decides whether that is done.

    clear ──► undecided ──► folding ──► folded ──► returning ──► clear
                  │  ▲          │          │           │
                  ▼  └──────────┴── not free any more ─┘
               refused
"""

import math
from concurrent.futures import Executor, Future
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from ...control.spatial import Array
from .interference import NOTHING, Obstacles, clearance, clearances
from .search import FoldingPosture, Search

UNDECIDED_FRONT: Final = 0.80
"""While nothing is decided the arm may yet stretch so far ahead [m]."""
STAND_OFF: Final = 0.15
"""The base stops so far before what it must not meet [m]."""
DECELERATION: Final = 0.2
"""The base slows down like that before it [m/s²]."""
DELAY_S: Final = 0.5
"""Of contour, news, tick and drives together [s]."""
ARRIVED: Final = 0.03
"""Joints that are nearer are there [rad]."""
FREE_S: Final = 1.0
"""The way back has to be free for so long [s]."""
AGAIN_S: Final = 2.0
"""A refused passage is looked at again after [s]."""
STUCK_S: Final = 12.0
"""An arm that has not got there by then is held up [s]."""
SAME: Final = 0.05
"""Postures are the same if no joint differs by more [rad]: steps of the grid are coarser."""


class PassagePhase(StrEnum):
    """Phase of a passage."""

    CLEAR = "clear"
    UNDECIDED = "undecided"
    FOLDING = "folding"
    FOLDED = "folded"
    RETURNING = "returning"
    REFUSED = "refused"


class Reaction(NamedTuple):
    """The answer to one contour."""

    phase: PassagePhase
    posture: Array | None
    """Joints (n,) that the arm should take [rad]; None: as they are."""
    most_speed: float
    """The base may drive forward so quickly [m/s]; inf: as it likes."""
    reason: str
    """Why there is no way; empty while there may be one."""


class PassageReflex:
    """Remembers one passage. Give it every contour; it answers at once, or after a search."""

    def __init__(
        self,
        search: Search,
        decide_s: float,
        *,
        in_sequence: bool = False,
        wait: bool = True,
        trigger: float = 2.0,
    ) -> None:
        """Build it; nothing is decided before an obstacle was looked at for `decide_s` [s].

        Nothing is done about what is farther ahead than `trigger` [m]. `in_sequence` takes the
        paper's order in place of the search of a whole posture; without `wait` the base is never
        slowed down.
        """
        self._search, self._decide_s = search, decide_s
        self._in_sequence, self._wait, self._trigger = in_sequence, wait, trigger
        self.elsewhere: Executor | None = None
        """Who searches, so that contours go on meanwhile; None: the search is waited for."""
        self._searching: Future[FoldingPosture] | None = None
        self.forget()

    def forget(self) -> None:
        """Remember no passage."""
        self.phase = PassagePhase.CLEAR
        self.goal: Array | None = None
        self._home: Array | None = None
        self._tried: list[Array] = []
        self._since_s = self._entered_s = self._free_since_s = math.inf
        self._reason = ""

    def step(
        self, time_s: float, q: Array, obstacles: Obstacles, passed: Obstacles = NOTHING
    ) -> Reaction:
        """Return the answer to the obstacles of a contour, with the arm at q (n,) [rad].

        `passed` are those behind the arm, into which it must not swing.
        """
        now = self._search.links(q[None])[0]
        front = float(now[:, 0].max())
        # What is alongside of the arm is the hard clearances': the base would stop below a bridge.
        ahead = obstacles.within(front, self._trigger)
        reach = self._search.reach
        near = clearances(now, ahead) < reach.trigger
        met = ahead.near[near | (self._search.standing(ahead) < reach.column)]
        self._decide(time_s, q, obstacles, passed, ahead, bool(met.size))
        return Reaction(self.phase, self.goal, self._speed(q, front, met), self._reason)

    # --- deciding ----------------------------------------------------------------------------

    def _decide(
        self,
        time_s: float,
        q: Array,
        obstacles: Obstacles,
        passed: Obstacles,
        ahead: Obstacles,
        met: bool,
    ) -> None:
        match self.phase:
            case PassagePhase.CLEAR:
                if met:
                    self._since_s = time_s
                    self._go_to(PassagePhase.UNDECIDED, time_s)
            case PassagePhase.UNDECIDED:
                self._look_for_way(time_s, q, ahead, met)
            case PassagePhase.REFUSED:
                if not met or time_s - self._entered_s >= AGAIN_S:
                    self._look_for_way(time_s, q, ahead, met)
                else:
                    self._free_since_s = time_s
            case PassagePhase.FOLDING | PassagePhase.RETURNING:
                self._under_way(time_s, q, ahead, passed)
            case PassagePhase.FOLDED:
                self._through(time_s, q, obstacles, passed, ahead, met)

    def _look_for_way(self, time_s: float, q: Array, ahead: Obstacles, met: bool) -> None:
        if met:
            self._free_since_s = time_s
        elif time_s - max(self._free_since_s, self._entered_s) >= FREE_S:
            self._reason = ""
            self._go_to(PassagePhase.CLEAR if self._home is None else PassagePhase.FOLDED, time_s)
            self.goal = self.goal if self._home is None else q
            return
        if not met or time_s - self._since_s < self._decide_s:
            return
        found = self._found(q, ahead)
        if found is None:
            return
        if self._in_sequence:
            found = self._further(found)
        self._reason, self.goal = found.reason, found.q
        if found.q is None:
            self._go_to(PassagePhase.REFUSED, time_s)
            return
        self._home = q if self._home is None else self._home
        self._go_to(PassagePhase.FOLDING, time_s)

    def _found(self, q: Array, ahead: Obstacles) -> FoldingPosture | None:
        """Return what a search found; None while it goes on elsewhere."""
        if self.elsewhere is None:
            return self._find(q, ahead)
        if self._searching is None:
            self._searching = self.elsewhere.submit(self._find, q, ahead)
        if not self._searching.done():
            return None
        found, self._searching = self._searching.result(), None
        return found

    def _find(self, q: Array, ahead: Obstacles) -> FoldingPosture:
        return (
            self._search.sequence(q, ahead) if self._in_sequence else self._search.posture(q, ahead)
        )

    def _further(self, found: FoldingPosture) -> FoldingPosture:
        """Return the next posture of the paper's order, unless it was gone to already.

        What F1 frees, F2 or F3 may bring back: then the order goes round in circles, for ever.
        """
        if found.q is None:
            return found
        if any(np.abs(found.q - tried).max() < SAME for tried in self._tried):
            return FoldingPosture(None, "sequence_stuck")
        self._tried.append(found.q)
        return found

    def _under_way(self, time_s: float, q: Array, ahead: Obstacles, passed: Obstacles) -> None:
        """Go on to the goal while it is free, and the rest of the way."""
        goal, give_up = self.goal, self._search.reach.give_up
        if goal is None:
            self._go_to(PassagePhase.UNDECIDED, time_s)
        elif np.abs(q - goal).max() < ARRIVED:
            back = self.phase is PassagePhase.RETURNING
            if back:
                self._home = self.goal = None
            self._go_to(PassagePhase.CLEAR if back else PassagePhase.FOLDED, time_s)
        elif not (
            self._search.way_is_free(q, goal, ahead, give_up)
            and self._search.clears(q, goal, passed, give_up)
        ):
            self.goal = None
            self._go_to(PassagePhase.UNDECIDED, time_s)
        elif time_s - self._entered_s > STUCK_S:
            self.goal, self._reason = None, "held_up"
            self._go_to(PassagePhase.REFUSED, time_s)

    def _through(
        self,
        time_s: float,
        q: Array,
        obstacles: Obstacles,
        passed: Obstacles,
        ahead: Obstacles,
        met: bool,
    ) -> None:
        """Stay folded until the way back is free; look again if the posture does not pass."""
        goal, home = self.goal, self._home
        if goal is None or home is None:
            self._go_to(PassagePhase.UNDECIDED, time_s)
            return
        points = self._search.links(goal[None])[0]
        gives_up = clearance(points, ahead) < self._search.reach.give_up
        # What is met but not yet given up would be waited for, for ever.
        waits = met and (self._in_sequence or time_s - self._entered_s >= AGAIN_S)
        if gives_up or waits:
            self._go_to(PassagePhase.UNDECIDED, time_s)
            return
        # Over the whole depth, or it would fold, unfold and be refused.
        reach = self._search.reach.choose
        if not (
            self._search.way_is_free(q, home, obstacles, reach, behind=False)
            and self._search.clears(q, home, passed, reach)
        ):
            self._free_since_s = math.inf
        elif self._free_since_s == math.inf:
            self._free_since_s = time_s
        elif time_s - self._free_since_s >= FREE_S:
            self.goal = home
            self._go_to(PassagePhase.RETURNING, time_s)

    def _go_to(self, phase: PassagePhase, time_s: float) -> None:
        self.phase, self._entered_s, self._free_since_s = phase, time_s, math.inf
        if phase in (PassagePhase.UNDECIDED, PassagePhase.REFUSED):
            self._free_since_s = time_s
        if phase is PassagePhase.CLEAR:
            self._since_s, self._reason, self._tried = math.inf, "", []

    # --- waiting -----------------------------------------------------------------------------

    def _speed(self, q: Array, front: float, met: Array) -> float:
        """Return the greatest speed of the base [m/s] from which it still stops in time."""
        if not self._wait or not met.size:
            return math.inf
        if self.phase in (PassagePhase.UNDECIDED, PassagePhase.REFUSED):
            front = max(front, UNDECIDED_FRONT)
        if self.goal is not None:
            front = max(front, self._search.front(q, self.goal))
        return speed_within(max(0.0, float(met.min()) - front - STAND_OFF))


def speed_within(room: float) -> float:
    """Return the greatest speed of a base [m/s] that still stops within a way [m]."""
    b = DECELERATION * DELAY_S
    return math.sqrt(b * b + 2.0 * DECELERATION * room) - b
