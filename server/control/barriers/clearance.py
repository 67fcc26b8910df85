"""Clearances: their barriers of one tick, and their shortfall along a stop."""

import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from ....config.load import Cell
from ..bodies.rates import ArmTick
from ..compiled import (
    COUNT,
    COUNTS,
    FLAGS,
    INDEX,
    MATRIX,
    NUMBER,
    ROW,
    TABLE,
    VECTOR,
    compiled,
)
from ..joints import joined, parts_of
from ..proximity.capsules import Capsules, Placed, carried, doubtful, surroundings, travel
from ..proximity.pairs import NearPairs, PairSearch, Shown
from ..scene import Body, Flags, Index, Scene
from ..spatial import Array, Motion, Pose
from .rows import Braking, Rows, Walls

# --- Minimum distances: promises plus tracking errors, margins and motion of obstacles ------------

HORIZON_S: Final = 0.4
"""Moving obstacles count if they can be near within this time [s]."""
FRESH_S: Final = 0.2
"""Older news does not show that something stands [s]."""
ROUNDEST: Final = 0.02
"""Paths of links around things are no more curved than a circle with this radius [m]."""


def held(
    tube: Array, gap: Array, promise: Array, nearer: Array, between: float
) -> tuple[Array, Array, Index]:
    """Return minimum gaps (k,) [m], floors as if none were held, and which are.

    A gap is held if it is below its minimum, or may be within `HORIZON_S` by an obstacle's motion
    alone: `nearer` (s, k) [m] is how much nearer pairs may be, in the last row then, or (0, 0).
    """
    needed, floor = np.empty(len(gap)), np.empty(len(gap))
    which = np.empty(len(gap), dtype=np.int64)
    count = _hold(tube, gap, promise, nearer, between, needed, floor, which)
    return needed, floor, which[:count]


@compiled(VECTOR, VECTOR, VECTOR, MATRIX, NUMBER, ROW, ROW, COUNTS)
def _hold(
    tube: Array, gap: Array, promise: Array, nearer: Array, between: float,
    needed: Array, floor: Array, which: Index,
) -> int:  # fmt: skip
    count = 0
    for i in range(len(gap)):
        needed[i], floor[i] = promise[i] + tube[i] + between, np.inf
        soon = nearer[len(nearer) - 1, i] if len(nearer) else 0.0
        if gap[i] < needed[i] + soon:
            which[count] = i
            count += 1
    return count


def kept(
    rows: Array, error: Array, gap: Array, promise: Array, nearer: Array,
    margin: float, between: float,
) -> tuple[Array, Array, Array, Array, Index]:  # fmt: skip
    """Return tube and room (k,), as in `Sight`, and what `held` does.

    `error` (n,) [rad] is what joints are behind; `nearer` (2, k) [m], or (0, 0), how much nearer
    pairs may be before the arm is where the command is now, and within `HORIZON_S`.
    """
    k = len(gap)
    tube, room, needed, floor = np.zeros(k), np.empty(k), np.empty(k), np.empty(k)
    which = np.empty(k, dtype=np.int64)
    count = _keep(
        rows, error, gap, promise, nearer, margin, between, tube, room, needed, floor, which
    )
    return tube, room, needed, floor, which[:count]


@compiled(MATRIX, VECTOR, VECTOR, VECTOR, MATRIX, NUMBER, NUMBER, ROW, ROW, ROW, ROW, COUNTS)
def _keep(
    rows: Array, error: Array, gap: Array, promise: Array, nearer: Array,
    margin: float, between: float,
    tube: Array, room: Array, needed: Array, floor: Array, which: Index,
) -> int:  # fmt: skip
    k, n = rows.shape
    for i in range(k):
        for j in range(n):
            tube[i] += abs(rows[i, j]) * abs(error[j])
        room[i] = gap[i] - promise[i] - margin - tube[i]
        if len(nearer):
            room[i] -= nearer[0, i]
    return _hold(tube, gap, promise, nearer, between, needed, floor, which)


