"""The part of a backbone inside tunnels: arcs, helices and straights, and curves across gaps."""

import math
from collections.abc import Generator, Sequence
from typing import NamedTuple, Self, TypeVar

import numpy as np
from numpy.polynomial import legendre

from ..compiled import ARRAY3, INDEX, MATRIX, NUMBER, TABLE, VECTOR, compiled, inner_kernel, record
from ..scene import Index
from ..spatial import Array, Pose, rotation_exp

# --- The part of a backbone inside tunnels: arcs, helices and straights, one after the other ------
#
# Inside, the curve is where the tunnel is: its curvature is a travelling wave κ(s − s1)
# (Chirikjian & Burdick, eqs. 7 and 15). A segment turns about an axis that is fixed in its own
# frame, whose x axis is the tangent: `bend` about z (to the left), `climb` about −y (upward), and
# `roll` about x. So curvature κ = |(bend, climb)| / length and torsion τ = roll / length are
# constant (the axis is the Darboux vector τ T + κ B): a circular helix in closed form, with
# w = √(κ² + τ²), κ / w² its radius and 2π τ / w² its pitch. There is no chart, so that a tunnel
# may climb straight up, where the paper's quasi-torsion is singular (T = ±π/2).

ARC_ARRAYS = record(VECTOR, ARRAY3, MATRIX)
"""`Arcs` as kernels take it."""
ROOT_STEPS = 60
"""Steps of the search for a foot on a helix, at most [1]."""


class Turn(NamedTuple):
    """One segment of a tunnel: how long it is, and how far it turns."""

    length: float
    """[m]"""
    bend: float = 0.0
    """To the left, about the segment's own z [rad]."""
    climb: float = 0.0
    """Upward, about its own −y [rad]."""
    roll: float = 0.0
    """About its own tangent [rad]: with a bend or climb, a helix of torsion roll / length."""

    @property
    def end(self) -> Pose:
        """Its end frame, in its first one: the exponential of a constant twist along x."""
        turn = np.array([self.roll, -self.climb, self.bend])
        way = np.array([1.0, 0.0, 0.0])
        angle = float(np.linalg.norm(turn))
        if angle > 1e-9:
            axis = turn / angle
            along = float(axis[0]) * axis
            sine, sagitta = math.sin(angle) / angle, 2.0 * math.sin(0.5 * angle) ** 2 / angle
            way = along + sine * (way - along) + sagitta * np.cross(axis, way)
        return Pose(rotation_exp(turn), self.length * way)


class Arcs(NamedTuple):
    """k arcs and helices one after the other, in World; a straight line goes on from the last."""

    starts: Array
    """Arc length from the entrance to each, and to the end of the last (k + 1,) [m]."""
    frames: Array
    """Of each, and of the line after the last: start, tangent there, where it turns to, and
    across both (k + 1, 4, 3): rows."""
    turning: Array
    """Curvature, 0 of a straight, and torsion (k + 1, 2) [1/m]."""

    @classmethod
    def from_entrance(cls, T_world_entrance: Pose, turns: Sequence[Turn]) -> Self:
        """Lay segments one after the other from the entrance on."""
        T = T_world_entrance
        starts, frames, turning = [0.0], list[Array](), list[tuple[float, float]]()
        for turn in turns:
            angle = math.hypot(turn.bend, turn.climb)
            y, z = (turn.bend / angle, turn.climb / angle) if angle else (1.0, 0.0)
            frames.append(np.stack((T.p, T.R[:, 0], *(T.R @ [[0, 0], [y, -z], [z, y]]).T)))
            torsion = turn.roll / turn.length if angle else 0.0
            turning.append((angle / turn.length, torsion))
            starts.append(starts[-1] + turn.length)
            T = T @ turn.end
        frames.append(np.vstack((T.p, T.R.T)))
        return cls(np.array(starts), np.array(frames), np.array([*turning, (0.0, 0.0)]))

    @classmethod
    def of_all(cls, each: "Sequence[Arcs]") -> Self:
        """Return arcs that begin where those before end."""
        ends = np.cumsum([arcs.length for arcs in each])
        begins = np.concatenate(([0.0], ends[:-1]))
        starts = [arcs.starts[:-1] + s for arcs, s in zip(each, begins, strict=True)]
        return cls(
            np.concatenate((*starts, ends[-1:])),
            np.concatenate((*(arcs.frames[:-1] for arcs in each), each[-1].frames[-1:])),
            np.concatenate((*(arcs.turning[:-1] for arcs in each), each[-1].turning[-1:])),
        )

    @property
    def end(self) -> Pose:
        """Where the last arc ends: x along the tangent, y to where a bend to the left turns."""
        return Pose(self.frames[-1, 1:].T.copy(), self.frames[-1, 0])

    @property
    def length(self) -> float:
        """Of all arcs together [m]."""
        return float(self.starts[-1])

    def at(self, depths: Array) -> tuple[Array, Array]:
        """Return points (m, 3) [m] and tangents (m, 3) at arc lengths (m,) from the entrance [m].

        Before it and after the last arc the curve is straight.
        """
        points, tangents = np.empty((len(depths), 3)), np.empty((len(depths), 3))
        _at(self[:], depths, points, tangents)
        return points, tangents


