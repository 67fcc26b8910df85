"""Rays of a scan as points in the odometry's frame, remembered, and the ground that was seen."""

import math
from collections import deque
from typing import Final, NamedTuple

import numpy as np

from ....config.load import Cell, ConfigError
from ....protocols.messages.telemetry import State
from ...control.compiled import (
    ARRAY3,
    COUNT,
    FLAGS,
    MARKS,
    MATRIX,
    NUMBER,
    ROW,
    STACK,
    TABLE,
    VECTOR,
    compiled,
    inner_kernel,
)
from ...control.proximity.capsules import Capsules
from ...control.scene import Flags
from ...control.spatial import Array, Pose

# --- Rays of one scan as points in the odometry's frame, each placed at its own instant -----------
#
# Between two instants at which the joints are known (knots) the scanner's pose is interpolated
# linearly, matrix by matrix: over one control period that is right to 0.1 mm at 2 m.
#
# Kernels; the rules are in `server/control/compiled.py`.


class Knots(NamedTuple):
    """Poses of the scanner, and the arm's capsules, at k instants; all in the odometry's frame."""

    time_s: Array
    """(k,) [s], rising."""
    R: Array
    """Attitude of the scanner (k, 3, 3): x straight ahead, z along the mirror's axis."""
    p: Array
    """Place of the mirror (k, 3) [m]."""
    ends: Array
    """Both ends of the c capsules (k, 2c, 3) [m]."""


def place(time_s: Array, angle: Array, distance: Array, knots: Knots) -> Array:
    """Return the points (n, 3) [m] of rays at instants (n,) [s]; NaN for rays without an echo.

    Angles (n,) [rad] count from the scanner's right, about z; π/2 is straight ahead.
    """
    points = np.empty((len(time_s), 3))
    _place(time_s, angle, distance, knots.time_s, knots.R, knots.p, points)
    return points


def own_rays(time_s: Array, points: Array, knots: Knots, reach: Array) -> Flags:
    """Return which of n points lie on the arm itself (n,) [bool].

    `reach` (c,) [m] is the radius of each capsule, grown by the margin within which a point cannot
    be told from the arm.
    """
    own = np.zeros(len(time_s), dtype=np.bool_)
    _own(time_s, points, knots.time_s, knots.ends, reach, own)
    return own


@inner_kernel
def _between(time_s: float, knot_s: Array, k: int) -> tuple[int, int, float]:
    """Return the knots before and behind an instant, from knot k on, and its share of the way."""
    last = knot_s.shape[0] - 1
    while k < last - 1 and time_s > knot_s[k + 1]:
        k += 1
    n = min(k + 1, last)
    span = knot_s[n] - knot_s[k]
    return k, n, 0.0 if span <= 0.0 else (time_s - knot_s[k]) / span


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, ARRAY3, MATRIX, TABLE)
def _place(
    time_s: Array,
    angle: Array,
    distance: Array,
    knot_s: Array,
    R: Array,
    p: Array,
    points: Array,
) -> None:
    k = 0
    for i in range(time_s.shape[0]):
        k, n, t = _between(time_s[i], knot_s, k)
        x, y = distance[i] * np.sin(angle[i]), -distance[i] * np.cos(angle[i])
        for a in range(3):
            rx = R[k, a, 0] + t * (R[n, a, 0] - R[k, a, 0])
            ry = R[k, a, 1] + t * (R[n, a, 1] - R[k, a, 1])
            points[i, a] = p[k, a] + t * (p[n, a] - p[k, a]) + rx * x + ry * y


@compiled(VECTOR, MATRIX, VECTOR, ARRAY3, VECTOR, MARKS)
def _own(
    time_s: Array, points: Array, knot_s: Array, ends: Array, reach: Array, own: Flags
) -> None:
    k = 0
    for i in range(time_s.shape[0]):
        k, n, t = _between(time_s[i], knot_s, k)
        for c in range(reach.shape[0]):
            along, length, off = 0.0, 0.0, 0.0
            for a in range(3):
                start = ends[k, 2 * c, a] + t * (ends[n, 2 * c, a] - ends[k, 2 * c, a])
                end = ends[k, 2 * c + 1, a] + t * (ends[n, 2 * c + 1, a] - ends[k, 2 * c + 1, a])
                along += (points[i, a] - start) * (end - start)
                length += (end - start) * (end - start)
            share = 0.0 if length <= 0.0 else min(1.0, max(0.0, along / length))
            for a in range(3):
                start = ends[k, 2 * c, a] + t * (ends[n, 2 * c, a] - ends[k, 2 * c, a])
                end = ends[k, 2 * c + 1, a] + t * (ends[n, 2 * c + 1, a] - ends[k, 2 * c + 1, a])
                way = points[i, a] - start - share * (end - start)
                off += way * way
            if off <= reach[c] * reach[c]:
                own[i] = True
                break


