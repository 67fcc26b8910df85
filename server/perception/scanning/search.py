"""Search of a posture in which the arm passes: far too slow for a tick, so it runs beside it.

`Way` is what the reflex asks for; both rules answer with joint angles, or with the reason why there
are none.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from ...control.scene import Flags
from ...control.spatial import Array
from .contour import CellPlane
from .interference import NODES_PER_CELL, Obstacles, clearances, distance_field, free_links
from .postures import FROM_COLUMN, LOWEST, CriticalPoints

ON_THE_WAY: Final = 12
"""Postures on a way that are looked at [1]."""
TRIED: Final = 60
"""Postures whose way is looked at, the nearest ones first [1]."""
BEHIND: Final = 0.10
"""An arm that stays so far behind an obstacle does not meet it [m]."""
PIECE: Final = 0.015
"""Links are looked at point by point, so far apart [m]."""
STILL: Final = 0.06
"""An elbow or a tool that moves less stands still, as the grid goes [m]."""


FROM_SHOULDER: Final = 0.06
"""Distance from the shoulder [m] within which links stand still, and keep the column's distance."""
BESIDE_BASE: Final = 0.03
"""The base, whose width is told as it is, keeps so far from what is beside it [m]."""


class Reach(NamedTuple):
    """How near obstacles may come to projected links [m]."""

    choose: float
    """A posture is chosen if they are farther."""
    trigger: float
    """Something has to be done if they are nearer."""
    give_up: float
    """A posture once chosen is given up."""
    column: float
    """The fixed column does not fit if something is nearer."""


class FoldingPosture(NamedTuple):
    """A posture to go to, or why there is none."""

    q: Array | None
    reason: str = ""