def standing(near: NearPairs, scene: Scene) -> Flags:
    """Return whose second may move, and counts as standing (k,).

    It does by fresh news where nothing comes, while what may move is nearer than promised to
    something that the same joints move: a promise that is broken now is mended before one that
    might be. Such gaps keep what they need, but nothing for what would do if it set out.
    """
    movable = near.speed > 0.0
    broken = movable & (near.gap < near.promise)
    if not np.count_nonzero(broken) or np.count_nonzero(near.approach):
        return np.zeros(near.size, dtype=bool)
    beside = near.rows[:, near.rows[broken].any(axis=0)].any(axis=1)
    return np.asarray(movable & ~broken & (scene.age[near.obstacle] <= FRESH_S) & beside)


def wanted(
    count: int, pairs: Index, closer: Array, needed: Array, promise: Array, radii: Array,
    floor: Array, nearer: Array,
) -> Array:  # fmt: skip
    """Return minimum distances (count + 1, p) [m] between segments of `pairs` (p,) along a stop.

    The minimum gap, plus the sagitta of a path that comes `closer` (p,) in `count` steps and is no
    more curved than its radii, plus the approach of obstacles `nearer` (count + 1, k), or (0, 0);
    at most the floor.
    """
    found = np.empty((count + 1, len(pairs)))
    _want(count, pairs, closer, needed, promise, radii, floor, nearer, found)
    return found


@compiled(COUNT, INDEX, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, MATRIX, TABLE)
def _want(
    count: int, pairs: Index, closer: Array, needed: Array, promise: Array, radii: Array,
    floor: Array, nearer: Array, found: Array,
) -> None:  # fmt: skip
    for i in range(len(pairs)):
        k, chord = pairs[i], closer[i] / count
        round_off = chord * chord / (8.0 * max(radii[k] + promise[k], ROUNDEST))
        for s in range(count + 1):
            bound = needed[k] + round_off
            if len(nearer):
                bound += nearer[s, k]
            found[s, i] = min(bound, floor[k]) + radii[k]


# --- Clearances: their barriers, and their shortfall along a stop ---------------------------------
#
# A promise is kept by the arm itself, not by the command that it follows: what the joints lag
# behind the command, times how much that matters for the gap, is taken off every gap (the
# tracking tube).

SAMPLE_S = 0.025
"""Greatest time between two postures that are checked along a stop [s] …"""
SAMPLE_M = 0.03
"""… and greatest motion of any link between them [m]."""
SAMPLES = 16
"""Greatest number of postures that are checked along a stop [1]."""
BETWEEN = 0.4
"""Part of the margin that stops keep: for what a curved path dips between two looks, beside the
chord's, and for what loaded joints give way by, which no encoder sees [1]."""
SLACK = 1e-4
"""A gap that is below its bound may shrink by so much in all, not more [m]."""
CREEP = 2e-5
"""The same of a gap to something that comes nearer, in one period [m]."""
COMES = 1e-3
"""Slower obstacles count as static [m/s]."""
BESIDE = 0.03
"""Extra search radius around capsules [m]."""
LATENCY = 3.0
"""Periods until the arm is where the command is now [1]."""

_LOOKS = np.arange(SAMPLES + 1.0)
_STILL = np.zeros((0, 0))
"""How much nearer pairs may be where nothing moves: not at all, at any time."""

Postures = Callable[[Array], Array]
"""Joint angles (s, n) at times (s,) along a stop."""

Bases = tuple[Body, ...]
"""Bases of all mechanisms where any may move, and how; none: they stand where the cell has them."""

Levels = dict[tuple[int, int, str], float]
"""Best gap so far of each pair that is inside its bound, by capsule, other capsule or −1, name."""


