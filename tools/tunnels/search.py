"""A tunnel in the free space between obstacles: arcs that an arm's joints can follow.

Chirikjian & Burdick (1990, section 3) take tunnels as given, by a free-space method of one's own
choice. This one works in three steps:

1. The distance of a grid of places from all obstacles. Waves over it tell how far each place is
   from the end, near obstacles being dearer, and how wide the widest way there is: where its
   narrowest place is too narrow by more than the grid may err, no tunnel is.
2. A* over arcs of a few curvatures, from the entrance on, guided by the first wave. The arcs are
   judged by exact distances, and are the tunnel's pieces: nothing needs to be smoothed.
3. The joints are fitted to it at all depths, as the daemon does, and the links of every fit, free
   part and all, are held against the obstacles.

An operator's process does this: it may take seconds and costs the daemon no period, and what comes
of it is a tunnel by message, which is judged, recorded and replayed as any other.
"""

import heapq
import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from ...config.drives import joint_bounds
from ...config.errors import ConfigError
from ...config.load import Cell
from ...config.schema.mechanism import BackboneSection
from ...server.control.backbone.curve import sharpest_bend, told_section
from ...server.control.backbone.fit import Chain
from ...server.control.backbone.insertion import Backbone
from ...server.control.backbone.tunnels import Turn
from ...server.control.inputs import ToldTunnel
from ...server.control.spatial import Array, Pose, rotation_rpy

Place = tuple[float, float, float]

DEARER = 3.0
"""What is as near to obstacles as may be costs so much more than what is far off [1]."""
BENT, CHANGED = 0.15, 0.02
"""What the sharpest bend costs more [1], and a change of curvature by as much [m]."""
BLUNTER = (0.8, 0.65, 0.5, 0.35)
"""Shares of the sharpest curvature that joints can follow at all, one after the other [1]."""
SAMPLES = 5
"""Places of an arc that are held against obstacles [1]."""
LENGTH = 1.5
"""Of an arc, in half widths of the tunnel [1]."""
SAME = 0.9
"""Ends in one place are one if their tangents are within such a part of the least turn [1]."""
SPARE = 1e-3
"""Sampled places of arcs have so much more room than a tunnel needs [m]."""
FINE = 0.002
"""Places of the centre line that is found are so far apart [m]."""
MOST_TRIED = 200_000
"""Ends of arcs that are looked at [1]."""


class NoTunnelError(ValueError):
    """No tunnel leads there, and why: one line."""


class Obstacle(Protocol):
    """An obstacle of a cell, or as the daemon tells of it."""

    @property
    def name(self) -> str: ...
    @property
    def shape(self) -> str | None: ...
    @property
    def xyz(self) -> Place | None: ...
    @property
    def to(self) -> Place | None: ...
    @property
    def rpy(self) -> Place | None: ...
    @property
    def half_size(self) -> Place | None: ...
    @property
    def radius(self) -> float | None: ...
    @property
    def clearance(self) -> float | None: ...
    @property
    def hard(self) -> bool | None: ...


