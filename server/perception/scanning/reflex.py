"""Reflex of an arm that drives under something: postures, the search among them, when to fold."""

import math
from collections.abc import Callable
from concurrent.futures import Executor, Future
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from ....config.load import Cell, ConfigError
from ....config.schema.section import Vector3
from ...control.forest import Forest
from ...control.scene import Flags
from ...control.spatial import Array, Pose
from .contour import (
    NODES_PER_CELL,
    NOTHING,
    CellPlane,
    Obstacles,
    clearance,
    clearances,
    distance_field,
    free_links,
)

# --- Critical points of an arm (shoulder, elbow, tool), and the postures among which a way is
# sought
#
# All in the plane's frame, at the arm's foot. Joints are the arm's alone, without wheels and
# tilt; those beyond the elbow's keep their angles.

STEPS: Final = np.radians([20.0, 10.0, 20.0, 12.0])
"""The grid of postures: steps of the joints up to the elbow's [rad]."""
LOWEST: Final = 0.10
"""Elbow and tool stay so far above the arm's foot [m]: there the chassis is."""
FROM_COLUMN: Final = 0.15
"""The tool stays so far from the column between foot and shoulder [m]."""

DISTINCT: Final = 0.01
"""Critical points are farther apart [m]."""


class Candidates(NamedTuple):
    """The postures of the grid that do not meet foot or column."""

    q: Array
    """Joints up to the elbow's (s, lead) [rad]."""
    elbow: Array
    """(s, 3) [m]."""
    R: Array
    """Attitude of what follows the elbow's joint (s, 3, 3)."""


class CriticalPoints:
    """Shoulder, elbow, joints behind it, and tool of an arm."""

    def __init__(self, part: Cell, shoulder: str, elbow: str, foot: Vector3 = (0.0,) * 3) -> None:
        """Read them from the URDF: origins of two joints, seen from the `foot` in Base [m].

        Raises `ConfigError` for unknown ones.
        """
        self.arm = arm_joints(part)
        """Which of the mechanism's joints are the arm's."""
        joints = [part.robot.joints[i] for i in self.arm]
        drives = [part.config.mechanism.drives[i] for i in self.arm]
        names = [joint.name for joint in joints]
        for key, name in (("shoulder", shoulder), ("elbow", elbow)):
            if name not in names:
                raise ConfigError(
                    f"{part.path}: contour.{key}: value '{name}': the arm has no such joint: "
                    + ", ".join(names)
                )
        self._forest, self._n = Forest(part), len(part.robot.joints)
        self._foot = Pose(np.eye(3), -np.array(foot))
        mechanism = part.config.mechanism
        mrf = mechanism.T_wrist_mrf
        self._body, T_body_wrist = self._forest.body_of(part.prefix + mechanism.tip_link)
        self._T_tool = T_body_wrist @ Pose.from_xyz_rpy(mrf.xyz, mrf.rpy)
        self._shoulder, self._elbow = names.index(shoulder), names.index(elbow)
        self.lower = np.array([joint.lower for joint in joints])
        self.upper = np.array([joint.upper for joint in joints])
        margin = np.array([drive.position_margin for drive in drives])
        self.lower, self.upper = self.lower + margin, self.upper - margin
        self.lead = self._elbow + 1
        """Joints up to the elbow's [1]."""
        self._grid: Candidates | None = None
        # Joints of a wrist have one origin: that is one point.
        self._between: list[int] = []
        origins = self._frames(np.zeros((1, len(names))))[0, :, :, 3]
        for j in range(self._elbow, len(names)):
            last = origins[self._between[-1]] if self._between else np.full(3, np.inf)
            if np.linalg.norm(origins[j] - last) > DISTINCT:
                self._between.append(j)

    def of(self, q: Array) -> Array:
        """Return the critical points (s, m, 3) at postures q (s, n): shoulder, elbow, …, tool."""
        frames = self._frames(q)
        tip = self._frames(q, whole=True)[:, self._body - 1]
        tool = np.einsum("sij,j->si", tip[:, :, :3], self._T_tool.p) + tip[:, :, 3]
        between = [frames[:, j, :, 3] for j in self._between]
        return np.stack([frames[:, self._shoulder, :, 3], *between, tool], axis=1)

    def holding(self, tool: Array, q: Array) -> Array:
        """Return postures (k, n) with the tool (3,) at a place, from those of q (s, n) near it.

        Only joints up to the elbow's bring it there (Newton's method). What does not get there
        within the joints' ranges is left out.
        """
        lead, step = self.lead, 1e-6
        either = step * np.concatenate([np.eye(lead, q.shape[1]) * side for side in (1, -1)])
        for _ in range(CORRECTIONS):
            beside = self.of((q + either[:, None]).reshape(-1, q.shape[1]))[:, -1]
            plus, minus = beside.reshape(2, lead, len(q), 3)
            J = ((plus - minus) / (2.0 * step)).transpose(1, 2, 0)
            off = (tool - self.of(q)[:, -1])[:, :, None]
            Jt = J.transpose(0, 2, 1)
            q = q.copy()
            q[:, :lead] += (Jt @ np.linalg.solve(J @ Jt + 1e-9 * np.eye(3), off))[:, :, 0]
        there = np.linalg.norm(self.of(q)[:, -1] - tool, axis=1) < HELD
        found: Array = q[there & ((q >= self.lower) & (q <= self.upper)).all(axis=1)]
        return found

    def beyond_elbow(self, q: Array) -> Array:
        """Return the critical points behind the elbow (m − 2, 3) as the elbow's joint sees them."""
        frame = self._frames(q[None])[0, self._elbow]
        seen: Array = (self.of(q[None])[0, 2:] - frame[:, 3]) @ frame[:, :3]
        return seen

    def _frames(self, q: Array, *, whole: bool = False) -> Array:
        """Return the frames (s, n, 3, 4) of the arm's joints at q (s, n); of all, if `whole`."""
        every = np.zeros((len(q), self._n))
        every[:, self.arm] = q
        frames = self._forest.frames(every, self._foot)
        return frames if whole else frames[:, self.arm]

    @property
    def grid(self) -> Candidates:
        """The grid of postures; made once."""
        if self._grid is None:
            axes = []
            for low, high, step in zip(
                self.lower[: self.lead], self.upper[: self.lead], _steps(self.lead), strict=True
            ):
                first, last = max(low, -np.pi), min(high, np.pi - 0.5 * step)
                axes.append(np.arange(np.ceil(first / step), np.floor(last / step) + 1) * step)
            q = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, self.lead)
            whole = np.zeros((len(q), len(self.lower)))
            whole[:, : self.lead] = q
            frames = self._frames(whole)[:, self._elbow]
            found = Candidates(q, frames[:, :, 3].copy(), frames[:, :, :3].copy())
            self._grid = Candidates(*(each[found.elbow[:, 2] > LOWEST] for each in found))
        return self._grid