class NearGaps(NamedTuple):
    """Clearances at one posture: near pairs, and the bounds of their gaps."""

    scene: Scene | None
    bases: Bases
    still: bool
    """Nothing moves but the arms: neither a Base nor anything in the scene may."""
    lever: Array
    """Distances of capsules from the joints' axes (c, n) [m]."""
    around: Array
    """How far each capsule may come before other pairs matter (c,) [m]."""
    near: NearPairs
    room: Array
    """How far each gap may close (k,) [m]; negative beyond its barrier."""
    tube: Array
    """Loss of each gap (k,) by tracking errors [m]."""
    needed: Array
    """Minimum of each gap (k,) along a stop [m]."""
    floor: Array
    """Minimum of each gap (k,) that is below its bound already [m]."""
    levels: Levels


class Clearance:
    """The clearances of one cell."""

    def __init__(self, cell: Cell, acceleration: Array, jerk: Array, capsules: Capsules) -> None:
        self.capsules = capsules
        self.search = PairSearch(cell, capsules)
        body = capsules.body.tolist()
        self._root: Index = np.array([capsules.forest.root(b) for b in body], dtype=np.int64)
        """The Base that carries each capsule (c,)."""
        self._period_s = cell.config.timing.period_s
        self._margin = cell.config.avoidance.margin
        self._between = BETWEEN * self._margin
        self.braking = Braking(acceleration, jerk, self._period_s)

    def look(
        self, q: Array, fastest: Array, error: Array, scene: Scene | None, factor: float,
        levels: Levels, bases: Bases = (), placed: Placed | None = None,
    ) -> NearGaps:  # fmt: skip
        """Return near pairs and bounds at q (n,) [rad], for joint speeds `fastest` (n,) [rad/s].

        `error` (n,) [rad] is what the joints are behind the command; `factor` the reduced-speed
        setting; `levels` those of the sight before; `bases` where Bases are, where any may move;
        `placed` where links are at q, where that is known.
        """
        capsules, still = self.capsules, not bases and (scene is None or not scene.moves)
        if placed is None:
            placed = capsules.place(q[None], _poses(bases))
        gear, acceleration = capsules.forest.gear, self.braking.acceleration
        if gear is not None:
            fastest, acceleration = gear * fastest, gear * acceleration
        lever, around = surroundings(
            placed[:], capsules.moves, capsules.forest.tree.prismatic, fastest,
            acceleration, factor, self.braking.lag(factor), BESIDE + self._margin,
        )  # fmt: skip
        near = self.search.find(placed, scene, around, HORIZON_S)
        if bases:
            near = self._on_moving_bases(near, bases)
        tube, room, needed, floor, which = kept(
            near.rows, error, near.gap, near.promise,
            _STILL if still
            else self._nearer(near, scene, bases, [LATENCY * self._period_s, HORIZON_S]),
            self._margin, self._between,
        )  # fmt: skip
        levels = self._floors(near, floor, which, scene, levels)
        if not still and not bases and scene is not None:
            stands = standing(near, scene)
            soon = self._nearer(near, scene, bases, [LATENCY * self._period_s])[0]
            near = near._replace(speed=np.where(stands, 0.0, near.speed))
            room = np.where(stands, room + soon, room)
            floor = np.where(stands, np.minimum(floor, needed), floor)
        return NearGaps(scene, bases, still, lever, around, near, room, tube, needed, floor, levels)

    def violation(
        self, sight: NearGaps, duration_s: float, way: Array, postures: Postures
    ) -> float:
        """Return by how much the worst gap falls short along a stop [m]; 0 where all are kept.

        `way` (n,) [rad] bounds how far joints go from where they are; `postures` gives them.
        """
        if self.capsules.forest.gear is not None:
            way = self.capsules.forest.gear * way
        return self._short(sight, duration_s, way, postures)

    def _short(self, sight: NearGaps, duration_s: float, way: Array, postures: Postures) -> float:
        """Return the shortfall, given how far at most the joints turn what they move (n,) [rad]."""
        near, most = sight.near, sight.needed
        if not sight.still:
            end_s = duration_s + (1.0 + LATENCY) * self._period_s
            most = most + self._nearer(near, sight.scene, sight.bases, [end_s])[0]
        leaves, pairs, closer = doubtful(sight.lever, way, sight.around, near[:2], near.gap, most)
        if leaves:
            sight = self._farther(sight, travel(sight.lever, way))
            return self._short(sight, duration_s, way, postures)
        if not len(pairs):
            return 0.0
        return self._sampled(sight, pairs, closer, duration_s, postures)

    def _farther(self, sight: NearGaps, way: Array) -> NearGaps:
        """Return a sight that reaches as far as a stop may lead: the first one did not."""
        around = way + BESIDE + self._margin
        near = self.search.find(sight.near.placed, sight.scene, around, HORIZON_S)
        if sight.bases:
            near = self._on_moving_bases(near, sight.bases)
        tube, nearer = np.full(near.size, float(sight.tube.max(initial=0.0))), _STILL
        if not sight.still:
            nearer = self._nearer(near, sight.scene, sight.bases, [HORIZON_S])
        needed, floor, which = held(tube, near.gap, near.promise, nearer, self._between)
        self._floors(near, floor, which, sight.scene, sight.levels)
        if not sight.still and not sight.bases and sight.scene is not None:
            stands = standing(near, sight.scene)
            floor = np.where(stands, np.minimum(floor, needed), floor)
        return sight._replace(around=way, near=near, tube=tube, needed=needed, floor=floor)

    def _sampled(
        self, sight: NearGaps, pairs: Index, closer: Array, duration_s: float, postures: Postures
    ) -> float:
        """Return how short pairs (p,) fall of what they need [m], looked at along a stop.

        Each may come `closer` (p,) [m] at most.
        """
        near, scene, bases = sight.near, sight.scene, sight.bases
        farthest = max(closer.tolist())
        count = max(math.ceil(duration_s / SAMPLE_S), math.ceil(farthest / SAMPLE_M), 1)
        count = min(count, SAMPLES)
        times, nearer = (duration_s / count) * _LOOKS[: count + 1], _STILL
        if not sight.still:
            nearer = self._nearer(near, scene, bases, times + (1.0 + LATENCY) * self._period_s)
        bounds = wanted(
            count, pairs, closer, sight.needed, near.promise, near.radii, sight.floor, nearer
        )
        ends = self.capsules.place(postures(times), _poses(bases)).ends
        return self.search.violation(ends, near, pairs, bounds, scene)

    def _nearer(
        self, near: NearPairs, scene: Scene | None, bases: Bases, ahead_s: Sequence[float] | Array
    ) -> Array:
        """Return how much nearer pairs may be than now (s, k) [m], some times (s,) [s] from now.

        By what moves in the scene, and with a Base.
        """
        ahead = np.asarray(ahead_s)
        if scene is not None and scene.moves:
            found = scene.growth(near.obstacle, ahead)
        else:
            found = np.zeros((len(ahead), near.size))
        return found + near.carried * ahead[:, None] if bases else found

    def _on_moving_bases(self, near: NearPairs, bases: Bases) -> NearPairs:
        """Return pairs with the speed at which Bases that move bring links to what is near."""
        root, link = self._root, near.obstacle < 0
        second = np.where(link, root[np.where(link, near.second, 0)], -1)
        places, twists = zip(*[(base.T.p, base.twist) for base in bases], strict=True)
        speed, fastest = carried(
            near.near[:], root[near.first], second, near.speed, np.array(places), np.array(twists)
        )
        return near._replace(speed=speed, carried=fastest)

    def _floors(
        self, near: NearPairs, floor: Array, held: Index, scene: Scene | None, levels: Levels
    ) -> Levels:
        """Set what gaps that are `held` must keep at least, and return the levels to remember.

        A gap that was below its bound to begin with can only get better: it keeps the best it has
        had. So does that of what may move and stands; while it comes nearer, the gap keeps what
        it is now.
        """
        kept: Levels = {}
        for i in held.tolist():
            key, gap, speed = self._key(near, i, scene), float(near.gap[i]), float(near.speed[i])
            level, movable, comes = levels.get(key), speed > 0.0, False
            if movable and scene is not None and near.obstacle[i] >= 0:
                comes = speed > float(scene.speed[near.obstacle[i]]) + COMES
            if level is None or comes or gap < level - (SLACK if movable else 2.0 * SLACK):
                level = gap + SLACK - CREEP if movable else gap
            kept[key] = max(level, gap)
            floor[i] = min(kept[key] - SLACK, gap)
        return kept

    def _key(self, near: NearPairs, i: int, scene: Scene | None) -> tuple[int, int, str]:
        first, obstacle = int(near.first[i]), int(near.obstacle[i])
        if scene is None or obstacle < 0:
            return (first, int(near.second[i]), "")
        return (first, -1, scene.names[obstacle])