class FreeSpace:
    """Distances from obstacles, where they stand now: boxes with round edges, all of them."""

    def __init__(self, obstacles: Iterable[Obstacle], clearance: float) -> None:
        """Take those that are hard; `clearance` is promised where none is told [m]."""
        soft = (None, "sight_line")
        kept = [o for o in obstacles if o.xyz is not None and o.hard is not False]
        kept = [o for o in kept if o.hard or o.shape not in soft]
        self.names = tuple(o.name for o in kept)
        n = len(kept)
        self._centres, self._R = np.zeros((n, 3)), np.tile(np.eye(3), (n, 1, 1))
        self._half, self._radii = np.zeros((n, 3)), np.zeros(n)
        self.clearances = np.array(
            [clearance if o.clearance is None else o.clearance for o in kept], dtype=np.float64
        )
        """Promised distance of links (n,) [m]."""
        for i, o in enumerate(kept):
            self._centres[i], self._radii[i] = o.xyz, o.radius or 0.0
            if o.shape == "box":
                self._R[i], self._half[i] = rotation_rpy(*(o.rpy or (0.0, 0.0, 0.0))), o.half_size
            elif o.to is not None:
                way = np.array(o.to) - self._centres[i]
                self._centres[i] += 0.5 * way
                self._half[i, 0] = 0.5 * float(np.linalg.norm(way))
                self._R[i] = _along(way)

    def distances(self, points: Array) -> Array:
        """Return the distances of points (m, 3) from each obstacle's surface (m, n) [m].

        Negative inside.
        """
        local = np.einsum("nji,mnj->mni", self._R, points[:, None] - self._centres)
        beyond = np.abs(local) - self._half
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=2)
        return np.asarray(outside + np.minimum(beyond.max(axis=2), 0.0) - self._radii)

    def room(self, points: Array, kept: float) -> Array:
        """Return how wide a tunnel around points (m, 3) may be (m,) [m], from centre line to wall.

        Links keep `kept` from its walls; where an obstacle is promised more, so much less.
        """
        if not len(self.names):
            return np.full(len(points), math.inf)
        spare = np.maximum(0.0, self.clearances - kept)
        return np.asarray((self.distances(points) - spare).min(axis=1))


class FoundTunnel(NamedTuple):
    """A tunnel in free space, and how near its arm comes to obstacles."""

    pieces: tuple[tuple[float, float, float, float], ...]
    """Length [m], bend, climb and roll [rad], as a tunnel is told."""
    end: Place
    """Of its centre line, in World [m]."""
    narrowest: float
    """Least distance of its centre line from an obstacle, less what that is promised more [m]."""
    clearance: float
    """Least distance of links from an obstacle, at any depth [m]; infinity without any."""
    nearest: str
    """The obstacle there; empty without any."""


def find_tunnel(cell: Cell, to: Place, obstacles: Sequence[Obstacle] | None = None) -> FoundTunnel:
    """Return a tunnel from a snake's entrance to a place in World [m], between obstacles.

    Those of the cell unless others are given; where they stand now. It lies ahead of the entrance,
    and ends within the cell's half width of the place. Raises `NoTunnelError` with the narrowest
    place of the widest way and its room, or with what else does not fit.
    """
    section = cell.config.mechanism.backbone
    if section is None:
        raise NoTunnelError("the mechanism has no backbone: it goes through no tunnel")
    return _Search(cell, section, obstacles).found(np.array(to))


class _Arc(NamedTuple):
    """A short piece that may come next."""

    curvature: tuple[float, float]
    """About its z and −y [1/m]."""
    step: Pose
    """Its end in its first frame."""
    points: Array
    """On it, in its first frame (k, 3) [m]."""


class _End(NamedTuple):
    """An arc's end, on a way from the entrance."""

    T: Pose
    curvature: tuple[float, float]
    before: int
    """The end before it; −1 of the entrance."""
    cost: float
    length: float
    """From the entrance on [m]."""