@inner_kernel
def _place(curvature: float, torsion: float, way: float) -> tuple[float, float, float]:
    """Return how far a helix goes along its first tangent, normal and binormal on its way [m]."""
    w = math.sqrt(curvature * curvature + torsion * torsion)
    if abs(w * way) <= 1e-9:
        return way, 0.0, 0.0
    a, b = curvature / w, torsion / w
    sine, sagitta = math.sin(w * way) / w, (1.0 - math.cos(w * way)) / w
    return a * a * sine + b * b * way, a * sagitta, a * b * (way - sine)


@compiled(ARC_ARRAYS, VECTOR, TABLE, TABLE)
def _at(arcs: tuple[Array, Array, Array], depths: Array, points: Array, tangents: Array) -> None:
    """Write points and tangents (m, 3) at arc lengths (m,) from the entrance [m]."""
    starts, frames, turning = arcs
    last = len(turning) - 1
    for m in range(len(depths)):
        k = 0
        while k < last and depths[m] >= starts[k + 1]:
            k += 1
        way, c, torsion = depths[m] - starts[k], turning[k, 0], turning[k, 1]
        if depths[m] < 0.0:
            c = torsion = 0.0
        along, aside, across = _place(c, torsion, way)
        ahead, inward, up = 1.0, 0.0, 0.0
        w = math.sqrt(c * c + torsion * torsion)
        if w * way > 1e-9:
            a, b, cosine = c / w, torsion / w, math.cos(w * way)
            ahead, inward = a * a * cosine + b * b, a * math.sin(w * way)
            up = a * b * (1.0 - cosine)
        for i in range(3):
            t, n, z = frames[k, 1, i], frames[k, 2, i], frames[k, 3, i]
            points[m, i] = frames[k, 0, i] + along * t + aside * n + across * z
            tangents[m, i] = ahead * t + inward * n + up * z


@inner_kernel
def _point(arcs: tuple[Array, Array, Array], depth: float, point: Array) -> None:
    """Write the point (3,) at an arc length of 0 or more from the entrance [m]."""
    starts, frames, turning = arcs
    k = 0
    while k < len(turning) - 1 and depth >= starts[k + 1]:
        k += 1
    along, aside, across = _place(turning[k, 0], turning[k, 1], depth - starts[k])
    for i in range(3):
        t, n, z = frames[k, 1, i], frames[k, 2, i], frames[k, 3, i]
        point[i] = frames[k, 0, i] + along * t + aside * n + across * z


@inner_kernel
def _foot_on_helix(
    curvature: float, torsion: float, point: tuple[float, float, float], begin: float, end: float
) -> float:
    """Return the way [m], between two, that is nearest to a point (3,) in the helix's first frame.

    With φ = w s, the point at radius ρ, angle β and height z of the helix's own axis, and radius r
    and rise c of the helix, the distance squared grows with φ where
    f = r ρ sin(φ − β) + c (c φ − z) is positive. It has one least where f rises through 0, in each
    interval of φ on which f grows; all of these are looked at, and both ends.
    """
    w = math.sqrt(curvature * curvature + torsion * torsion)
    r, c = curvature / (w * w), torsion / (w * w)
    x, y = r - point[1], (curvature * point[0] - torsion * point[2]) / w
    z = (torsion * point[0] + curvature * point[2]) / w
    radius, beta = math.sqrt(x * x + y * y), math.atan2(y, x)
    pull = r * radius
    least, where = math.inf, begin
    grows = math.pi if pull <= c * c else math.acos(-c * c / pull)
    first = math.ceil((w * begin - beta - grows) / (2.0 * math.pi))
    last = math.floor((w * end - beta + grows) / (2.0 * math.pi))
    for k in range(first - 1, last + 2):
        middle = beta + 2.0 * math.pi * k
        low = min(max(middle - grows, w * begin), w * end)
        high = min(max(middle + grows, w * begin), w * end)
        phi = 0.5 * (low + high)
        for _ in range(ROOT_STEPS):
            f = pull * math.sin(phi - beta) + c * (c * phi - z)
            if f > 0.0:
                high = phi
            else:
                low = phi
            slope = pull * math.cos(phi - beta) + c * c
            newer = phi - f / slope if slope > 0.0 else low
            if not low < newer < high:
                newer = 0.5 * (low + high)
            if abs(newer - phi) < 1e-14 * (1.0 + abs(phi)):
                break
            phi = newer
        rise = c * phi - z
        square = r * r + radius * radius - 2.0 * pull * math.cos(phi - beta) + rise * rise
        if square < least:
            least, where = square, phi / w
    return min(max(where, begin), end)


