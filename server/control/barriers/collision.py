"""Everything that keeps the arm clear, looked at once per tick: links, obstacles, the workspace.

One look serves both the barriers of the tick and the judgement of the stops that it considers.
"""

import math
from typing import NamedTuple

import numpy as np

from ....config.load import Cell
from ..compiled import FLAGS, INDEX, MATRIX, VECTOR, compiled
from ..proximity.capsules import Capsules, Placed
from ..scene import Flags, Index, Scene
from ..spatial import Array, Pose
from .clearance import Base, Clearance, Levels, Postures, Shown, Sight
from .velocity_damper import Rows
from .workspace import Walls

NAMED = 3
"""So many of the barriers that act are named [1]."""

ORDERED = 1e-4
"""A tool that is to go at more than this was told to [m/s, rad/s]."""


class Situation(NamedTuple):
    """What one tick has to know of the arm."""

    q: Array
    dq: Array
    error: Array
    """What the joints are behind the command (n,) [rad]."""
    p: Array
    """Where the MRF is in World (3,) [m]."""
    J: Array
    """Its Jacobian (6, n)."""
    T_wrist_mrf: Pose
    scene: Scene | None
    factor: float
    """The reduced-speed setting."""
    base: Base = None
    placed: Placed | None = None
    """Where links are at q, where that is known already."""


class Watch(NamedTuple):
    """What is around the arm in one tick."""

    at: Situation
    sight: Sight
    rows: Rows
    """Barriers: first those of the gaps that are near, then those of the workspace."""
    speed: float
    """At which the tool is asked to go [m/s]."""

    @property
    def levels(self) -> Levels:
        """What to hand to the next tick."""
        return self.sight.levels


class Guard:
    """Keeps one cell's clearances and workspace."""

    def __init__(
        self, cell: Cell, acceleration: Array, jerk: Array, capsules: Capsules | None = None
    ) -> None:
        """Build it for the cell's capsules, which are fitted here unless they are given."""
        avoidance = cell.config.avoidance
        self.capsules = Capsules(cell) if capsules is None else capsules
        self.clearance = Clearance(cell, acceleration, jerk, self.capsules)
        self.walls = Walls(cell, self.capsules)
        self._near_distance, self._near_speed = avoidance.near_distance, avoidance.near_speed
        self._clearance, self._speed = avoidance.clearance, cell.config.limits.speed
        self._tool = self.capsules.body == self.capsules.forest.n

    def watch(self, at: Situation, asked: Array, levels: Levels, ordered: bool = True) -> Watch:
        """Return what is around the arm, if joints are to go at `asked` (n,) [rad/s].

        `ordered` tells whether somebody wants that, and no sensor's noise.
        """
        clearance, J = self.clearance, at.J
        speed, rate, fastest = _asked(J, asked, at.dq)
        sight = clearance.look(
            at.q, fastest, at.error, at.scene, at.factor, levels, at.base, at.placed
        )
        tool, closing = self.walls.around(J, at.p), sight.near.speed
        # Only an arm that is to move is led out of a bound; self-motion alone is no order.
        widen = ordered and rate > ORDERED
        rows = clearance.braking.rows(sight.near.rows, sight.room, closing, tool, at.factor, widen)
        return Watch(at, sight, rows, speed)

    def tool_share(self, watch: Watch) -> float:
        """Return the share (0 to 1) of the asked tool motion that is slow enough beside things."""
        if self._near_speed is None:
            return 1.0
        near = watch.sight.near
        gap = _least_beside(near.gap, near.obstacle, near.first, self._tool)
        if gap == math.inf:
            return 1.0
        far = (gap - self._clearance) / (self._near_distance - self._clearance)
        bound = self._near_speed + min(1.0, max(0.0, far)) * (self._speed - self._near_speed)
        return min(1.0, watch.at.factor * bound / max(watch.speed, 1e-12))

    def named(self, watch: Watch, broken: Flags) -> tuple[str, ...]:
        """Return the names of barriers that are flagged, the nearest first."""
        gaps = self.shown(watch, broken).gaps(NAMED, only_active=True)
        names = tuple(f"clearance:{gap.link}:{gap.other}" for gap in gaps)
        if np.count_nonzero(broken[watch.sight.near.size :]):
            names += ("workspace",)
        return names

    def shown(self, watch: Watch, active: Flags) -> Shown:
        """Return the pairs for whoever looks on; `active` flags the barriers that act."""
        return Shown(watch.sight, self.capsules.links, active[: watch.sight.near.size])

    def shortfall(
        self, watch: Watch, duration_s: float, low: Array, high: Array, postures: Postures
    ) -> float:
        """Return by how much a stop breaks what is kept, at its worst place [m]; 0 for not."""
        at = watch.at
        way = np.maximum(high - at.q, at.q - low)
        short = self.clearance.shortfall(watch.sight, duration_s, way, postures)
        if self.walls.given:
            if self.walls.far(at.p, at.T_wrist_mrf, way):
                return short
            times = np.linspace(0.0, duration_s, 1 + max(1, math.ceil(duration_s / 0.05)))
            base = None if at.base is None else at.base.T
            out = self.walls.shortfall(at.p, at.T_wrist_mrf, postures(times), base)
            short = max(short, out)
        return short


@compiled(MATRIX, VECTOR, VECTOR)
def _asked(J: Array, asked: Array, dq: Array) -> tuple[float, float, Array]:
    """Return the tool's speed [m/s] at rates `asked` (n,), and its greatest rate along any axis.

    J (6, n) is its Jacobian. And each joint's speed (n,), at those rates or at `dq` (n,).
    """
    speed2, greatest, fastest = 0.0, 0.0, np.empty(len(dq))
    for j in range(len(dq)):
        fastest[j] = max(abs(asked[j]), abs(dq[j]))
    for i in range(6):
        rate = 0.0
        for j in range(len(dq)):
            rate += J[i, j] * asked[j]
        greatest = max(greatest, abs(rate))
        if i < 3:
            speed2 += rate * rate
    return math.sqrt(speed2), greatest, fastest


@compiled(VECTOR, INDEX, INDEX, FLAGS)
def _least_beside(gap: Array, obstacle: Index, first: Index, tool: Flags) -> float:
    """Return the least gap (k,) between the tool and an obstacle [m]; infinite without any.

    `tool` says which capsules (c,) are the tool's.
    """
    least = np.inf
    for i in range(len(gap)):
        if tool[first[i]] and obstacle[i] >= 0:
            least = min(least, gap[i])
    return least