def _poses(bases: Bases) -> list[Pose] | None:
    """Return where Bases are; None where all stand."""
    return [base.T for base in bases] if bases else None


# --- Collision barriers of one tick: links against obstacles and each other, and the workspace ----
#
# One look serves both the barriers of the tick and the judgement of the stops that it
# considers.

NAMED = 3
"""Number of acting barriers that are named [1]."""

COMMANDED = 1e-4
"""A tool that is to go at more than this was told to [m/s, rad/s]."""


class ProximityQuery(NamedTuple):
    """Near pairs and barriers of one tick."""

    arms: Sequence[ArmTick]
    q: Array
    """The commanded joints (n,), of all arms."""
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


class CollisionConstraint:
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
        counts = [len(part.joints) for part in cell.parts]
        self._arm, self._parts = _arm_of(self.capsules.moves, counts), parts_of(counts)
        self._near_distance, self._near_speed = avoidance.near_distance, avoidance.near_speed
        self._clearance, self._speed = avoidance.clearance, cell.config.limits.speed
        self._tools = tuple(self.capsules.body == w.body for w in self.walls)

    def watch(
        self,
        arms: Sequence[ArmTick],
        motion: Motion,
        levels: Levels,
        bases: Bases,
        asked: Array,
    ) -> ProximityQuery:
        """Return what is around the arms, if joints are to go at `asked` (n,) [rad/s].

        `motion` is that of all commanded joints (n,), `levels` are the best gaps so far of pairs
        that are below their bounds, `bases` those of all arms where any may move.
        """
        clearance, (q, dq, _), first = self.clearance, motion, arms[0]
        factor = first.inputs.settings.speed_factor
        fastest, speeds, rates = np.empty(len(asked)), [], []
        for arm, part in zip(arms, self._parts, strict=True):
            J, joints = arm.tool_jacobian(part)
            own = np.empty(J.shape[1])
            speed, rate = _ask(J, asked[joints], dq[joints], own)
            fastest[joints] = own
            speeds.append(speed)
            rates.append(rate)
        sight = clearance.look(
            q, fastest, joined([arm.error for arm in arms]), first.inputs.scene, factor,
            levels, bases, first.placed,
        )  # fmt: skip
        # Only an arm that is to move is led out of a bound; self-motion alone is no order.
        widen = any(
            a.motion_commanded and rate > COMMANDED for a, rate in zip(arms, rates, strict=True)
        )
        coming = sight.near.approach
        if np.count_nonzero(coming):
            shares = np.array([arm.stance.makes_way for arm in arms])
            coming = shares[self._arm[sight.near.first]] * coming
            coming = np.minimum(coming, factor * self._speed)
        gaps, room, closing = sight.near.rows, sight.room, (sight.near.speed, coming)
        rows = []
        for arm, part, walls in zip(arms, self._parts, self.walls, strict=True):
            tool = _whole(*arm.tool_jacobian(part), len(q))
            walled = walls.around(tool, arm.kinematics.T_world_mrf.p)
            rows.append(clearance.braking.rows(gaps, room, closing, walled, factor, widen))
            gaps, room, closing = gaps[:0], room[:0], (coming[:0], coming[:0])
        return ProximityQuery(arms, q, sight, Rows.of_all(rows), tuple(speeds), coming)

    def makes_way(self, watch: ProximityQuery) -> list[bool]:
        """Return which arms are to go out of the way of something that comes."""
        near, found = watch.sight.near, [False] * len(watch.arms)
        if np.count_nonzero(watch.coming):
            for i in np.flatnonzero((watch.coming > 0.0) & (watch.rows.low[: near.size] > 0.0)):
                found[self._arm[near.first[i]]] = True
        return found

    def tool_shares(self, watch: ProximityQuery) -> list[float]:
        """Return what share (0 to 1) of each tool's motion is slow enough beside things."""
        if self._near_speed is None:
            return [1.0] * len(watch.speeds)
        near, shares = watch.sight.near, []
        for tool, speed, arm in zip(self._tools, watch.speeds, watch.arms, strict=True):
            gap = _least_beside(near.gap, near.obstacle, near.first, tool)
            if gap == math.inf:
                shares.append(1.0)
                continue
            far = (gap - self._clearance) / (self._near_distance - self._clearance)
            bound = self._near_speed + min(1.0, max(0.0, far)) * (self._speed - self._near_speed)
            shares.append(min(1.0, arm.inputs.pace * bound / max(speed, 1e-12)))
        return shares

    def slowed_to_limit(self, watch: ProximityQuery, dq: Array) -> Array:
        """Return rates dq (n,) at which no tool that makes way is faster than it may be."""
        share, factor = 1.0, watch.arms[0].inputs.settings.speed_factor
        for arm, part, asked in zip(watch.arms, self._parts, watch.speeds, strict=True):
            J, joints = arm.tool_jacobian(part)
            speed = float(np.linalg.norm(J[:3] @ dq[joints]))
            most = max(asked, factor * self._speed)
            share = min(share, most / max(speed, 1e-12))
        return dq if share >= 1.0 else share * dq

    def named(self, watch: ProximityQuery, broken: Flags) -> tuple[str, ...]:
        """Return the names of barriers that are flagged, the nearest first."""
        gaps = self.shown(watch, broken).gaps(NAMED, only_active=True)
        names = tuple(f"clearance:{gap.link}:{gap.other}" for gap in gaps)
        if np.count_nonzero(broken[watch.sight.near.size :]):
            names += ("workspace",)
        return names

    def shown(self, watch: ProximityQuery, active: Flags) -> Shown:
        """Return the pairs for telemetry; `active` flags the barriers that act."""
        near, scene = watch.sight.near, watch.sight.scene
        return Shown(near, scene, self.capsules.links, active[: near.size])

    def violation(
        self, watch: ProximityQuery, duration_s: float, low: Array, high: Array, postures: Postures
    ) -> float:
        """Return by how much a stop breaks what is kept, at its worst place [m]; 0 for not."""
        q, bases = watch.q, watch.sight.bases
        way = np.maximum(high - q, q - low)
        short = self.clearance.violation(watch.sight, duration_s, way, postures)
        for arm, walls in zip(watch.arms, self.walls, strict=True):
            p = arm.kinematics.T_world_mrf.p
            if not walls.given or walls.far(p, arm.inputs.settings.T_wrist_mrf, way):
                continue
            times = np.linspace(0.0, duration_s, 1 + max(1, math.ceil(duration_s / 0.05)))
            mrf = arm.inputs.settings.T_wrist_mrf
            short = max(short, walls.violation(p, mrf, postures(times), _poses(bases)))
        return short


def _arm_of(moves: Flags, counts: Sequence[int]) -> Index:
    """Return which arm each capsule (c,) is part of; `moves` (c, n) tells which joints move it."""
    found, first = np.zeros(len(moves), dtype=np.int64), 0
    for arm, count in enumerate(counts):
        found[moves[:, first : first + count].any(axis=1)] = arm
        first += count
    return found


def _whole(own: Array, part: slice | Index, n: int) -> Array:
    """Return the Jacobian in all joints (6, n) of a tool that some of them move."""
    if own.shape[1] == n:
        return own
    J = np.zeros((6, n))
    J[:, part] = own
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