def arm_joints(part: Cell) -> list[int]:
    """Return which joints of a mechanism are the arm's: neither wheels nor what only sweeps."""
    mechanism = part.config.mechanism
    return [
        i for i, joint in enumerate(part.robot.joints) if joint.name not in mechanism.beside_chain
    ]


def _steps(lead: int) -> Array:
    """Return the steps of the grid; joints of an arm with fewer are the last ones' like."""
    return STEPS[:lead] if lead <= len(STEPS) else np.full(lead, np.radians(30.0))


# --- Search of a posture in which the arm passes: far too slow for a tick, so it runs beside it ---
#
# `Way` is what the reflex asks for; both rules answer with joint angles, or with the reason why
# there are none.

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
NEAR: Final = 0.15
"""Postures of the grid whose tool is nearer to a place are brought there [m]."""
CORRECTIONS, HELD = 4, 1e-3
"""Steps of Newton's method [1], and how near they bring the tool [m]."""


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
        cost = lengths(parts[-1] - now[-1])
        cost += 0.5 * lengths(parts[1] - now[1])
        return self._cheapest(q, q_all[found], cost[found], obstacles)

    def _cheapest(
        self, q: Array, goals: Array, cost: Array, obstacles: Obstacles
    ) -> FoldingPosture:
        """Return the goal (s, n) of least cost (s,) to which the way is free."""
        for k in np.argsort(cost, kind="stable")[:TRIED].tolist():
            if self.way_is_free(q, goals[k], obstacles, self.reach.trigger):
                return FoldingPosture(goals[k])
        return FoldingPosture(None, "no_way")

    def sequence(self, q: Array, obstacles: Obstacles) -> FoldingPosture:
        """Return the next posture by the paper's order: F1, then F2, then F3 (Zhang, section 4).

        F1: the tool to the nearest place from which the line to the shoulder is free. F2: the elbow
        round its circle about that line, by self-motion: the tool stands. F3 alone: the tool onto
        the line of shoulder and elbow, where it is free. None is looked at before those before it
        are free.
        """
        blocked = self.blocked(obstacles)
        if blocked:
            return FoldingPosture(None, blocked)
        now = self.points.of(q[None])[0]
        # Each line begins off the shoulder on its own way, as those of the candidates do.
        lines = (moving(now[[0, -1]][None])[0], moving(now[[0, 1]][None])[0], now[1:])
        met = [clearance(line, obstacles) < self.reach.trigger for line in lines]
        if not any(met):
            return FoldingPosture(q)
        q_all, parts = self._candidates(q, q[self.points.lead :])
        rule = met.index(True)
        if rule == 0:
            parts = [parts[0], parts[-1]]
        elif rule == 1:
            near = lengths(parts[-1] - now[-1]) < NEAR
            q_all = self.points.holding(now[-1], q_all[near])
            parts = list(self.points.of(q_all).transpose(1, 0, 2))
        free = self._free(parts, obstacles, (rule < 2, *(rule == 2,) * (len(parts) - 2)))
        if rule == 2:
            along = now[1, 1:] - now[0, 1:]
            along = along / max(float(np.linalg.norm(along)), 1e-9)
            off = parts[-1][:, 1:] - now[0, 1:]
            free &= np.abs(off[:, 0] * along[1] - off[:, 1] * along[0]) < STILL
            free &= lengths(parts[1] - now[1]) < STILL
        if not free.any():
            return FoldingPosture(None, ("sequence_f1", "sequence_f2", "sequence_f3")[rule])
        moved = 1 if rule == 1 else -1
        cost = lengths(parts[moved] - now[moved])
        cost += 1e-3 * np.linalg.norm(q_all - q, axis=1)
        return self._cheapest(q, q_all[free], cost[free], obstacles)

    def _candidates(self, q: Array, wrist: Array) -> tuple[Array, list[Array]]:
        """Return whole postures (s, n), and their critical points, each (s, 3)."""
        grid, lead = self.points.grid, self.points.lead
        shown = q.copy()
        shown[lead:] = wrist
        shoulder = self.points.of(shown[None])[0, 0]
        axes = grid.R.reshape(-1, 3)
        behind = [grid.elbow + (axes @ at).reshape(-1, 3) for at in self.points.beyond_elbow(shown)]
        parts = [np.broadcast_to(shoulder, grid.elbow.shape), grid.elbow, *behind]
        every = np.concatenate([grid.q, np.broadcast_to(wrist, (len(grid.q), len(wrist)))], axis=1)
        return every, parts

    def _free(self, parts: list[Array], obstacles: Obstacles, which: tuple[bool, ...]) -> Flags:
        """Return which candidates (s,) have free links, and keep off foot and column."""
        free = np.ones((1, len(parts[0])))
        tool = parts[-1]
        beside = np.hypot(tool[:, 0], tool[:, 1]) > FROM_COLUMN
        above = tool[:, 2] > parts[0][:, 2] + FROM_COLUMN
        low = np.minimum(parts[1][:, 2], tool[:, 2]) <= LOWEST
        free[0, low | ~(beside | above)] = 0.0
        field = distance_field(obstacles, self.plane)
        step = self.plane.cell / NODES_PER_CELL
        begin = _along(parts[0], parts[1])
        for start, end, asked in zip([begin, *parts[1:-1]], parts[1:], which, strict=True):
            if asked:
                longest = float(lengths(end - start).max(initial=0.0))
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