def bridged(angle: Array, distance: Array, own: Flags) -> Array:
    """Return distances (n,) [m] of a scan in which gaps of own rays are bridged; NaN where not.

    A straight line, the least squares of distances *from* it, goes through three neighbours on each
    side of a gap. It is refused where one of them is off by more than `STRAIGHT`, where a neighbour
    has no echo, and where a gap is wider than `WIDEST` (Zhang, section 3: figures 9 and 10).
    """
    found = distance.copy()
    found[own] = np.nan
    _bridge(angle, found.copy(), own, found)
    return found


BESIDE = 3
"""Neighbours of a gap, on each side, that a line goes through [1]."""
STRAIGHT = 0.04
"""A neighbour may be off the line by so much [m]."""
WIDEST = 1.0
"""A gap is at most so wide [m]."""


@compiled(VECTOR, VECTOR, FLAGS, ROW)
def _bridge(angle: Array, distance: Array, own: Flags, found: Array) -> None:
    n, i = distance.shape[0], 0
    while i < n:
        if not own[i]:
            i += 1
            continue
        first = i
        while i < n and own[i]:
            i += 1
        if first < BESIDE or i + BESIDE > n:
            continue
        mx, my, whole = 0.0, 0.0, True
        for j in range(2 * BESIDE):
            r = first - BESIDE + j if j < BESIDE else i + j - BESIDE
            whole = whole and not own[r] and not np.isnan(distance[r])
            mx += distance[r] * np.cos(angle[r]) / (2 * BESIDE)
            my += distance[r] * np.sin(angle[r]) / (2 * BESIDE)
        if not whole:
            continue
        xx, xy, yy = 0.0, 0.0, 0.0
        for j in range(2 * BESIDE):
            r = first - BESIDE + j if j < BESIDE else i + j - BESIDE
            x, y = distance[r] * np.cos(angle[r]) - mx, distance[r] * np.sin(angle[r]) - my
            xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
        turn = 0.5 * np.arctan2(2.0 * xy, xx - yy)  # of the line of least squares
        nx, ny = -np.sin(turn), np.cos(turn)
        c, worst = nx * mx + ny * my, 0.0
        for j in range(2 * BESIDE):
            r = first - BESIDE + j if j < BESIDE else i + j - BESIDE
            x, y = distance[r] * np.cos(angle[r]), distance[r] * np.sin(angle[r])
            worst = max(worst, abs(nx * x + ny * y - c))
        a, b = first - 1, i
        wx = distance[a] * np.cos(angle[a]) - distance[b] * np.cos(angle[b])
        wy = distance[a] * np.sin(angle[a]) - distance[b] * np.sin(angle[b])
        if worst > STRAIGHT or wx * wx + wy * wy > WIDEST * WIDEST:
            continue
        for r in range(first, i):
            onto = nx * np.cos(angle[r]) + ny * np.sin(angle[r])
            if abs(onto) > 1e-6 and c / onto > 0.0:
                found[r] = c / onto


# --- Where scanner and arm are at the instants that telemetry tells of, in the odometry's frame ---

KEPT: Final = 200
"""Newest instants that are kept [1]: 2 s."""


class MeasuredInstant(NamedTuple):
    """Where everything was measured at one telemetry tick."""

    tick: int
    time_s: float
    """The daemon's time [s]."""
    q: Array
    """Joints of the cell (n,) [rad], those of the mechanism with the scanner first."""
    T_world_base: Pose
    """Base by the odometry."""


def instant_of(state: State, home: Pose) -> MeasuredInstant:
    """Return what a tick's telemetry tells; Base stands at `home` where it does not move."""
    told, T = state.frames.get("base"), home
    if told is not None:
        T = Pose.from_xyz_rpy(told[:3], told[3:])
    return MeasuredInstant(state.tick, state.time_s, np.array(state.q), T)


