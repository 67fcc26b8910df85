"""Slip: what the wheels say against what scans see, in the plane of the floor. Bounded in time.

Each scan is matched with a map of what stands upright: cells hold the mean and the covariance of
the points that fell into them lately (a normal distributions transform), and a point is held
against its cell's line only where the points there lie on one. Along a direction that the lines do
not fix, as ahead in a bare corridor, the match says nothing, and the wheels are believed.

The map's frame moves with the wheels between scans, not with the odometry: news that corrects the
odometry is no motion.
"""

import math
from collections import deque
from itertools import starmap
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from ....config.load import Cell
from ...control.compiled import (
    MATRIX,
    NUMBER,
    ROW,
    STACK,
    TABLE,
    VECTOR,
    compiled,
)
from ...control.spatial import Array, Pose
from ...control.wheels import DifferentialDrive, Rolled
from .placing import MeasuredInstant

CELL: Final = 0.2
"""Side of a cell of the map [m]."""
BAND: Final = 0.25
"""Height of one [m]."""
BANDS: Final = 10
"""Cells above one another [1]."""
LOWEST: Final = 0.1
"""What is lower is the floor [m]."""
SIDE: Final = 128
"""Cells along a side; farther on they are used anew [1]."""
FARTHEST: Final = 10.0
"""Points farther away are not matched [m]."""
EVERY: Final = 2
"""One ray of so many is matched [1]."""
ROUNDS: Final = 3
"""Gauss-Newton steps for a scan [1]."""
CAPTURE: Final = 0.12
"""A point farther off its cell's line is another thing's [m]: Tukey's bound."""
STRAIGHT: Final = 0.03
"""Points of a cell lie on a line when they are off it by no more, as standard deviation [m]."""
SPREAD: Final = 0.02
"""And along it by no less [m]."""
LEVEL: Final = 0.1
"""A ray that goes up or down by no more of its way meets what stands upright [1]."""
UPRIGHT: Final = 0.03
"""So does one that ends on a cell's line whose points differ in height by more, as standard
deviation [m] ...
"""
LEANS: Final = 0.1
"""... and are off the line by no more, for each metre that they are higher [1]."""
LEAST_HITS: Final = 6.0
"""A cell with fewer points has no line [1]."""
MOST_HITS: Final = 60.0
"""No cell counts for more: so it forgets, and follows what it sees [1]."""
FORGOTTEN_S: Final = 8.0
"""Nor does one know of what it saw longer ago [s]."""
SIGMA: Final = 0.03
"""How far a point may be off its line: noise, tilt and the map's own error [m]."""
LEAST_POINTS: Final = 8.0
"""A direction counts as seen when it is fixed as well as by so many points across it [1]."""
LEAST_SHARE: Final = 0.05
"""And by this share of all points that were matched [1]: lines wobble by some degrees."""
DRIFT: Final = 0.5
"""A wheel slips at most so fast [m/s]."""
OFF: Final = 0.015
"""A match is this far off at most, beside [m]: what pulls farther is another thing's line."""
MOVES: Final = 0.005
"""Wheels that rolled by less in `LOOKS_S` stand [m]."""
LOOKS_S: Final = (0.5, 1.0, 2.0)
"""Spans of time over which wheels and scans are compared [s]."""
LASTS: Final = 5
"""So many scans at either end of that time have to agree [1]."""
LEAST_LOST: Final = 0.3
"""Wheels slip where this share of their way is missing, or more [1]."""
COLUMNS: Final = 6
"""What is matched stands in at least so many columns [1] ..."""
EXTENT: Final = 1.0
"""... which are so far apart [m]: somebody who walks along is narrower."""
STOOD_S: Final = 0.5
"""A slip is over when wheels and odometry have stood for so long [s]."""
TOLD: Final = 5e-3
"""Less is not told of [m, and rad a metre away]."""
SLIDES: Final = 0.02
"""A base that came so far while its wheels stood slides on [m]."""
LOST_M: Final = 0.2
"""How far the match may be off at most, where nothing was seen for long [m]."""
STEP: Final = 0.05
"""Where nothing told how far the base came, it is looked for in steps of that way [m] ..."""
MOST_STEPS: Final = 20
"""... of which there are no more [1] ..."""
UNFIXED_S: Final = 3.0
"""... if that was so for no longer [s] ..."""
GAIN: Final = (15.0, 0.15)
"""... and believed to have stayed behind if so many more points fit, and such a share [1]."""
CORRECTS: Final = 1e-4
"""Odometry that moved so much more than the wheels, from scan to scan, is being corrected [m]."""