@inner_kernel
def _foot(
    arcs: tuple[Array, Array, Array], low: float, high: float, point: Array
) -> tuple[float, float]:
    """Return the least distance of a point (3,) to the curve between two arc lengths, and where.

    All in [m]. Arc by arc: the foot on a circle is under the point, at an end where it is off it.
    """
    starts, frames, turning = arcs
    least, where = math.inf, low
    last = len(turning) - 1
    for k in range(last + 1):
        begin = -math.inf if k == 0 else starts[k]
        begin, end = max(low, begin), high if k == last else min(high, starts[k + 1])
        if begin > end:
            continue
        x = y = z = 0.0
        for i in range(3):
            d = point[i] - frames[k, 0, i]
            x += d * frames[k, 1, i]
            y += d * frames[k, 2, i]
            z += d * frames[k, 3, i]
        c, torsion = turning[k, 0], turning[k, 1]
        if torsion != 0.0:
            ends = begin - starts[k], end - starts[k]
            way = starts[k] + _foot_on_helix(c, torsion, (x, y, z), *ends)
        elif c > 0.0:
            angle = math.atan2(c * x, 1.0 - c * y)
            middle = 0.5 * c * (begin + end - 2.0 * starts[k])
            angle -= 2.0 * math.pi * math.floor((angle - middle) / (2.0 * math.pi) + 0.5)
            way = starts[k] + angle / c
        else:
            way = starts[k] + x
        way = min(max(way, begin), end)
        along, aside, across = _place(c, torsion, way - starts[k])
        off = math.sqrt((x - along) ** 2 + (y - aside) ** 2 + (z - across) ** 2)
        if off < least:
            least, where = off, way
    return least, where


@compiled(ARC_ARRAYS, MATRIX, NUMBER, NUMBER, NUMBER)
def passages_meet(
    arcs: tuple[Array, Array, Array], runs: Array, beside: float, bound: float, step: float
) -> tuple[float, float, float]:
    """Return how near two passages of a tunnel come to each other [m], and their arc lengths.

    The nearest of those below `bound`, in runs (r, 2) of arc lengths with walls [m]; infinity where
    none are. Places up to `beside` from each other along the curve are one passage. As a distance
    changes by no more than the way, one place of a pair is looked for in steps of what is left
    above the bound, or of `step`; the other is its exact foot.
    """
    most, first, second, point = math.inf, 0.0, 0.0, np.empty(3)
    for i in range(len(runs)):
        at, end = runs[i, 0], runs[i, 1]
        while at < end:
            least, where = math.inf, at
            _point(arcs, at, point)
            for j in range(i, len(runs)):
                low = max(runs[j, 0], at + beside)
                if low < runs[j, 1]:
                    off, foot = _foot(arcs, low, runs[j, 1], point)
                    if off < least:
                        least, where = off, foot
            if least < min(bound, most):
                most, first, second = least, at, where
            at += max(step, least - bound)
    return most, first, second


@inner_kernel
def off_centre(
    arcs: tuple[Array, Array, Array],
    points: Array,
    depths: Array,
    window: float,
    upto: Index,
) -> tuple[float, int]:
    """Return how far the farthest of points (m, 3) is off the tunnel's centre line [m], and which.

    A point is looked for within `window` of where it ought to be, its arc length from the entrance
    (m,): another passage of the same tunnel may run beside it. Points before the entrance, or
    beyond the end of arc `upto` (1,), are in the open, and do not count; −1 where none does.
    """
    starts = arcs[0]
    most, which = 0.0, -1
    for m in range(len(points)):
        low, high = depths[m] - window, depths[m] + window
        if high < 0.0 or low > starts[upto[0]]:
            continue
        off, where = _foot(arcs, low, high, points[m])
        if 0.0 <= where <= starts[upto[0]] and off > most:
            most, which = off, m
    return most, which