def lengths(vectors: Array) -> Array:
    """Return the lengths (s,) of vectors (s, 3)."""
    x, y, z = vectors.T
    found: Array = np.sqrt(x * x + y * y + z * z)
    return found


def _along(shoulder: Array, elbow: Array) -> Array:
    """Return the points (s, 3) at `FROM_SHOULDER` on the ways from shoulders to elbows (s, 3)."""
    way = elbow - shoulder
    length = np.maximum(lengths(way)[:, None], 1e-9)
    begin: Array = shoulder + way * np.minimum(1.0, FROM_SHOULDER / length)
    return begin


# --- Steering aside: the arc on which a base that is driven straight ahead passes what it met -----
#
# Of the arcs on which what cannot move passes, the one that is nearest to where the operator was
# heading: what was turned aside is turned back as soon as that way is free. Who turns the base
# himself is not steered; the daemon sees to that, and here it shows in a base that does not turn.

ARCS: Final = 8
"""Arcs to either side that are looked at [1]."""
BESIDE: Final = 0.05
"""A base that steers aside keeps so much farther from things than it has to [m]."""
TURNED_BACK: Final = 1.0
"""Over about so long a way it is turned back to its heading [m]."""
LEAST_TURN: Final = 0.02
"""Less is not turned back [rad]."""
CHANGE: Final = 0.25
"""What an arc counts for that is another than the last one [1]."""
FOLLOWS_S: Final = 1.0
"""A base that is told to turn does so within about this time [s]."""
AT_ONCE: Final = 4
"""Arcs that are looked at in one contour, beside those driven on and wanted [1]."""
LOOKS_AGAIN_S: Final = 0.5
"""Where no arc was free, all are looked at again after so long [s]."""
OWN_TURN: Final = 0.03
"""Where it was told to turn by so much, and did not, somebody else turns it [rad]."""