class _Grid:
    """Places ahead of the entrance: how wide the ways to the end are, and how dear."""

    def __init__(self, T: Pose, reach: float, step: float, planar: bool) -> None:
        """Lay places `step` apart, as far as the arm can reach [m]."""
        self._T, self._step = T, step
        n = math.ceil(reach / step)
        self._low = np.array([0, -n, 0 if planar else -n])
        self._shape = (n + 1, 2 * n + 1, 1 if planar else 2 * n + 1)
        self.places = T.p + step * (np.indices(self._shape).reshape(3, -1).T + self._low) @ T.R.T
        """In World (m, 3) [m]."""
        self.coarse = 0.5 * step * math.sqrt(2.0 if planar else 3.0)
        """No place is farther from the grid's [m]."""
        sides = itertools.product((-1, 0, 1), (-1, 0, 1), (0,) if planar else (-1, 0, 1))
        self._sides = [side for side in sides if any(side)]

    def at(self, point: Array) -> int:
        """Return the place nearest to a point (3,)."""
        cell = np.rint((point - self._T.p) @ self._T.R / self._step).astype(int) - self._low
        return int(np.ravel_multi_index(tuple(cell), self._shape, mode="clip"))

    def widest(self, room: Array, end: int) -> Array:
        """Return the room at the narrowest place of the widest way to the end (m,) [m]."""
        found = np.full(self._shape, -math.inf)
        found.flat[end] = room[end]
        while True:
            newer = found
            for _, near, here in self._beside(found):
                newer = newer.copy() if newer is found else newer
                newer[here] = np.maximum(newer[here], near)
            newer = np.maximum(found, np.minimum(newer, room.reshape(self._shape)))
            if np.array_equal(newer, found):
                return found.ravel()
            found = newer

    def to_go(self, price: Array, end: int) -> Array:
        """Return the cost of the way to the end (m,), for prices (m,) of a way [m]."""
        each, found = price.reshape(self._shape), np.full(self._shape, math.inf)
        found.flat[end] = 0.0
        while True:
            newer = found.copy()
            for side, near, here in self._beside(found):
                way = self._step * math.sqrt(sum(k * k for k in side))
                newer[here] = np.minimum(newer[here], near + way * each[here])
            if np.array_equal(newer, found):
                return found.ravel()
            found = newer

    def _beside(self, values: Array) -> Iterator[tuple[tuple[int, ...], Array, tuple[slice, ...]]]:
        """Yield for each side its step, the values there, and the places that have such."""
        for side in self._sides:
            here = tuple(
                slice(max(0, -k), n - max(0, k)) for k, n in zip(side, self._shape, strict=True)
            )
            there = tuple(
                slice(max(0, k), n - max(0, -k)) for k, n in zip(side, self._shape, strict=True)
            )
            yield side, values[there], here