class Ring:
    """The newest instants, in turn."""

    def __init__(self) -> None:
        self._each: deque[MeasuredInstant] = deque(maxlen=KEPT)

    def add(self, instant: MeasuredInstant) -> None:
        """Take in an instant; one that is not newer is ignored, unless time starts again."""
        newest = self.newest
        if newest is not None and instant.tick < newest.tick - KEPT:
            self._each.clear()
        elif newest is not None and instant.time_s <= newest.time_s:
            return
        self._each.append(instant)

    @property
    def newest(self) -> MeasuredInstant | None:
        """The newest instant; None before the first."""
        return self._each[-1] if self._each else None

    def around(self, first_s: float, last_s: float) -> list[MeasuredInstant]:
        """Return the instants from the last before a span of time to the first behind it.

        Fewer than two where the span is not covered.
        """
        if not self._each or self._each[0].time_s > first_s or self._each[-1].time_s < last_s:
            return []
        found: list[MeasuredInstant] = []
        for instant in reversed(self._each):
            if instant.time_s >= last_s:
                found = []
            found.append(instant)
            if instant.time_s <= first_s:
                break
        return found[::-1]


class ScannerGeometry:
    """The scanner of a cell's first mechanism, and the capsules of all: none is an obstacle."""

    def __init__(self, cell: Cell) -> None:
        """Read them. Raises `ConfigError` for a cell without a scanner, or an unknown link."""
        scanner = cell.config.scanner
        if scanner is None:
            raise ConfigError(f"{cell.path}: scanner: the cell has none")
        self._capsules = Capsules(cell)
        self._forest = self._capsules.forest
        try:
            self._body, T = self._forest.body_of(cell.prefix + scanner.link)
        except KeyError:
            raise ConfigError(
                f"{cell.path}: scanner.link: value '{scanner.link}': no such link in "
                f"{cell.robot.urdf}"
            ) from None
        place = scanner.T_link_scanner
        self._T_body_scanner = T @ Pose.from_xyz_rpy(place.xyz, place.rpy)
        # What the scanner sits on is in nobody's way, and its rays begin inside of it.
        self._others = self._capsules.body != self._body
        self.reach = self._capsules.radius[self._others] + scanner.self_margin
        """Radii of the capsules, grown by the margin (c,) [m]."""
        roots = [self._forest.root(body) for body in self._capsules.body[self._others].tolist()]
        self._beside = np.repeat(np.array(roots) != 0, 2)
        """Which ends of capsules (2c,) are of other mechanisms: those stand in World."""
        self.home, *self._bases = self._forest.bases
        """Where the cell has Base in World."""

    def knots(self, instants: list[MeasuredInstant]) -> Knots:
        """Return poses and capsules at some instants."""
        q = np.array([instant.q for instant in instants])
        placed = self._capsules.place(q, [Pose.identity(), *self._bases])
        ends = placed.ends[:, self._others].reshape(len(q), -1, 3)
        R = np.broadcast_to(self._T_body_scanner.R, (len(q), 3, 3))
        p = np.broadcast_to(self._T_body_scanner.p, (len(q), 3))
        if self._body > 0:
            frames = placed.frames[:, self._body - 1]
            R, p = (
                frames[:, :, :3] @ R,
                np.einsum("kij,kj->ki", frames[:, :, :3], p) + frames[:, :, 3],
            )
        R_base = np.array([instant.T_world_base.R for instant in instants])
        p_base = np.array([instant.T_world_base.p for instant in instants])
        there = np.einsum("kij,kcj->kci", R_base, ends) + p_base[:, None]
        there[:, self._beside] = ends[:, self._beside]
        return Knots(
            np.array([instant.time_s for instant in instants]),
            R_base @ R,
            np.einsum("kij,kj->ki", R_base, p) + p_base,
            there,
        )


# --- Memory of points, in the odometry's frame: what the moving arm hides, or the view has lost ---
#
# Points that fall into one voxel are one, with the number of times that it was hit. It forgets
# what the rays of later scans go through, and what has been passed.

VOXEL: Final = 0.0125
"""Side of a voxel [m]: a quarter of a cell."""
BEYOND: Final = 0.10
"""A ray that goes on so far behind a point went through it [m]: eight times the noise."""
LEAST: Final = 0.4
"""A cell that rays went through until fewer hits are left is forgotten [1]."""
MOST_HITS: Final = 250.0
"""No point counts for more [1]."""
_BITS: Final = 20
_MIDDLE: Final = 1 << (_BITS - 1)