@compiled(ARC_ARRAYS, ARRAY3, VECTOR, NUMBER, INDEX)
def links_off_centre(
    arcs: tuple[Array, Array, Array],
    points: Array,
    depths: Array,
    window: float,
    upto: Index,
) -> float:
    """Return how far links' ends and middles are off the centre line at most [m], as `off_centre`.

    Of postures whose points are (s, n + 1, 3), the arc lengths of which are `depths` (n + 1,).
    """
    n = len(depths)
    both, at = np.empty((2 * n - 1, 3)), np.empty(2 * n - 1)
    for i in range(n):
        at[i] = depths[i]
        if i > 0:
            at[n + i - 1] = 0.5 * (depths[i - 1] + depths[i])
    most = 0.0
    for s in range(len(points)):
        for i in range(n):
            for k in range(3):
                both[i, k] = points[s, i, k]
                if i > 0:
                    both[n + i - 1, k] = 0.5 * (points[s, i - 1, k] + points[s, i, k])
        most = max(most, off_centre(arcs, both, at, window, upto)[0])
    return most


# --- Curves across gaps between two tunnels, solved once: fixed ends, fixed length, least bending
#
# Where everything slides at one speed, the conditions between tunnels (Chirikjian & Burdick,
# eqs. 8, 9, 16 and 17) hold for any fixed curve, and so do their rates (eqs. 10 to 13): the
# slack lives in the exterior at the base alone. Bend and climb are polynomials along the gap,
#
#     κ ℓ = Σ c_k P_k(2t − 1), k = 0 … 4 (Legendre),   least Σ c_k² / (2k + 1)
#
# subject to end and end tangent, by Newton's method on the Lagrangian from several starts.
# Where that curve is too sharp somewhere, its greatest curvature is brought down along the
# curves that meet both ends. A curve is made of short arcs, by which the ends are met exactly.
# A search is work in parts: a linearisation each, 1.6 ms, as one may run beside the tick.

Found = TypeVar("Found")
Parts = Generator[None, None, Found]
"""Work that yields after each part, and returns what comes of it."""

ARCS = 24
"""Arcs of one gap [1]."""
DEGREE = 4
STARTS = 8
"""Curves are sought from so many starts, and the one of least bending is taken [1]."""
MOST_STARTS = 64
"""Where none of these is a curve that can be followed, from so many in all [1]."""
MOST_STEPS = 40
LONGEST_STEP = 1.5
"""Coefficients change by no more in one step [rad]."""
MET = 1e-11
"""Ends are met within this, in lengths of the gap [1]."""
SETTLED = 1e-4
"""A curve is the one of least bending when its coefficients change by less [rad]."""
MOST_BLUNTINGS = 30
"""A curve that is too sharp is made blunter in so many steps [1]."""
POWER = 8
"""An arc's weight there is this power of its curvature [1]."""
SAME = 1e-3
"""Curves whose costs differ by a smaller part are one and the same [1]."""
PARTS = (0.3, 0.1, 0.03, 0.01)
"""Parts of such a step that are tried [1]."""
SLIGHT = 1e-6
CROSSING = 0.25
"""Points of a gap that are so far apart along it shall not come near to each other [1]."""


def completed(work: Parts[Found]) -> Found:
    """Do all parts of some work, and return what comes of it."""
    while True:
        try:
            next(work)
        except StopIteration as end:
            found: Found = end.value
            return found