class Slide(NamedTuple):
    """A motion of Base that its wheels know nothing of, in Base's own frame."""

    x: float
    """[m]"""
    y: float
    """[m]"""
    yaw: float
    """[rad]"""


class _Compared(NamedTuple):
    """Wheels and scans at one instant."""

    time_s: float
    rolled: Rolled
    """Base by its wheels alone."""
    matched: Array
    """Base by the scans: x, y [m] and yaw [rad]."""
    seen: Array
    """Base by the odometry that the daemon corrects."""
    fixed: bool
    """The scan told in all directions where Base is."""


class SlipMonitor:
    """Compares the way that a base's wheels rolled with the way that it came, by the scans."""

    def __init__(self, rolling: DifferentialDrive, least: float, fastest: float) -> None:
        """Build it: wheels that lose more than `least` [m] slip; `fastest` bounds them [rad/s]."""
        self._rolling, self._least, self._fastest = rolling, least, fastest
        self.slipping = False
        """Wheels slip, or did a moment ago; the odometry is wrong by what is still untold."""
        self.forget()

    @classmethod
    def from_cell(cls, cell: Cell) -> Self | None:
        """Return that of a cell; None for an arm that does not roll."""
        base, rolling = cell.config.mechanism.base, DifferentialDrive.from_cell(cell)
        if base is None or rolling is None:
            return None
        wheels = (base.wheels.left, base.wheels.right)
        fastest = max(d.max_velocity for d in cell.config.mechanism.drives if d.joint in wheels)
        return cls(rolling, base.slip[0], fastest)

    def forget(self) -> None:
        """Know nothing: no map, and no way."""
        self._map = np.zeros((SIDE, SIDE, BANDS * FIELDS))
        self._used_s = np.full((SIDE, SIDE), -np.inf)
        self._past = deque[_Compared]()
        self._eye = np.zeros(3)
        self._spread = np.eye(3) * SIGMA**2
        self._fixed: _Compared | None = None
        """Where scans told last in all directions where the base is."""
        self._moved_s = self._corrected_s = -math.inf

    def see(self, points: Array, eye: Array, now: MeasuredInstant) -> None:
        """Take in one scan's points (n, 3) in the odometry's frame, NaN for none or the arm's own.

        They were placed by the odometry at their own instants; `now` is the newest of these. `eye`
        (3,) is where the scanner was [m].
        """
        wheels, before = now.q[:2], self._past[-1] if self._past else None
        if before is not None and not self._follows(before, now):
            self.forget()
            before = None
        T = now.T_world_base
        if before is None:
            rolled = Rolled.at(Pose.identity(), wheels)
            place, dt = np.zeros(3), 0.0
        else:
            rolled, dt = self._rolling.roll(before.rolled, wheels), now.time_s - before.time_s
            place = _carried(before.matched, _way(_flat(before.rolled), _flat(rolled)))
            if np.abs(wheels - before.rolled.wheels).max() * self._rolling.radius > MOVES * dt:
                self._moved_s = now.time_s
            corrected = _way(before.seen, _flat(T)) - _way(_flat(before.rolled), _flat(rolled))
            if np.abs(corrected).max() > CORRECTS:
                self._corrected_s = now.time_s
        spread = DRIFT * dt if now.time_s - self._moved_s < STOOD_S else TOLD
        self._spread = self._spread + np.eye(3) * spread**2
        self._spread *= min(1.0, LOST_M**2 / float(np.diag(self._spread).max()))
        seen = (points[::EVERY] - T.p) @ T.R
        self._eye = (eye - T.p) @ T.R
        place, fixed = self._match(seen, self._begun(seen, place, rolled, now.time_s), now.time_s)
        _add(seen, place, now.time_s, FORGOTTEN_S, MOST_HITS, self._map)
        found = _Compared(now.time_s, rolled, place, _flat(T), fixed)
        self._past.append(found)
        self._fixed = found if fixed else self._fixed
        while now.time_s - self._past[0].time_s > LOOKS_S[-1] and not self.slipping:
            self._past.popleft()

    def judge(self) -> Slide | None:
        """Return what of a slip was not told yet; None for nothing.

        Returns each piece once: then `slipping` tells whether there may be more to come.
        """
        if len(self._past) < 2:
            return None
        now = self._past[-1]
        stands = now.time_s - self._moved_s > STOOD_S
        if not self.slipping:
            found = None if stands or not self._wide(now.time_s) else self._slip()
            self.slipping = found is not None
        else:
            found = self._slid(self._past[0], now)
            if max(map(abs, found)) < (SLIDES if stands else TOLD):
                found = None
                self.slipping = not stands or now.time_s - self._corrected_s < STOOD_S
        if found is not None:
            self._past = deque([now])
        return found

    def _follows(self, before: _Compared, now: MeasuredInstant) -> bool:
        """Return whether an instant is soon behind another, and no count began anew between."""
        dt = now.time_s - before.time_s
        turned = float(np.abs(now.q[:2] - before.rolled.wheels).max())
        return 0.0 < dt < 1.0 and turned <= 2.0 * self._fastest * dt

    def _begun(self, seen: Array, place: Array, rolled: Rolled, time_s: float) -> Array:
        """Return where to begin to match points (n, 3): at `place` (3,), or as far as they fit.

        A scanner that sweeps looks away for a while, in which the base may have stayed behind.
        """
        last = self._fixed
        if last is None or time_s - last.time_s > UNFIXED_S:
            return place
        way = _way(_flat(last.rolled), _flat(rolled))
        steps = math.ceil(math.hypot(way[0], way[1]) / STEP)
        if not 1 < steps <= MOST_STEPS:
            return place
        behind = _way(_carried(last.matched, way), place)
        tried = [
            _carried(_carried(last.matched, way * share), behind)
            for share in np.arange(steps, -1, -1) / steps
        ]
        fit = [self._linearise(seen, at, time_s)[0] for at in tried]
        best = int(np.argmax(fit))
        return tried[best] if fit[best] > fit[0] + max(GAIN[0], GAIN[1] * fit[0]) else place

    def _linearise(self, seen: Array, place: Array, time_s: float) -> tuple[float, Array, Array]:
        """Return how many points (n, 3) fit at a place (3,), normal matrix and gradient of that."""
        normal, gradient = np.empty((3, 3)), np.empty(3)
        count = _linearise(
            seen,
            self._eye,
            place,
            time_s,
            FORGOTTEN_S,
            self._map,
            normal,
            gradient,
            self._used_s,
        )
        return count, normal, gradient

    def _match(self, seen: Array, place: Array, time_s: float) -> tuple[Array, bool]:
        """Return where Base is in the map (3,), by points (n, 3) in its frame, begun at `place`.

        And whether they tell that in all directions.
        """
        start, weight = place, np.linalg.inv(self._spread)
        normal = np.empty((3, 3))
        for _ in range(ROUNDS):
            count, normal, gradient = self._linearise(seen, place, time_s)
            # Turns are weighed a metre away: so all three are lengths. What no line fixes stays.
            value, axis = np.linalg.eigh(normal)
            known = axis[:, value > max(LEAST_POINTS, LEAST_SHARE * count)]
            fixed = known @ known.T
            if not known.size:
                return start, False
            normal = fixed @ normal @ fixed / SIGMA**2
            pull = fixed @ gradient / SIGMA**2 - weight @ (place - start)
            place = place + fixed @ np.linalg.solve(normal + weight, pull)
        unseen_s = math.inf if self._fixed is None else time_s - self._fixed.time_s
        if np.abs(place - start).max() > DRIFT * unseen_s + OFF:
            return start, False
        self._spread = np.linalg.inv(normal + weight)
        return place, known.shape[1] == len(start)

    def _slid(self, first: _Compared, now: _Compared) -> Slide:
        """Return the motion that leads from Base by its wheels to Base by the scans."""
        rolled = _way(_flat(first.rolled), _flat(now.rolled))
        return Slide(*_way(rolled, _way(first.matched, now.matched)).tolist())

    def _slip(self) -> Slide | None:
        """Return by how much wheels slipped; None where they do not, or nobody can tell."""
        now = self._past[-1]
        for look_s in LOOKS_S:
            seen = [c for c in self._past if c.fixed and now.time_s - c.time_s <= look_s]
            if not now.fixed or len(seen) < 2 * LASTS:
                continue
            # No single scan is an end: one may be matched wrong.
            pairs = list(zip(seen[:LASTS], seen[-LASTS:], strict=True))
            way, lost = (
                np.median(each, axis=0) for each in zip(*starmap(self._lost, pairs), strict=True)
            )
            if (np.abs(lost) > np.maximum(self._least, LEAST_LOST * np.abs(way).max())).any():
                return self._slid(self._past[0], now)
        return None

    def _lost(self, first: _Compared, now: _Compared) -> tuple[Array, Array]:
        """Return the way of both wheels (2,), and how much of it the base did not come [m]."""
        came = _way(first.matched, now.matched)
        way = self._rolling.radius * (now.rolled.wheels - first.rolled.wheels)
        across = 0.5 * self._rolling.track * came[2]
        return way, way - (came[0] + np.array([-across, across]))

    def _wide(self, time_s: float) -> bool:
        """Return whether what was matched lately is more than one thing that moves along."""
        i, j = np.nonzero(self._used_s > time_s - LOOKS_S[-1])
        if len(i) < COLUMNS:
            return False
        # Columns are used in turn: the widest gap around the ring is where none is.
        return max(_extent(i), _extent(j)) * CELL >= EXTENT