class PointMemory:
    """Points (n, 3) [m] in the odometry's frame, and how often each was hit (n,)."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Know nothing."""
        self.points: Array = np.empty((0, 3))
        self.hits: Array = np.empty(0)

    def add(self, points: Array) -> None:
        """Take in new points (n, 3); NaN is none."""
        points = points[~np.isnan(points[:, 0])]
        every = np.concatenate([self.points, points])
        hits = np.concatenate([self.hits, np.ones(len(points))])
        voxels = np.floor(every / VOXEL).astype(np.int64) + _MIDDLE
        keys = (voxels[:, 0] << 2 * _BITS) | (voxels[:, 1] << _BITS) | voxels[:, 2]
        _, place = np.unique(keys, return_inverse=True)
        count = np.bincount(place, hits)
        sums = [np.bincount(place, hits * axis) for axis in every.T]
        self.points = np.ascontiguousarray((np.stack(sums) / count).T)
        self.hits = np.minimum(count, MOST_HITS)

    def see_through(self, R: Array, p: Array, first: float, step: float, distance: Array) -> None:
        """Forget, by halves, what the rays of a scan go through.

        The scanner has attitude R (3, 3) and place p (3,); rays begin at angle `first`, one every
        `step` [rad]; their distances (n,) [m] are NaN where nothing can be told.
        """
        _see_through(self.points, R, p, first, step, distance, len(distance), self.hits)
        self._keep(self.hits >= LEAST)

    def pass_by(self, R: Array, p: Array, rear: float, far: float) -> None:
        """Forget what is behind `rear`, or further away than `far`, along x of a frame [m]."""
        ahead = (self.points - p) @ R[:, 0]
        self._keep((ahead > rear) & (np.abs(ahead) < far))

    def _keep(self, which: Flags) -> None:
        if not which.all():
            self.points, self.hits = self.points[which], self.hits[which]


@compiled(MATRIX, MATRIX, VECTOR, NUMBER, NUMBER, VECTOR, COUNT, ROW)
def _see_through(
    points: Array,
    R: Array,
    p: Array,
    first: float,
    step: float,
    distance: Array,
    n: int,
    hits: Array,
) -> None:
    for k in range(points.shape[0]):
        wx, wy, wz = points[k, 0] - p[0], points[k, 1] - p[1], points[k, 2] - p[2]
        z = R[0, 2] * wx + R[1, 2] * wy + R[2, 2] * wz
        far = np.sqrt(wx * wx + wy * wy + wz * wz)
        if abs(z) > step * far:  # not in the plane of this scan
            continue
        x = R[0, 0] * wx + R[1, 0] * wy + R[2, 0] * wz
        y = R[0, 1] * wx + R[1, 1] * wy + R[2, 1] * wz
        ray = int(np.floor((np.arctan2(x, -y) - first) / step + 0.5))
        if ray < 1 or ray >= n - 1:
            continue
        # All three rays beside it have to go on: at an edge, one does that misses it.
        through = True
        for i in range(ray - 1, ray + 2):
            through = through and distance[i] > far + BEYOND
        if through:
            hits[k] *= 0.5


# --- Ground that was seen: how far back a base may be driven at speed, where no scanner looks -----
#
# Columns of the odometry's frame remember at which heights rays went through them, or ended in
# them, and where the base itself has been. Ground that nobody saw, or long ago, counts as
# taken.

CELL: Final = 0.1
"""Side of a column, and height of one of its bands [m]."""
BANDS: Final = 12
"""Bands of a column, from `LOWEST` up [1]."""
LOWEST: Final = 0.05
"""What is lower is the floor [m]."""
SIDE: Final = 128
"""Columns along a side; farther on they are used anew [1]."""
FARTHEST: Final = 3.0
"""Rays are followed so far [m]."""
BEFORE_HIT: Final = 0.1
"""A ray says nothing of the last piece before its echo [m]."""
SEEN_S: Final = 60.0
"""Ground is known for so long after it was seen [s]."""
TAKEN: Final = 1.0
"""Echoes that are left of a band in which something stands [1]."""
LOOKS_BACK: Final = 2.0
"""Ground is looked at so far behind the base [m]."""
BESIDE_BASE: Final = 0.05
"""And so far beside it [m]."""
STAND_OFF: Final = 0.15
"""The base is slow so far before it [m]."""