class _Search:
    """The search in one cell."""

    def __init__(
        self, cell: Cell, section: BackboneSection, obstacles: Sequence[Obstacle] | None
    ) -> None:
        self._cell, self._section, self._chain = cell, section, Chain.from_cell(cell)
        known = cell.config.obstacles if obstacles is None else obstacles
        self._free = FreeSpace(known, cell.config.avoidance.clearance)
        self._T = Pose.from_xyz_rpy(section.entrance.xyz, section.entrance.rpy)
        self._planar = section.axes == "planar"
        self._reach = self._chain.length - section.least
        self._half = section.half_width

    def found(self, to: Array) -> FoundTunnel:
        """Return the tunnel to a place (3,) in World [m]. Raises `NoTunnelError`."""
        grid, end, price, why = self._priced(to)
        to_go = grid.to_go(price, end)
        sharpest = min(sharpest_bend(self._cell, self._section, self._chain), 1.0 / self._half)
        for share in BLUNTER:
            line = self._line(to, grid, to_go, share * sharpest)
            if line is None:
                bent = (
                    f"no curve of short arcs with radii of {1.0 / (share * sharpest):.3f} m or "
                    f"more leads there within {self._reach:.3f} m, which is how far the arm goes in"
                )
                raise NoTunnelError(f"{why}; {bent}" if why else bent)
            try:
                return self._judged(line)
            except ValueError as error:
                why = str(error)
        raise NoTunnelError(why)

    def _room(self, points: Array) -> Array:
        return self._free.room(points, self._section.clearance)

    def _priced(self, to: Array) -> tuple[_Grid, int, Array, str]:
        """Return the grid, the place of the end on it, and what a way costs there (m,).

        With the narrowest place, where it may be too narrow by less than the grid can tell.
        """
        way = self._T.R.T @ (to - self._T.p)
        far, half = float(np.linalg.norm(way)), self._half
        if way[0] < 0.0 or (self._planar and abs(way[2]) > half):
            where = "in the arm's plane, ahead of" if self._planar else "ahead of"
            raise NoTunnelError(f"it must lie {where} the entrance: it is at {_shown(way)} of it")
        if far > self._reach:
            raise NoTunnelError(
                f"it is {far:.3f} m from the entrance: the arm goes in by at most "
                f"{self._reach:.3f} m"
            )
        grid = _Grid(self._T, self._reach, half * (0.25 if self._planar else 1.0), self._planar)
        off = self._free.distances(to[None])[0]
        if off.min(initial=math.inf) <= 0.0:
            name = self._free.names[int(off.argmin())]
            raise NoTunnelError(f"it lies in '{name}', {-off.min():.4f} m from its surface")
        room, end = self._room(grid.places), grid.at(to)
        # No way as long as the arm goes in leads over what is farther off.
        way_over = np.linalg.norm(grid.places - self._T.p, axis=1)
        way_over += np.linalg.norm(grid.places - to, axis=1)
        room[way_over > self._reach + 4.0 * grid.coarse] = -math.inf
        start = grid.at(self._T.p)
        widths = grid.widest(room, end)
        widest, narrow = float(widths[start]), ""
        if widest < half:
            place = _shown(grid.places[self._narrowest(grid, room, start, end, widest)])
            narrow = f"the widest way there is {widest:.4f} m from obstacles at {place}"
            narrow += f": a tunnel needs {half:g} m"
        if widest + grid.coarse < half:
            raise NoTunnelError(narrow)
        price = self._price(room)
        price[room + grid.coarse < half] = math.inf
        return grid, end, price, narrow

    def _price(self, room: Array) -> Array:
        """Return what a way costs where there is so much room [1]."""
        return np.asarray(1.0 + DEARER * (self._half / np.maximum(room, 0.1 * self._half)) ** 2)

    def _narrowest(self, grid: _Grid, room: Array, start: int, end: int, width: float) -> int:
        """Return the narrowest place of the cheapest of the widest ways."""
        price = np.where(room >= width, self._price(room), math.inf)
        both = grid.to_go(price, start) + grid.to_go(price, end)
        return int(np.where(room == width, both, math.inf).argmin())

    def _line(self, to: Array, grid: _Grid, to_go: Array, sharpest: float) -> list[_End] | None:
        """Return the ends of arcs from the entrance to a place (3,); None where none lead there."""
        arcs = _arcs(self._half, sharpest, self._planar)
        bent = np.array([math.hypot(*arc.curvature) / sharpest for arc in arcs])
        points = np.concatenate([arc.points for arc in arcs])
        length = LENGTH * self._half
        apart = SAME * float(bent[bent > 0.0].min()) * sharpest * length
        ends = [_End(self._T, (0.0, 0.0), -1, 0.0, 0.0)]
        queue = [(float(to_go[grid.at(self._T.p)]), 0)]
        seen = set[tuple[int, ...]]()
        while queue:
            if len(ends) > MOST_TRIED:
                raise NoTunnelError(f"none of {MOST_TRIED} curves of short arcs leads there")
            _, i = heapq.heappop(queue)
            T, before, _, cost, way = ends[i]
            if float(np.linalg.norm(T.p - to)) < self._half:
                return _traced(ends, i)
            local = self._T.R.T @ (T.p - self._T.p)
            key = (*np.rint(local / (0.5 * length)), *np.rint(self._T.R.T @ T.R[:, 0] / apart))
            if key in seen or way + length > self._reach:
                continue
            seen.add(key)
            placed = T.p + points @ T.R.T
            room = self._room(placed).reshape(len(arcs), -1)
            ahead = ((placed - self._T.p) @ self._T.R[:, 0]).reshape(len(arcs), -1)
            price = self._price(room)
            passes = (room.min(axis=1) > self._half + SPARE) & (ahead.min(axis=1) > -SPARE)
            for k in np.flatnonzero(passes):
                arc = arcs[k]
                change = math.dist(arc.curvature, before) / sharpest
                dearer = length * float(price[k].mean()) * (1.0 + BENT * float(bent[k]) ** 2)
                end = T @ arc.step
                spent = cost + dearer + CHANGED * change
                left = float(to_go[grid.at(end.p)])
                if left < math.inf:
                    heapq.heappush(queue, (spent + left, len(ends)))
                    ends.append(_End(end, arc.curvature, i, spent, way + length))
        return None

    def _judged(self, line: list[_End]) -> FoundTunnel:
        """Return a line as a tunnel. Raises `ValueError` for what the arm cannot follow."""
        pieces: list[tuple[float, float, float, float]] = []
        for curvature, run in itertools.groupby(line, lambda end: end.curvature):
            length = LENGTH * self._half * sum(1 for _ in run)
            bend, climb = (round(length * k, 6) + 0.0 for k in curvature)
            pieces.append((round(length, 6), bend, climb, 0.0))
        section = told_section(self._section, ToldTunnel(tuple(pieces)))
        try:
            backbone = Backbone.of(self._cell, section)
        except ConfigError as error:
            raise ValueError(str(error).partition("mechanism.backbone.")[2]) from None
        low, high = joint_bounds(self._cell.robot.joints, self._cell.config.mechanism.drives)
        names = [joint.name for joint in self._cell.robot.joints]
        backbone.require_passable(np.array(low), np.array(high), names)
        arcs = backbone.curve.arcs
        centre = arcs.at(np.arange(0.0, arcs.length, FINE))[0]
        narrowest = float(self._room(centre).min())
        if narrowest < self._half:
            raise ValueError(f"it would have {narrowest:.4f} m of room: at least {self._half:g} m")
        links = backbone.chain.points(backbone.fits)
        apart, depth, name, promised = self._nearest(backbone, links)
        if apart < promised:
            raise ValueError(
                f"links would come to {apart:.4f} m of '{name}' with the tip {depth:.3f} m inside: "
                f"at least {promised:g} m"
            )
        end = arcs.end.p
        return FoundTunnel(
            tuple(pieces), (float(end[0]), float(end[1]), float(end[2])),
            narrowest, apart, name,
        )  # fmt: skip

    def _nearest(self, backbone: Backbone, links: Array) -> tuple[float, float, str, float]:
        """Return where links (g, n + 1, 3) of all fits come nearest to an obstacle [m].

        With the depth of the tip, the obstacle's name, and the distance that it is promised [m].
        """
        if not self._free.names:
            return math.inf, 0.0, "", 0.0
        both = np.concatenate((links, 0.5 * (links[:, 1:] + links[:, :-1])), axis=1)
        off = self._free.distances(both.reshape(-1, 3)) - self._section.link_radius
        worst = int((off - self._free.clearances).min(axis=1).argmin())
        k = int((off[worst] - self._free.clearances).argmin())
        depth = backbone.depth_at(worst // both.shape[1])
        return float(off[worst, k]), depth, self._free.names[k], float(self._free.clearances[k])


def _arcs(half: float, sharpest: float, planar: bool) -> list[_Arc]:
    """Return the arcs that may come next: straight, and of a few curvatures up to the sharpest."""
    count = 2 if planar else 8
    turned = [2.0 * math.pi * k / count for k in range(count)]
    bends = [(0.0, 0.0)] + [
        (round(share * sharpest * math.cos(a), 6), round(share * sharpest * math.sin(a), 6))
        for share in ((0.25, 0.5, 1.0) if planar else (0.5, 1.0))
        for a in turned
    ]
    length, found = LENGTH * half, list[_Arc]()
    for bend, climb in bends:
        shares = np.arange(1, SAMPLES + 1) / SAMPLES
        steps = [Turn(x * length, x * length * bend, x * length * climb).end for x in shares]
        found.append(_Arc((bend, climb), steps[-1], np.array([T.p for T in steps])))
    return found


def _traced(ends: list[_End], last: int) -> list[_End]:
    """Return the ends on the way to one of them, without the entrance."""
    found = list[_End]()
    while last > 0:
        found.append(ends[last])
        last = ends[last].before
    return found[::-1]


def _along(way: Array) -> Array:
    """Return axes (3, 3) whose x points along a way (3,)."""
    x = way / float(np.linalg.norm(way))
    y = np.cross(x, np.eye(3)[int(np.abs(x).argmin())])
    y /= float(np.linalg.norm(y))
    return np.column_stack((x, y, np.cross(x, y)))


def _shown(place: Array) -> str:
    return "({})".format(", ".join(f"{x:.3f}" for x in place))
