"""Collision barriers of one tick: links against obstacles and each other, and the workspace.

One look serves both the barriers of the tick and the judgement of the stops that it considers.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ....config.load import Cell
from ..compiled import FLAGS, INDEX, MATRIX, ROW, VECTOR, compiled
from ..proximity.capsules import Capsules, Placed
from ..scene import Flags, Index, Scene
from ..spatial import Array, Pose
from .clearance import Base, Clearance, Levels, NearGaps, Postures, Shown
from .velocity_damper import Rows
from .workspace import Walls

NAMED = 3
"""Number of acting barriers that are named [1]."""

ORDERED = 1e-4
"""A tool that is to go at more than this was told to [m/s, rad/s]."""


class Tool(NamedTuple):
    """The tool of one mechanism."""

    p: Array
    """Where its MRF is in World (3,) [m]."""
    J: Array
    """Its Jacobian in its own k joints (6, k)."""
    T_wrist_mrf: Pose
    joints: slice
    """Where these joints are among all."""
    ordered: bool = True
    """Somebody wants it to move, and no sensor's noise."""
    makes_way: float = 1.0
    """Part of the speed of what comes that its arm makes way at, 0 to 1."""


class Situation(NamedTuple):
    """Inputs of one tick for the n joints of a cell."""

    q: Array
    dq: Array
    error: Array
    """Tracking errors of the joints (n,) [rad]."""
    tools: tuple[Tool, ...]
    scene: Scene | None
    factor: float
    """The reduced-speed setting."""
    base: Base = None
    placed: Placed | None = None
    """Where links are at q, where that is known already."""