def _extent(places: NDArray[np.int64]) -> int:
    """Return how many places of a ring of `SIDE` some of them take up [1]."""
    every = np.unique(places)
    gaps = np.diff(np.append(every, every[0] + SIDE))
    return int(SIDE - gaps.max())


def _flat(T: Pose) -> Array:
    """Return x, y and yaw (3,) of a pose."""
    return np.array([T.p[0], T.p[1], math.atan2(T.R[1, 0], T.R[0, 0])])


def _way(a: Array, b: Array) -> Array:
    """Return where b (3,) is, seen from a (3,)."""
    c, s = math.cos(a[2]), math.sin(a[2])
    x, y = b[0] - a[0], b[1] - a[1]
    return np.array([c * x + s * y, c * y - s * x, math.remainder(b[2] - a[2], 2.0 * math.pi)])


def _carried(a: Array, way: Array) -> Array:
    """Return what is `way` (3,) from a (3,)."""
    c, s = math.cos(a[2]), math.sin(a[2])
    return np.array([a[0] + c * way[0] - s * way[1], a[1] + s * way[0] + c * way[1], a[2] + way[2]])


# --- the map ---------------------------------------------------------------------------------
# A cell's fields: hits, mean x and y, sums of squares xx, xy, yy about the mean, time of the last
# hit, the column's own numbers, by which it is known from another that is SIDE farther on, mean z,
# sums of products xz, yz, zz.
#
# The top of a step and the underside of a lintel have no line of their own: what a scan draws on
# them moves as the scanner turns or comes on, and looks like a wall that goes along. Only level
# rays cannot meet them; elsewhere a line is a wall's where it was met at different heights lately.
FIELDS: Final = 13
MOMENTS: Final = (1, 2, 3, 4, 5, 9, 10, 11, 12)
SQUARES: Final = (3, 4, 5, 10, 11, 12)