class Steering:
    """Remembers one way around. Tell it every contour; it answers with the arc to be driven on."""

    def __init__(self, most: float) -> None:
        """Build it for curvatures of at most so much [1/m]; 0: it never steers."""
        self._arcs = most * np.arange(-ARCS, ARCS + 1) / ARCS
        self._most, self._step = most, most / ARCS
        self.forget()

    def forget(self) -> None:
        """Remember no way."""
        self.curvature = 0.0
        """The arc that was told last [1/m]; 0: straight ahead, or as the operator likes."""
        self._owed = self._told = self._did = 0.0
        """What is to be turned back, what was told lately, and what was turned [rad]."""
        self._before: tuple[float, Pose] | None = None
        self._left: list[float] = []  # arcs that are still to be looked at, the best one first
        self._again_s = -math.inf

    def step(self, time_s: float, base: Pose, blocked: Callable[[float], bool]) -> float:
        """Return the curvature to be driven on [1/m].

        `base` is Base by its odometry; `blocked` tells whether something is met on an arc that does
        not fit.
        """
        if self._most == 0.0:
            return 0.0
        self._count(time_s, base)
        wanted = 0.0
        if abs(self._owed) > LEAST_TURN:
            wanted = min(max(self._owed / TURNED_BACK, -self._most), self._most)
        if not blocked(wanted):
            self.curvature, self._left = wanted, []
            return wanted
        if time_s < self._again_s:
            return self.curvature
        if self.curvature != 0.0 and not blocked(self.curvature):
            self._left = []
            change = min(max(wanted - self.curvature, -self._step), self._step)
            if not blocked(self.curvature + change):
                self.curvature += change
            return self.curvature
        if not self._left:
            cost = np.abs(self._arcs - wanted) + CHANGE * np.abs(self._arcs - self.curvature)
            self._left = self._arcs[np.argsort(cost, kind="stable")].tolist()
        looked, self._left = self._left[:AT_ONCE], self._left[AT_ONCE:]
        for arc in looked:
            if not blocked(arc):
                self.curvature, self._left = arc, []
                return arc
        if not self._left:
            self.curvature, self._again_s = 0.0, time_s + LOOKS_AGAIN_S
        return self.curvature

    def _count(self, time_s: float, base: Pose) -> None:
        """Count what this has turned the base by; forget it where somebody else turns it."""
        before, self._before = self._before, (time_s, base)
        if before is None:
            return
        moved = before[1].inverse() @ base
        turned = math.atan2(moved.R[1, 0], moved.R[0, 0])
        told = self.curvature * max(0.0, float(moved.p[0]))
        # What both say is its own.
        own = math.copysign(min(abs(told), abs(turned)), told) if told * turned > 0.0 else 0.0
        self._owed -= own
        lately = math.exp(-(time_s - before[0]) / FOLLOWS_S)
        self._told, self._did = lately * self._told + told, lately * self._did + own
        if abs(self._told) > OWN_TURN and abs(self._did) < 0.5 * abs(self._told):
            self._owed = self._told = self._did = 0.0


# --- Reflex of an arm that drives under something: when to wait, where to fold, when to unfold ----
#
# A state machine over contours. It moves nothing: it says which posture the arm should take,
# and how quickly the base may drive forward meanwhile. The tick decides whether that is done.
#
#     clear ──► undecided ──► folding ──► folded ──► returning ──► clear
#                   │  ▲          │          │           │
#                   ▼  └──────────┴── not free any more ─┘
#                refused

UNDECIDED_FRONT: Final = 0.80
"""While nothing is decided the arm may yet stretch so far ahead [m]."""
STAND_OFF: Final = 0.15
"""The base stops so far before what it must not meet [m]."""
DECELERATION: Final = 0.2
"""The base slows down like that before it [m/s²]."""
REACTS_S: Final = 0.3
"""Of news, tick and drives together [s]; the contour itself may be as old as `silent_s`."""
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
        silent_s: float,
    ) -> None:
        """Build it; nothing is decided before an obstacle was looked at for `decide_s` [s].

        Nothing is done about what is farther ahead than `trigger` [m]. `in_sequence` takes the
        paper's order in place of the search of a whole posture. The base is slowed down in time
        for contours that are up to `silent_s` old; without `wait`, never.
        """
        self._search, self._decide_s, self._silent_s = search, decide_s, silent_s
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
        return speed_within(max(0.0, float(met.min()) - front - STAND_OFF), self._silent_s)


def speed_within(room: float, silent_s: float) -> float:
    """Return the greatest speed of a base [m/s] that still stops within a way [m].

    What it knows of that may be `silent_s` old.
    """
    b = DECELERATION * (silent_s + REACTS_S)
    return math.sqrt(b * b + 2.0 * DECELERATION * room) - b