def solve_gap(
    T: Pose, T_to: Pose, length: float, planar: bool, sharpest: float
) -> Parts[list[Turn]]:
    """Return short turns that lead from a pose to another's place and tangent.

    `length` is the curve's [m], `sharpest` the greatest curvature [1/m]. Raises `ValueError` that
    says why there is none.
    """
    way = T.R.T @ (T_to.p - T.p)
    chord = float(np.linalg.norm(way))
    if length <= chord:
        raise ValueError(f"a length of {length:g} m is no more than its chord, {chord:.4f} m")
    R = T.R.T @ T_to.R
    if planar and (abs(way[2]) > SLIGHT or abs(R[2, 0]) > SLIGHT):
        raise ValueError("a planar arm cannot leave its plane")
    found = yield from _solved(way / length, R[:, 0], planar, sharpest * length)
    if found is None:
        raise ValueError(f"no curve of {length:g} m leads there from any of {MOST_STARTS} starts")
    bends = _bends(found[None], planar)[0]
    curvature = _sharpest(found, planar) / length
    if curvature > sharpest:
        raise ValueError(
            f"the bluntest curve that is found has a curvature of {curvature:.2f} 1/m, at most "
            f"{sharpest:.2f} can be followed"
        )
    points = _ends(found[None], planar)[2][0] * length
    apart = np.abs(np.subtract.outer(np.arange(ARCS + 1), np.arange(ARCS + 1)))
    far = apart > CROSSING * ARCS
    near = np.linalg.norm(points[:, None] - points, axis=2)[far]
    if near.min() < 0.5 * CROSSING * length / math.pi:
        raise ValueError(f"the curve comes to {near.min():.4f} m of itself")
    return [Turn(length / ARCS, float(bend), float(climb)) for bend, climb in bends]


def _solved(way: Array, tangent: Array, planar: bool, sharpest: float) -> Parts[Array | None]:
    """Return the coefficients of least cost that meet the end; lengths are in that of the gap.

    Where none of the first starts leads to a curve that is not sharper, the first that is blunt
    enough, or can be made so; failing that the bluntest. A start that leads to none of least cost
    may still lead to one that meets the end.
    """
    curves = 1 if planar else 2
    weight = np.tile(1.0 / (2.0 * np.arange(DEGREE + 1) + 1.0), curves)
    draw, best, least = np.random.default_rng(0), None, math.inf
    bluntest, seen = None, list[float]()
    for start in range(MOST_STARTS):
        x = draw.normal(0.0, 0.0 if start == 0 else 2.0, curves * (DEGREE + 1))
        if start == 0:
            x[1] = 0.1
        found = yield from _least(x, way, tangent, planar, weight)
        cost = math.inf if found is None else float(weight @ found**2)
        if cost < least:
            best, least = found, cost
        if start < STARTS - 1:
            continue
        # Beyond the first starts a curve is taken for being blunt.
        found, cost = (best, least) if start == STARTS - 1 else (found, cost)
        if found is None:
            cost = -1.0
            found = yield from _met(x, way, tangent, planar, MOST_STEPS)
        if found is None or any(abs(cost - other) < SAME * cost for other in seen):
            continue
        seen.append(cost)
        found = yield from _blunter(found, way, tangent, planar, sharpest)
        if bluntest is None or _sharpest(found, planar) < _sharpest(bluntest, planar):
            bluntest = found
        if _sharpest(bluntest, planar) <= sharpest:
            break
    if bluntest is not None:
        bluntest = yield from _met(bluntest, way, tangent, planar)
    return bluntest


def _blunter(x: Array, way: Array, tangent: Array, planar: bool, sharpest: float) -> Parts[Array]:
    """Return coefficients near x (c,) that meet the end with less of the greatest curvature.

    The first whose curvature is nowhere above `sharpest` (of unit length), or the bluntest found.
    """
    blocks = np.eye(1 if planar else 2)
    for _ in range(MOST_BLUNTINGS):
        most = _sharpest(x, planar)
        if most <= sharpest:
            break
        shares = (np.hypot(*_bends(x[None], planar)[0].T) * ARCS / most) ** POWER
        weight = np.kron(blocks, _legendre().T @ (shares[:, None] * _legendre()))
        _, J = _linearised(x, way, tangent, planar)
        yield
        free = np.linalg.svd(J)[2][len(J) :].T
        step = free @ np.linalg.lstsq(free.T @ weight @ free, free.T @ weight @ x, rcond=None)[0]
        for part in PARTS:
            tried = yield from _met(x - part * step, way, tangent, planar)
            if tried is not None and _sharpest(tried, planar) < most:
                break
        else:
            break
        x = tried
    return x


def _least(
    x: Array, way: Array, tangent: Array, planar: bool, weight: Array
) -> Parts[Array | None]:
    """Return coefficients near x (c,) of least cost that meet the end; None if it settles not."""
    for _ in range(MOST_STEPS):
        off, J = _linearised(x, way, tangent, planar)
        yield
        JW = J / weight
        try:
            multiplier = np.linalg.solve(JW @ J.T, J @ x - off)
        except np.linalg.LinAlgError:
            return None
        step = JW.T @ multiplier - x
        x = x + step * min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
        if float(np.abs(step).max()) < SETTLED:
            return x
    return None


