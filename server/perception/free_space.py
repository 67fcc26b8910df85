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

An operator's process asks for it: it may take seconds and costs the daemon no period, and what
comes of it is a tunnel by message, which is judged, recorded and replayed as any other.
"""

import heapq
import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...config.drives import joint_bounds
from ...config.errors import ConfigError
from ...config.load import Cell
from ...config.schema.mechanism import BackboneSection
from ..control.backbone.curve import sharpest_bend, told_section
from ..control.backbone.fit import Chain
from ..control.backbone.insertion import Backbone
from ..control.backbone.tunnels import Turn
from ..control.inputs import ToldTunnel
from ..control.proximity.distance import apart
from ..control.scene import Boxes, Rounds, Scene
from ..control.spatial import Array, Pose

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


def find_tunnel(cell: Cell, to: Place, scene: Scene) -> FoundTunnel:
    """Return a tunnel from a snake's entrance to a place in World [m], between the hard obstacles.

    Where they stand now. It lies ahead of the entrance, and ends within the cell's half width of
    the place. Raises `NoTunnelError` with the narrowest place of the widest way and its room, or
    with what else does not fit.
    """
    section = cell.config.mechanism.backbone
    if section is None:
        raise NoTunnelError("the mechanism has no backbone: it goes through no tunnel")
    return _Search(cell, section, standing(scene)).found(np.array(to))


def standing(scene: Scene) -> Scene:
    """Return the hard obstacles of a scene as solids that stand, sight lines among them."""
    rounds, boxes = scene.rounds, scene.boxes
    m = len(rounds.radius)
    kept = scene.hard.copy()
    kept[:m] &= rounds.carrier < 0
    rounds = Rounds(*(each[kept[:m]] for each in vars(rounds).values()))
    boxes = Boxes(*(each[kept[m:]] for each in vars(boxes).values()))
    rest: dict[str, Any] = {
        key: each[kept] for key, each in vars(scene).items() if isinstance(each, np.ndarray)
    }
    rest["speed"] = np.zeros(int(kept.sum()))
    solid = replace(rounds, line=np.zeros_like(rounds.line))
    names = tuple(itertools.compress(scene.names, kept))
    return replace(scene, names=names, rounds=solid, boxes=boxes, **rest)


class _End(NamedTuple):
    """An arc's end, on a way from the entrance."""

    T: Pose
    curvature: tuple[float, float]
    """Of the arc, about its z and −y [1/m]."""
    before: int
    """The end before it; −1 of the entrance."""
    cost: float
    length: float
    """From the entrance on [m]."""


class _Grid:
    """Places ahead of the entrance, over which waves run from side to side."""

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
        return self._wave(room, end, room[end], lambda near, _, here: np.minimum(near, here))

    def to_go(self, price: Array, end: int) -> Array:
        """Return the cost of the way to the end (m,), for prices (m,) of a way [m]."""
        return -self._wave(price, end, 0.0, lambda near, way, here: near - way * here)

    def _wave(
        self,
        values: Array,
        end: int,
        first: float,
        through: Callable[[Array, float, Array], Array],
    ) -> Array:
        """Return the most that comes to each place from the end (m,), where there is `first`.

        `through` says what of that beside a place comes to it, over a way [m], by its value.
        """
        each, found = values.reshape(self._shape), np.full(self._shape, -math.inf)
        found.flat[end] = first
        while True:
            newer = found.copy()
            for side in self._sides:
                there, here = (
                    tuple(
                        slice(max(0, to * k), n - max(0, -to * k))
                        for k, n in zip(side, self._shape, strict=True)
                    )
                    for to in (1, -1)
                )
                way = self._step * math.sqrt(sum(k * k for k in side))
                newer[here] = np.maximum(newer[here], through(found[there], way, each[here]))
            if np.array_equal(newer, found):
                return found.ravel()
            found = newer