@compiled(MATRIX, VECTOR, NUMBER, NUMBER, NUMBER, STACK)
def _add(
    points: Array, place: Array, time_s: float, forgotten_s: float, most: float, cells: Array
) -> None:
    side, c, s = cells.shape[0], np.cos(place[2]), np.sin(place[2])
    for k in range(points.shape[0]):
        px, py, pz = points[k, 0], points[k, 1], points[k, 2]
        if np.isnan(px) or px * px + py * py > FARTHEST * FARTHEST:
            continue
        band = int(np.floor((pz - LOWEST) / BAND))
        if band < 0 or band >= BANDS:
            continue
        x, y = place[0] + c * px - s * py, place[1] + s * px + c * py
        a, b = np.floor(x / CELL), np.floor(y / CELL)
        i, j, f = int(a) % side, int(b) % side, band * FIELDS
        if cells[i, j, f + 7] != a or cells[i, j, f + 8] != b:
            cells[i, j, f] = 0.0
        if time_s - cells[i, j, f + 6] > forgotten_s:
            cells[i, j, f] = 0.0
        if cells[i, j, f] == 0.0:
            for e in MOMENTS:
                cells[i, j, f + e] = 0.0
        n = cells[i, j, f] + 1.0
        if n > most:  # older ones count for less
            for e in SQUARES:
                cells[i, j, f + e] *= (most - 1.0) / cells[i, j, f]
            n = most
        dx, dy, dz = x - cells[i, j, f + 1], y - cells[i, j, f + 2], pz - cells[i, j, f + 9]
        cells[i, j, f + 1] += dx / n
        cells[i, j, f + 2] += dy / n
        cells[i, j, f + 9] += dz / n
        keep = (n - 1.0) / n
        cells[i, j, f + 3] += keep * dx * dx
        cells[i, j, f + 4] += keep * dx * dy
        cells[i, j, f + 5] += keep * dy * dy
        cells[i, j, f + 10] += keep * dx * dz
        cells[i, j, f + 11] += keep * dy * dz
        cells[i, j, f + 12] += keep * dz * dz
        cells[i, j, f], cells[i, j, f + 6] = n, time_s
        cells[i, j, f + 7], cells[i, j, f + 8] = a, b