def _sharpest(x: Array, planar: bool) -> float:
    """Return the greatest curvature of a gap's curve, of unit length [1]."""
    return float(np.hypot(*_bends(x[None], planar)[0].T).max()) * ARCS


def _met(x: Array, way: Array, tangent: Array, planar: bool, steps: int = 6) -> Parts[Array | None]:
    """Return coefficients near x (c,) that meet the end exactly; None where there are none."""
    for _ in range(steps):
        off, J = _linearised(x, way, tangent, planar)
        yield
        if float(np.abs(off).max()) < MET:
            return x
        step = np.asarray(np.linalg.lstsq(J, off, rcond=None)[0], dtype=np.float64)
        x = x - step * min(1.0, LONGEST_STEP / max(float(np.abs(step).max()), 1e-12))
    return None


def _linearised(x: Array, way: Array, tangent: Array, planar: bool) -> tuple[Array, Array]:
    """Return how far the end is off (m,), and its Jacobian (m, c) by central differences."""
    h = 1e-6
    tried = np.vstack((x[None], x + h * np.eye(len(x)), x - h * np.eye(len(x))))
    places, tangents, _ = _ends(tried, planar)
    # Along two directions across the wanted tangent; it has to point ahead, too.
    across = np.linalg.svd(tangent[None])[2][1:]
    if planar:
        aside = np.array([-tangent[1], tangent[0], 0.0])
        ahead = np.arctan2(tangents @ aside, tangents @ tangent)[:, None]
        off = np.concatenate(((places - way)[:, :2], ahead), axis=1)
    else:
        angle = np.arccos(np.clip(tangents @ tangent, -1.0, 1.0))
        scale = np.where(angle > 1e-9, angle / np.maximum(np.sin(angle), 1e-9), 1.0)
        off = np.concatenate((places - way, scale[:, None] * (tangents @ across.T)), axis=1)
    n = len(x)
    return off[0], ((off[1 : n + 1] - off[n + 1 :]) / (2.0 * h)).T


def _bends(x: Array, planar: bool) -> Array:
    """Return bend and climb of each arc (s, a, 2) [rad] of coefficients (s, c)."""
    V = _legendre()
    bend = x[:, : DEGREE + 1] @ V.T / ARCS
    climb = np.zeros_like(bend) if planar else x[:, DEGREE + 1 :] @ V.T / ARCS
    return np.stack((bend, climb), axis=2)


def _legendre() -> Array:
    """Return the polynomials at the middle of each arc (a, c): curvature of unit coefficients."""
    t = 2.0 * (np.arange(ARCS) + 0.5) / ARCS - 1.0
    V = np.asarray(legendre.legvander(t, DEGREE), dtype=np.float64)
    V[:, 1:] -= V[:, 1:].mean(axis=0)  # what turns in all is c_0 alone, for arcs, too
    return V


def _ends(x: Array, planar: bool) -> tuple[Array, Array, Array]:
    """Return ends (s, 3), end tangents (s, 3) and all points (s, a + 1, 3) of unit length."""
    bends = _bends(x, planar)
    R, p = np.tile(np.eye(3), (len(x), 1, 1)), np.zeros((len(x), 3))
    points = [p]
    for i in range(ARCS):
        bend, climb = bends[:, i].T
        angle = np.maximum(np.hypot(bend, climb), 1e-12)
        inward = np.stack((np.zeros(len(x)), bend / angle, climb / angle), axis=1)
        ahead = np.stack((np.ones(len(x)), np.zeros(len(x)), np.zeros(len(x))), axis=1)
        s, c = np.sin(angle)[:, None], np.cos(angle)[:, None]
        # (1 − cos α) / α without loss of digits
        sagitta = (2.0 * np.sin(0.5 * angle) ** 2 / angle)[:, None]
        chord = (s / angle[:, None] * ahead + sagitta * inward) / ARCS
        p = p + np.einsum("sij,sj->si", R, chord)
        points.append(p)
        axis = np.cross(ahead, inward)
        turned = np.stack((c * ahead + s * inward, c * inward - s * ahead, axis), axis=2)
        frame = np.stack((ahead, inward, axis), axis=2)
        R = np.einsum("sij,sjk,slk->sil", R, turned, frame)
    return p, R[:, :, 0], np.stack(points, axis=1)