class GroundBehind:
    """What is known of the ground around a base of a width, `rear` behind its axle [m]."""

    def __init__(self, width: float, rear: float, height: float) -> None:
        """Build it; the base itself is as high as `height` [m], with its arm above that."""
        half = 0.5 * width + BESIDE_BASE
        across = np.linspace(-half, half, 1 + math.ceil(4.0 * half / CELL))
        back = np.arange(0.0, LOOKS_BACK, 0.5 * CELL)
        self._back = back
        self._behind = _grid(-rear - back, across)
        own = np.linspace(-rear, rear, 1 + math.ceil(4.0 * rear / CELL))
        self._own = _grid(own, across).reshape(-1, 3)
        self._own_bands = min(BANDS, math.ceil((height - LOWEST) / CELL))
        self.forget()

    def forget(self) -> None:
        """Know nothing."""
        self._seen_s = np.full((SIDE, SIDE, BANDS), -np.inf)
        self._echoes = np.zeros((SIDE, SIDE, BANDS))
        self._place = np.full((SIDE, 2 * SIDE), np.nan)

    def see(self, p: Array, ends: Array, echo: Flags, own: Flags, time_s: float) -> None:
        """Take in rays from p (3,) to their ends (n, 3) [m], in the odometry's frame.

        `echo` (n,) tells those that end on something; the arm's `own` (n,) tell nothing.
        """
        tables = self._seen_s, self._echoes, self._place
        _follow(p, ends, echo, own, time_s, *tables)

    def stand(self, T_world_base: Pose, time_s: float) -> None:
        """Take in where the base stands: there nothing else does."""
        at = _places(T_world_base, self._own)
        i, j = self._columns(at)
        self._seen_s[i, j] = time_s
        self._echoes[i, j, : self._own_bands] = 0.0

    def room(self, T_world_base: Pose, time_s: float) -> float:
        """Return how far the base may go straight back over ground that was seen [m]."""
        i, j = self._columns(_places(T_world_base, self._behind.reshape(-1, 3)))
        known = (self._seen_s[i, j] >= time_s - SEEN_S).all(axis=1)
        free = known & (self._echoes[i, j] < TAKEN).all(axis=1)
        rows = free.reshape(self._behind.shape[:2]).all(axis=1)
        taken = np.flatnonzero(~rows)
        far = LOOKS_BACK if not len(taken) else float(self._back[taken[0]])
        return max(0.0, far - STAND_OFF)

    def _columns(self, at: Array) -> tuple[Array, Array]:
        """Return the columns (k,), (k,) at places (k, 3); those of another place know nothing."""
        cells = np.floor(at[:, :2] / CELL).astype(np.int64)
        i, j = (cells % SIDE).T
        other = (self._place[i, 2 * j] != cells[:, 0]) | (self._place[i, 2 * j + 1] != cells[:, 1])
        if other.any():
            i_new, j_new = i[other], j[other]
            self._seen_s[i_new, j_new], self._echoes[i_new, j_new] = -np.inf, 0.0
            self._place[i_new, 2 * j_new], self._place[i_new, 2 * j_new + 1] = cells[other].T
        return i, j


def _grid(x: Array, y: Array) -> Array:
    """Return points (x, y, 3) on the floor."""
    found = np.zeros((len(x), len(y), 3))
    found[..., 0], found[..., 1] = x[:, None], y
    return found


def _places(T: Pose, points: Array) -> Array:
    found: Array = points @ T.R.T + T.p
    return found


@compiled(VECTOR, MATRIX, FLAGS, FLAGS, NUMBER, STACK, STACK, TABLE)
def _follow(
    p: Array,
    ends: Array,
    echo: Flags,
    own: Flags,
    time_s: float,
    seen_s: Array,
    echoes: Array,
    place: Array,
) -> None:
    side, bands = seen_s.shape[0], seen_s.shape[2]
    for k in range(ends.shape[0]):
        if own[k] or np.isnan(ends[k, 0]):
            continue
        x, y, z = ends[k, 0] - p[0], ends[k, 1] - p[1], ends[k, 2] - p[2]
        length = np.sqrt(x * x + y * y + z * z)
        if length <= 0.0:
            continue
        most = min(FARTHEST, length - BEFORE_HIT if echo[k] else length)
        steps = int(most / (0.5 * CELL))
        for s in range(steps + 1):
            ends_here = s == steps
            if ends_here and (not echo[k] or length > FARTHEST):
                continue
            t = 1.0 if ends_here else s * 0.5 * CELL / length
            band = int(np.floor((p[2] + t * z - LOWEST) / CELL))
            if band < 0 or band >= bands:
                continue
            a, b = np.floor((p[0] + t * x) / CELL), np.floor((p[1] + t * y) / CELL)
            i, j = int(a) % side, int(b) % side
            if place[i, 2 * j] != a or place[i, 2 * j + 1] != b:
                place[i, 2 * j], place[i, 2 * j + 1] = a, b
                for c in range(bands):
                    seen_s[i, j, c], echoes[i, j, c] = -np.inf, 0.0
            seen_s[i, j, band] = time_s
            if ends_here:
                echoes[i, j, band] = min(5.0, echoes[i, j, band] + 1.0)
            else:
                echoes[i, j, band] *= 0.9