@compiled(MATRIX, VECTOR, VECTOR, NUMBER, NUMBER, STACK, TABLE, ROW, TABLE)
def _linearise(
    points: Array,
    eye: Array,
    place: Array,
    time_s: float,
    forgotten_s: float,
    cells: Array,
    normal: Array,
    gradient: Array,
    used_s: Array,
) -> float:
    """Fill in normal matrix (3, 3) and gradient (3,) of the match; return the points in it."""
    side, c, s = cells.shape[0], np.cos(place[2]), np.sin(place[2])
    count = 0.0
    for e in range(3):
        gradient[e] = 0.0
        for d in range(3):
            normal[e, d] = 0.0
    for k in range(points.shape[0]):
        px, py, pz = points[k, 0], points[k, 1], points[k, 2]
        if np.isnan(px) or px * px + py * py > FARTHEST * FARTHEST:
            continue
        band = int(np.floor((pz - LOWEST) / BAND))
        if band < 0 or band >= BANDS:
            continue
        rx, ry = c * px - s * py, s * px + c * py
        x, y = place[0] + rx, place[1] + ry
        a, b = np.floor(x / CELL), np.floor(y / CELL)
        i, j, f = int(a) % side, int(b) % side, band * FIELDS
        n = cells[i, j, f]
        if n < LEAST_HITS or cells[i, j, f + 7] != a or cells[i, j, f + 8] != b:
            continue
        if time_s - cells[i, j, f + 6] > forgotten_s:
            continue
        xx, xy, yy = cells[i, j, f + 3] / n, cells[i, j, f + 4] / n, cells[i, j, f + 5] / n
        half, apart = 0.5 * (xx + yy), np.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
        if half - apart > STRAIGHT * STRAIGHT or half + apart < SPREAD * SPREAD:
            continue
        if half - apart > 0.25 * (half + apart):  # as wide as it is long
            continue
        turn = 0.5 * np.arctan2(2.0 * xy, xx - yy)
        nx, ny = -np.sin(turn), np.cos(turn)
        level = np.abs(pz - eye[2]) < LEVEL * np.hypot(px - eye[0], py - eye[1])
        zz = cells[i, j, f + 12] / n
        leans = np.abs(nx * cells[i, j, f + 10] + ny * cells[i, j, f + 11]) / n
        if not level and (zz < UPRIGHT * UPRIGHT or leans > LEANS * zz):
            continue
        off = nx * (x - cells[i, j, f + 1]) + ny * (y - cells[i, j, f + 2])
        u = off / CAPTURE
        if u * u >= 1.0:
            continue
        w = (1.0 - u * u) * (1.0 - u * u)
        nt = nx * -ry + ny * rx
        count += w
        used_s[i, j] = time_s
        normal[0, 0] += w * nx * nx
        normal[0, 1] += w * nx * ny
        normal[0, 2] += w * nx * nt
        normal[1, 1] += w * ny * ny
        normal[1, 2] += w * ny * nt
        normal[2, 2] += w * nt * nt
        gradient[0] -= w * off * nx
        gradient[1] -= w * off * ny
        gradient[2] -= w * off * nt
    normal[1, 0], normal[2, 0], normal[2, 1] = normal[0, 1], normal[0, 2], normal[1, 2]
    return count