class Watch(NamedTuple):
    """Near pairs and barriers of one tick."""

    at: Situation
    sight: NearGaps
    rows: Rows
    """Barriers: first those of the gaps that are near, then those of the workspace."""
    speeds: tuple[float, ...]
    """At which each tool is asked to go [m/s]."""
    coming: Array
    """Speed at which arms make way for the second of each pair (k,) [m/s]."""

    @property
    def levels(self) -> Levels:
        """Best gaps so far, for the next tick."""
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
        self.walls = tuple(Walls(part, self.capsules) for part in cell.parts)
        """The workspace of each mechanism's tool."""
        self._arm = _arm_of(self.capsules.moves, [len(part.joints) for part in cell.parts])
        self._near_distance, self._near_speed = avoidance.near_distance, avoidance.near_speed
        self._clearance, self._speed = avoidance.clearance, cell.config.limits.speed
        self._tools = tuple(self.capsules.body == w.body for w in self.walls)

    def watch(self, at: Situation, asked: Array, levels: Levels) -> Watch:
        """Return what is around the arms, if joints are to go at `asked` (n,) [rad/s]."""
        clearance = self.clearance
        fastest, speeds, rates = np.empty(len(asked)), [], []
        for tool in at.tools:
            part = tool.joints
            speed, rate = _ask(tool.J, asked[part], at.dq[part], fastest[part])
            speeds.append(speed)
            rates.append(rate)
        sight = clearance.look(
            at.q, fastest, at.error, at.scene, at.factor, levels, at.base, at.placed
        )
        # Only an arm that is to move is led out of a bound; self-motion alone is no order.
        widen = any(t.ordered and rate > ORDERED for t, rate in zip(at.tools, rates, strict=True))
        coming = sight.near.approach
        if np.count_nonzero(coming):
            shares = np.array([tool.makes_way for tool in at.tools])
            coming = shares[self._arm[sight.near.first]] * coming
            coming = np.minimum(coming, at.factor * self._speed)
        gaps, room, closing = sight.near.rows, sight.room, (sight.near.speed, coming)
        rows = []
        for tool, walls in zip(at.tools, self.walls, strict=True):
            walled = walls.around(_whole(tool, len(at.q)), tool.p)
            rows.append(clearance.braking.rows(gaps, room, closing, walled, at.factor, widen))
            gaps, room, closing = gaps[:0], room[:0], (coming[:0], coming[:0])
        return Watch(at, sight, Rows.of_all(rows), tuple(speeds), coming)

    def makes_way(self, watch: Watch) -> list[bool]:
        """Return which arms are to go out of the way of something that comes."""
        near, found = watch.sight.near, [False] * len(watch.at.tools)
        if np.count_nonzero(watch.coming):
            for i in np.flatnonzero((watch.coming > 0.0) & (watch.rows.low[: near.size] > 0.0)):
                found[self._arm[near.first[i]]] = True
        return found

    def tool_shares(self, watch: Watch) -> list[float]:
        """Return what share (0 to 1) of each tool's motion is slow enough beside things."""
        if self._near_speed is None:
            return [1.0] * len(watch.speeds)
        near, shares = watch.sight.near, []
        for tool, speed in zip(self._tools, watch.speeds, strict=True):
            gap = _least_beside(near.gap, near.obstacle, near.first, tool)
            if gap == math.inf:
                shares.append(1.0)
                continue
            far = (gap - self._clearance) / (self._near_distance - self._clearance)
            bound = self._near_speed + min(1.0, max(0.0, far)) * (self._speed - self._near_speed)
            shares.append(min(1.0, watch.at.factor * bound / max(speed, 1e-12)))
        return shares

    def slowed_to_limit(self, watch: Watch, dq: Array) -> Array:
        """Return rates dq (n,) at which no tool that makes way is faster than it may be."""
        share = 1.0
        for tool, asked in zip(watch.at.tools, watch.speeds, strict=True):
            speed = float(np.linalg.norm(tool.J[:3] @ dq[tool.joints]))
            most = max(asked, watch.at.factor * self._speed)
            share = min(share, most / max(speed, 1e-12))
        return dq if share >= 1.0 else share * dq

    def named(self, watch: Watch, broken: Flags) -> tuple[str, ...]:
        """Return the names of barriers that are flagged, the nearest first."""
        gaps = self.shown(watch, broken).gaps(NAMED, only_active=True)
        names = tuple(f"clearance:{gap.link}:{gap.other}" for gap in gaps)
        if np.count_nonzero(broken[watch.sight.near.size :]):
            names += ("workspace",)
        return names

    def shown(self, watch: Watch, active: Flags) -> Shown:
        """Return the pairs for telemetry; `active` flags the barriers that act."""
        return Shown(watch.sight, self.capsules.links, active[: watch.sight.near.size])

    def shortfall(
        self, watch: Watch, duration_s: float, low: Array, high: Array, postures: Postures
    ) -> float:
        """Return by how much a stop breaks what is kept, at its worst place [m]; 0 for not."""
        at = watch.at
        way = np.maximum(high - at.q, at.q - low)
        short = self.clearance.shortfall(watch.sight, duration_s, way, postures)
        for tool, walls in zip(at.tools, self.walls, strict=True):
            if not walls.given or walls.far(tool.p, tool.T_wrist_mrf, way):
                continue
            times = np.linspace(0.0, duration_s, 1 + max(1, math.ceil(duration_s / 0.05)))
            base = None if at.base is None else at.base.T
            out = walls.shortfall(tool.p, tool.T_wrist_mrf, postures(times), base)
            short = max(short, out)
        return short


def _arm_of(moves: Flags, counts: Sequence[int]) -> Index:
    """Return which arm each capsule (c,) is part of; `moves` (c, n) tells which joints move it."""
    found, first = np.zeros(len(moves), dtype=np.int64), 0
    for arm, count in enumerate(counts):
        found[moves[:, first : first + count].any(axis=1)] = arm
        first += count
    return found


def _whole(tool: Tool, n: int) -> Array:
    """Return a tool's Jacobian in all joints (6, n)."""
    if tool.J.shape[1] == n:
        return tool.J
    J = np.zeros((6, n))
    J[:, tool.joints] = tool.J
    return J


@compiled(MATRIX, VECTOR, VECTOR, ROW)
def _ask(J: Array, asked: Array, dq: Array, fastest: Array) -> tuple[float, float]:
    """Return the tool's speed [m/s] at rates `asked` (n,), and its greatest rate along any axis.

    J (6, n) is its Jacobian. Each joint's speed (n,), at those rates or at `dq` (n,), is written.
    """
    speed2, greatest = 0.0, 0.0
    for j in range(len(dq)):
        fastest[j] = max(abs(asked[j]), abs(dq[j]))
    for i in range(6):
        rate = 0.0
        for j in range(len(dq)):
            rate += J[i, j] * asked[j]
        greatest = max(greatest, abs(rate))
        if i < 3:
            speed2 += rate * rate
    return math.sqrt(speed2), greatest


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