class Search:
    """Looks for postures of one arm ahead of one plane."""

    def __init__(
        self,
        points: CriticalPoints,
        plane: CellPlane,
        reach: Reach,
        base_width: float = 0.0,
        lowest: float = 0.0,
    ) -> None:
        """Build it; what carries the arm is `base_width` wide [m].

        It reaches from the arm's foot down to `lowest` [m], seen from there.
        """
        self.points, self.plane, self.reach = points, plane, reach
        points.grid  # noqa: B018  made now: it takes a second
        half = 0.5 * base_width
        # To and fro across, so close that no cell is between two of the lines.
        heights = -plane.cell * np.arange(math.floor(-lowest / plane.cell + 1e-9) + 1)
        lines = [((0.0, -half, z), (0.0, half, z)) for z in heights.tolist()]
        self._base = np.array([p for i, line in enumerate(lines) for p in line[:: 1 - 2 * (i % 2)]])
        shoulder = points.of(np.zeros((1, len(points.lower))))[0, 0]
        self._column = np.array([[0.0, 0.0, 0.0], shoulder])

    def links(self, q: Array) -> Array:
        """Return the critical points (s, m, 3) at postures q (s, n), of what can move aside.

        The shoulder's housing cannot: there the upper arm is as near to anything as the column is.
        """
        return moving(self.points.of(q))

    def way_is_free(
        self, q: Array, goal: Array, obstacles: Obstacles, reach: float, *, behind: bool = True
    ) -> bool:
        """Return whether joints may go from q to a goal (n,) in proportion.

        Every posture on the way is free, or, if it may be `behind`, stays so of what it would meet.
        """
        t = np.linspace(0.0, 1.0, ON_THE_WAY)[:, None]
        for points in self.links(q + t * (goal - q)):
            met = obstacles.near[clearances(points, obstacles) < reach]
            front = float(points[:, 0].max()) + BEHIND
            if met.size and not (behind and front <= float(met.min())):
                return False
        return True

    def clears(self, q: Array, goal: Array, passed: Obstacles, reach: float) -> bool:
        """Return whether joints on the way from q to a goal (n,) stay ahead of what is passed."""
        t = np.linspace(0.0, 1.0, ON_THE_WAY)[:, None]
        for points in self.links(q + t * (goal - q)):
            met = passed.near[clearances(points, passed) < reach]
            if met.size and float(points[:, 0].min()) - BEHIND < float(met.max()):
                return False
        return True

    def front(self, q: Array, goal: Array) -> float:
        """Return how far ahead the arm reaches on the way from q to a goal (n,) [m]."""
        t = np.linspace(0.0, 1.0, ON_THE_WAY)[:, None]
        return float(self.points.of(q + t * (goal - q))[:, :, 0].max())

    def posture(self, q: Array, obstacles: Obstacles) -> FoldingPosture:
        """Return the nearest posture in which elbow and tool pass, and all between (`posture`)."""
        blocked = self.blocked(obstacles)
        if blocked:
            return FoldingPosture(None, blocked)
        for wrist in (q[self.points.lead :], np.zeros(len(q) - self.points.lead)):
            found = self._nearest(q, wrist, obstacles)
            if found.q is not None or not wrist.any():
                return found
        return found

    def standing(self, obstacles: Obstacles) -> Array:
        """Return the distances (k,) of obstacles from what cannot move: base and column [m]."""
        column = clearances(self._column, obstacles)
        if not self._base.any():
            return column
        return np.minimum(
            clearances(self._base, obstacles) + self.reach.column - BESIDE_BASE, column
        )

    def blocked(self, obstacles: Obstacles) -> str:
        """Return which part that cannot move does not pass; empty where all do."""
        for name, part in (("base_blocked", self._base), ("column_blocked", self._column)):
            if part is self._base and not part.any():
                continue
            reach = BESIDE_BASE if part is self._base else self.reach.column
            if float(clearances(part, obstacles).min(initial=np.inf)) < reach:
                return name
        return ""

    def _nearest(self, q: Array, wrist: Array, obstacles: Obstacles) -> FoldingPosture:
        q_all, parts = self._candidates(q, wrist)
        found = self._free(parts, obstacles, (True,) * (len(parts) - 1))
        if not found.any():
            return FoldingPosture(None, "no_posture")
        now = self.points.of(q[None])[0]
        cost = np.linalg.norm(parts[-1] - now[-1], axis=1)
        cost += 0.5 * np.linalg.norm(parts[1] - now[1], axis=1)
        cost[~found] = np.inf
        for k in np.argsort(cost, kind="stable")[:TRIED].tolist():
            if np.isinf(cost[k]):
                break
            if self.way_is_free(q, q_all[k], obstacles, self.reach.trigger):
                return FoldingPosture(q_all[k])
        return FoldingPosture(None, "no_way")

    def sequence(self, q: Array, obstacles: Obstacles) -> FoldingPosture:
        """Return the next posture by the paper's order: F1, then F2, then F3 (Zhang, section 4).

        F1: the tool to the nearest place from which the line to the shoulder is free. F2: the elbow
        by self-motion. F3 alone: the tool onto the line of shoulder and elbow. None is looked at
        before those before it are free.
        """
        blocked = self.blocked(obstacles)
        if blocked:
            return FoldingPosture(None, blocked)
        now = self.points.of(q[None])[0]
        # Each line begins off the shoulder on its own way, as those of the candidates do.
        lines = (moving(now[[0, -1]][None])[0], moving(now[[0, 1]][None])[0], now[1:])
        met = [float(clearances(x, obstacles).min(initial=np.inf)) for x in lines]
        q_all, parts = self._candidates(q, q[self.points.lead :])
        elbow = np.linalg.norm(parts[1] - now[1], axis=1)
        tool = np.linalg.norm(parts[-1] - now[-1], axis=1)
        if met[0] < self.reach.trigger:
            free = self._free([parts[0], parts[-1]], obstacles, (True,))
            cost, reason = tool + 1e-3 * elbow, "sequence_f1"
        elif met[1] < self.reach.trigger:
            free = self._free(parts[:2], obstacles, (True,)) & (tool < STILL)
            cost, reason = elbow, "sequence_f2"
        elif met[2] < self.reach.trigger:
            along = now[1, 1:] - now[0, 1:]
            along = along / max(float(np.linalg.norm(along)), 1e-9)
            off = parts[-1][:, 1:] - now[0, 1:]
            cost = np.abs(off[:, 0] * along[1] - off[:, 1] * along[0])
            free, reason = (elbow < STILL) & (cost < STILL), "sequence_f3"
            cost = tool
        else:
            return FoldingPosture(q)
        if not free.any():
            return FoldingPosture(None, reason)
        return FoldingPosture(q_all[int(np.argmin(np.where(free, cost, np.inf)))])

    def _candidates(self, q: Array, wrist: Array) -> tuple[Array, list[Array]]:
        """Return whole postures (s, n), and their critical points, each (s, 3)."""
        grid, lead = self.points.grid, self.points.lead
        shown = q.copy()
        shown[lead:] = wrist
        shoulder = self.points.of(shown[None])[0, 0]
        behind = [grid.elbow + grid.R @ at for at in self.points.beyond_elbow(shown)]
        parts = [np.broadcast_to(shoulder, grid.elbow.shape), grid.elbow, *behind]
        every = np.concatenate([grid.q, np.broadcast_to(wrist, (len(grid.q), len(wrist)))], axis=1)
        return every, parts

    def _free(self, parts: list[Array], obstacles: Obstacles, which: tuple[bool, ...]) -> Flags:
        """Return which candidates (s,) have free links, and keep off foot and column."""
        free = np.ones((1, len(parts[0])))
        tool = parts[-1]
        beside = np.hypot(tool[:, 0], tool[:, 1]) > FROM_COLUMN
        above = tool[:, 2] > parts[0][:, 2] + FROM_COLUMN
        free[0, ~((tool[:, 2] > LOWEST) & (beside | above))] = 0.0
        field = distance_field(obstacles, self.plane)
        step = self.plane.cell / NODES_PER_CELL
        begin = _along(parts[0], parts[1])
        for start, end, asked in zip([begin, *parts[1:-1]], parts[1:], which, strict=True):
            if asked:
                longest = float(np.linalg.norm(end - start, axis=1).max())
                free_links(
                    start, end, field, step, -0.5 * self.plane.width, self.reach.choose,
                    max(1, int(np.ceil(longest / PIECE))), free,
                )  # fmt: skip
        found: Flags = free[0] > 0.0
        return found


def moving(points: Array) -> Array:
    """Return critical points (s, m, 3) that begin a little above the shoulder, on the upper arm."""
    found = points.copy()
    found[:, 0] = _along(points[:, 0], points[:, 1])
    return found


def _along(shoulder: Array, elbow: Array) -> Array:
    """Return the points (s, 3) at `FROM_SHOULDER` on the ways from shoulders to elbows (s, 3)."""
    way = elbow - shoulder
    length = np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    begin: Array = shoulder + way * np.minimum(1.0, FROM_SHOULDER / length)
    return begin