class _Search:
    """The search in one cell, between solids that stand."""

    def __init__(self, cell: Cell, section: BackboneSection, scene: Scene) -> None:
        self._cell, self._section, self._scene = cell, section, scene
        self._chain, self._half = Chain.from_cell(cell), section.half_width
        self._T = Pose.from_xyz_rpy(section.entrance.xyz, section.entrance.rpy)
        self._planar = section.axes == "planar"
        self._reach = self._chain.length - section.least
        # Links keep the cell's clearance from walls: what is promised more narrows the way.
        self._more = np.maximum(0.0, scene.clearance - section.clearance)

    def found(self, to: Array) -> FoundTunnel:
        """Return the tunnel to a place (3,) in World [m]. Raises `NoTunnelError`."""
        grid, to_go, why = self._guided(to)
        sharpest = min(sharpest_bend(self._cell, self._section, self._chain), 1.0 / self._half)
        for share in BLUNTER:
            line = self._line(to, grid, to_go, share * sharpest)
            if not line:
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
        """Return how wide a tunnel around points (m, 3) may be (m,) [m], from centre to wall."""
        off = apart(points, self._scene).distance - self._more
        return np.asarray(off.min(axis=1, initial=math.inf))

    def _guided(self, to: Array) -> tuple[_Grid, Array, str]:
        """Return the grid, and the cost of the way to the end from each of its places (m,).

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
        off = apart(to[None], self._scene).distance[0]
        if off.min(initial=math.inf) <= 0.0:
            name = self._scene.names[int(off.argmin())]
            raise NoTunnelError(f"it lies in '{name}', {-off.min():.4f} m from its surface")
        room, start, end = self._room(grid.places), grid.at(self._T.p), grid.at(to)
        # No way as long as the arm goes in leads over what is farther off.
        way_over = np.linalg.norm(grid.places - self._T.p, axis=1)
        way_over += np.linalg.norm(grid.places - to, axis=1)
        room[way_over > self._reach + 4.0 * grid.coarse] = -math.inf
        widest, narrow, price = float(grid.widest(room, end)[start]), "", self._price(room)
        if widest < half:
            passed = np.where(room >= widest, price, math.inf)
            both = grid.to_go(passed, start) + grid.to_go(passed, end)
            place = grid.places[int(np.where(room == widest, both, math.inf).argmin())]
            narrow = f"the widest way there is {widest:.4f} m from obstacles at {_shown(place)}"
            narrow += f": a tunnel needs {half:g} m"
        if widest + grid.coarse < half:
            raise NoTunnelError(narrow)
        price[room + grid.coarse < half] = math.inf
        return grid, grid.to_go(price, end), narrow

    def _price(self, room: Array) -> Array:
        """Return what a way costs where there is so much room [1]."""
        return np.asarray(1.0 + DEARER * (self._half / np.maximum(room, 0.1 * self._half)) ** 2)

    def _line(self, to: Array, grid: _Grid, to_go: Array, sharpest: float) -> list[_End]:
        """Return the ends of arcs from the entrance to a place (3,); none where none lead there."""
        length = LENGTH * self._half
        curvatures = _curvatures(sharpest, self._planar)
        shares = np.arange(1, SAMPLES + 1) / SAMPLES * length
        steps = [[Turn(s, s * bend, s * climb).end for s in shares] for bend, climb in curvatures]
        points = np.array([T.p for arc in steps for T in arc])
        bent = np.array([math.hypot(*curvature) / sharpest for curvature in curvatures])
        same = SAME * float(bent[bent > 0.0].min()) * sharpest * length
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
            key = (*np.rint(local / (0.5 * length)), *np.rint(self._T.R.T @ T.R[:, 0] / same))
            if key in seen or way + length > self._reach:
                continue
            seen.add(key)
            placed = T.p + points @ T.R.T
            room = self._room(placed).reshape(len(steps), -1)
            ahead = ((placed - self._T.p) @ self._T.R[:, 0]).reshape(len(steps), -1)
            price = self._price(room)
            passes = (room.min(axis=1) > self._half + SPARE) & (ahead.min(axis=1) > -SPARE)
            for k in np.flatnonzero(passes):
                change = math.dist(curvatures[k], before) / sharpest
                dearer = length * float(price[k].mean()) * (1.0 + BENT * float(bent[k]) ** 2)
                end, spent = T @ steps[k][-1], cost + dearer + CHANGED * change
                left = float(to_go[grid.at(end.p)])
                if left < math.inf:
                    heapq.heappush(queue, (spent + left, len(ends)))
                    ends.append(_End(end, curvatures[k], i, spent, way + length))
        return []

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
        narrowest = float(self._room(arcs.at(np.arange(0.0, arcs.length, FINE))[0]).min())
        if narrowest < self._half:
            raise ValueError(f"it would have {narrowest:.4f} m of room: at least {self._half:g} m")
        clearance, nearest = self._kept_clear(backbone)
        x, y, z = arcs.end.p.tolist()
        return FoundTunnel(tuple(pieces), (x, y, z), narrowest, clearance, nearest)

    def _kept_clear(self, backbone: Backbone) -> tuple[float, str]:
        """Return how near links come to an obstacle in any fit [m], and to which.

        Where that takes most of what it is promised. Raises `ValueError` for less than that.
        """
        scene = self._scene
        if not scene.names:
            return math.inf, ""
        links = backbone.chain.points(backbone.fits)
        both = np.concatenate((links, 0.5 * (links[:, 1:] + links[:, :-1])), axis=1)
        off = apart(both.reshape(-1, 3), scene).distance - self._section.link_radius
        at, k = np.unravel_index(int((off - scene.clearance).argmin()), off.shape)
        clearance, name = float(off[at, k]), scene.names[k]
        if clearance < scene.clearance[k]:
            depth = backbone.depth_at(int(at) // both.shape[1])
            raise ValueError(
                f"links would come to {clearance:.4f} m of '{name}' with the tip {depth:.3f} m "
                f"inside: at least {float(scene.clearance[k])} m"
            )
        return clearance, name


def _curvatures(sharpest: float, planar: bool) -> list[tuple[float, float]]:
    """Return those of arcs that may come next, about z and −y: from 0 up to the sharpest."""
    count, shares = (2, (0.25, 0.5, 1.0)) if planar else (8, (0.5, 1.0))
    turned = [2.0 * math.pi * k / count for k in range(count)]
    return [(0.0, 0.0)] + [
        (round(share * sharpest * math.cos(a), 6), round(share * sharpest * math.sin(a), 6))
        for share in shares
        for a in turned
    ]


def _traced(ends: list[_End], last: int) -> list[_End]:
    """Return the ends on the way to one of them, without the entrance."""
    found = list[_End]()
    while last > 0:
        found.append(ends[last])
        last = ends[last].before
    return found[::-1]


def _shown(place: Array) -> str:
    return "({})".format(", ".join(f"{x:.3f}" for x in place))
