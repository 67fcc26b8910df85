"""Search for a way out of an arm among obstacles, by other means than the server's.

A tree of postures grows from the arm's (`random_tree.py`): each is a small step from one that is
there, the best one for an aim that keeps the gaps to first order; what a curved way then falls
short by is put right, and the gaps themselves are looked at, half way and in the end. Those to
things are the physics' own, those between links are of the oracle's own model of the arm. A gap
below the promise may not become smaller, joints keep their limits, and what moves stands. A way out
is one on which

- the least gap to things grows by `WIDER`, or
- the tool goes by `AWAY` without being turned by more than `TURNED`.

First all that needs no chance is tried from the posture: the fastest widening of the least gap (a
linear programme), and the straight ways of the tool, not turned, in 26 directions. Then trees grow
from several draws: towards postures drawn at random, away from things, or along a way of the tool;
and where each branch ends, the same aims are tried again, straight ways where it has come already.

A search can show that there is a way; that there is none, it makes likely.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import product
from typing import NamedTuple

import daqp
import numpy as np
from numpy.typing import NDArray
from telerobot.config.drives import joint_bounds
from telerobot.config.load import Cell
from telerobot.drivers.rig.physics.world import World

from .arm import OracleArm
from .poses import Array, difference
from .random_tree import PostureTree

Flags = NDArray[np.bool_]

WIDER = 0.01
"""The least gap has grown by so much [m]."""
AWAY = 0.03
"""Or the tool has gone so far [m] …"""
TURNED = 0.1
"""… and turned by no more than this: a straight way asks for no turn [rad]."""
HELD = 2e-4
"""A gap below the promise may shrink by so much in all: twice what the daemon lets it [m]."""
DRAWS = 3
"""Number of trees that are grown at random, one after the other [1]."""
TRIES = 600
"""Number of steps that are tried for each of them [1]."""
STEP = 0.1
"""Most that a joint turns from one posture to the next [rad]."""
LEAST = 1e-3
"""A step in which no joint turns so far leads nowhere [rad]."""
IN_A_ROW = 12
"""Most steps with one aim [1]."""
SHORTER = 0.35
"""A step on which a gap is not kept is tried again at this share of its size [1] …"""
SHORTENED = 4
"""… and so often in all [1]."""
CORRECTIONS = 3
"""Most corrections of a step that leaves a gap too small [1]."""
NEAR = 0.05
"""Extra distance beyond which a pair does not matter for a step [m]."""
FAR = 0.15
"""Gaps count up to this [m]."""
TURN_WEIGHT = 0.15
"""A turn of the tool counts as this lever on its straight way [m/rad]."""
ONWARD = 3
"""Number of straight ways that are tried from the end of a branch [1]."""

WAYS = np.array([way for way in product((-1.0, 0.0, 1.0), repeat=3) if any(way)])
WAYS /= np.linalg.norm(WAYS, axis=1)[:, None]


class Programme(NamedTuple):
    """½ xᵀH x + fᵀx over the joint motion and what else an aim needs, with A x ≥ least."""

    H: Array
    f: Array
    A: Array
    least: Array

    @staticmethod
    def nearest(wish: Array) -> "Programme":
        """Return that of the motion nearest to a wish (n,) [rad]."""
        n = len(wish)
        return Programme(np.eye(n), -wish, np.zeros((0, n)), np.zeros(0))


Aim = Callable[[Array, Array, Array], Programme]
"""What a step is to do at a posture (n,), where there are gaps (k,), with slopes (k, n)."""


def closed_in(cell: Cell, world: World, postures: Sequence[Array], promise: float) -> bool:
    """Return whether no way out is found from any of some postures (n,) [rad] of a cell's arm."""
    return not any(way_out(cell, world, q, promise) for q in postures)


def way_out(
    cell: Cell,
    world: World,
    q: Array,
    promise: float,
    held: float = HELD,
    draws: Iterable[int] = range(DRAWS),
) -> bool:
    """Return whether a way out is found for the arm of a cell at joint angles q (n,) [rad].

    `promise` is the clearance that is kept from things [m], which stand where `world` has them; a
    gap below it may shrink by `held` [m] in all. The posture of `world` is changed.
    """
    search = _Search(cell, world, q, promise, held)
    return search.found_directly() or any(search.found_at_random(draw) for draw in draws)


class _Search:
    """The tree, and what its postures keep; joint arrays are (n,)."""

    def __init__(self, cell: Cell, world: World, q: Array, promise: float, held: float) -> None:
        bounds = joint_bounds(cell.robot.joints, cell.config.mechanism.drives)
        self._arm, self._world = OracleArm.of(cell), world
        self._low = np.minimum(q, bounds.lower)
        self._high = np.maximum(q, bounds.upper)
        gaps = self._gaps(q)
        promised = np.full(len(gaps), promise)
        promised[-1] = cell.config.avoidance.self_clearance
        self._floor = np.minimum(promised, gaps) - held
        self._wanted = float(gaps[:-1].min()) + WIDER
        self._start = self._arm.tool(q)
        self._tree = PostureTree(q)
        self._tried = 0

    def found_directly(self) -> bool:
        """Return whether one aim leads out all the way."""
        q = self._tree.nodes[0]
        return any(self._grow(q, aim) for aim in (self._widened, *map(self._gone, WAYS)))

    def found_at_random(self, seed: int) -> bool:
        """Grow a tree until it leads out, or enough is tried; return whether it does."""
        draw = np.random.default_rng(seed)
        self._tree, self._tried = PostureTree(self._tree.nodes[0]), 0
        while self._tried < TRIES:
            before = len(self._tree.nodes)
            if self._grow(*self._drawn(draw)):
                return True
            if len(self._tree.nodes) == before:
                continue
            q = self._tree.nodes[-1]
            ahead = WAYS @ difference(self._arm.tool(q), self._start)[:3]
            onward = WAYS[np.argsort(-ahead)[:ONWARD]]
            if any(self._grow(q, aim) for aim in (self._widened, *map(self._gone, onward))):
                return True
        return False

    def _drawn(self, draw: np.random.Generator) -> tuple[Array, Aim]:
        """Draw a posture of the tree, and an aim from there on."""
        nodes, kind = self._tree.nodes, int(draw.integers(3))
        if kind == 0:
            target = draw.uniform(self._low, self._high)
            return self._tree.nearest(target), lambda q, *_: Programme.nearest(_short(target - q))
        q = nodes[-1] if draw.random() < 0.5 else nodes[int(draw.integers(len(nodes)))]
        if kind == 1:
            weights = draw.random(len(self._floor))
            return q, lambda _, __, slopes: Programme.nearest(_long(weights @ slopes))
        way = draw.normal(size=3)
        return q, lambda q, *_: Programme.nearest(
            _long(np.linalg.pinv(self._arm.jacobian(q), rcond=0.05)[:, :3] @ way)
        )

    def _gone(self, way: Array) -> Aim:
        """Return the aim that the tool goes by `AWAY` one way (3,), and is not turned."""
        target = self._start.copy()
        target[:3, 3] += 1.1 * AWAY * way
        weights = np.repeat([1.0, TURN_WEIGHT**2], 3)

        def aim(q: Array, gaps: Array, slopes: Array) -> Programme:
            J, missing = self._arm.jacobian(q), difference(target, self._arm.tool(q))
            nearest = Programme.nearest(np.zeros(len(q)))
            H = (J.T * weights) @ J + 1e-6 * nearest.H
            return nearest._replace(H=H, f=-(J.T * weights) @ missing)

        return aim

    def _widened(self, q: Array, gaps: Array, slopes: Array) -> Programme:
        """Return the programme of the greatest least gap to things."""
        n, things = len(q), gaps[:-1]
        counted = np.flatnonzero(things < min(things.min() + NEAR, FAR))
        rows = np.hstack([slopes[counted], -np.ones((len(counted), 1))])
        f = np.zeros(n + 1)
        f[n] = -1.0
        return Programme(1e-7 * np.eye(n + 1), f, rows, -gaps[counted])

    def _grow(self, q: Array, aim: Aim) -> bool:
        out, tried = self._tree.grow(q, partial(self._step, aim), self._out, IN_A_ROW)
        self._tried += tried
        return out

    def _step(self, aim: Aim, q: Array) -> Array | None:
        """Return the posture one step from q for an aim, with gaps kept up to it; None for none."""
        gaps, n = self._gaps(q), len(q)
        near = gaps - self._floor < NEAR
        slopes = self._slopes(q, near)
        H, f, A, least = aim(q, gaps, slopes)
        rows = np.vstack([np.pad(slopes[near], ((0, 0), (0, len(f) - n))), A])
        least = np.concatenate([(self._floor - gaps)[near], least])
        size = STEP
        for _ in range(SHORTENED):
            low, high = np.maximum(self._low - q, -size), np.minimum(self._high - q, size)
            change = solved(Programme(H, f, rows, least), low, high)[:n]
            found = self._corrected(np.clip(q + change, self._low, self._high), size)
            if np.abs(found - q).max() < LEAST:
                return None
            if all((self._gaps(p) >= self._floor).all() for p in (found, 0.5 * (q + found))):
                return found
            size *= SHORTER
        return None

    def _corrected(self, q: Array, size: float) -> Array:
        """Return a posture whose gaps are kept, if some small corrections lead to one."""
        for _ in range(CORRECTIONS):
            gaps = self._gaps(q)
            if (gaps >= self._floor).all():
                break
            near = gaps - self._floor < NEAR
            least = (self._floor - gaps)[near] + 1e-5
            wish = Programme.nearest(np.zeros(len(q)))
            wish = wish._replace(A=self._slopes(q, near)[near], least=least)
            low, high = np.maximum(self._low - q, -size), np.minimum(self._high - q, size)
            q = np.clip(q + solved(wish, low, high), self._low, self._high)
        return q

    def _out(self, q: Array) -> bool:
        """Return whether the arm has left."""
        if float(self._gaps(q)[:-1].min()) > self._wanted:
            return True
        gone = difference(self._arm.tool(q), self._start)
        return bool(np.linalg.norm(gone[:3]) > AWAY and np.linalg.norm(gone[3:]) < TURNED)

    def _gaps(self, q: Array) -> Array:
        """Return the gaps to things, and last the least between links, at most `FAR` [m]."""
        self._world.q[:] = q
        return np.append(self._world.distances.gaps(FAR), min(self._arm.clearance(q)[1], FAR))

    def _slopes(self, q: Array, near: Flags) -> Array:
        """Return the slopes of the gaps (k, n) [m/rad] by differences, of those `near`; else 0."""
        found = np.zeros((len(near), len(q)))
        for j, aside in enumerate(1e-5 * np.eye(len(q))):
            change = self._gaps(q + aside) - self._gaps(q - aside)
            found[near, j] = change[near] / 2e-5
        return found


def _long(way: Array) -> Array:
    """Return a way (n,) scaled to a whole step [rad]."""
    return np.asarray(way * STEP / max(float(np.abs(way).max()), 1e-12))


def _short(way: Array) -> Array:
    """Return a way (n,) scaled to a whole step, if it is longer [rad]."""
    return way if float(np.abs(way).max()) < STEP else _long(way)


def solved(programme: Programme, low: Array, high: Array) -> Array:
    """Return the best x (m,) with low ≤ x ≤ high (n,) in its first n; 0 where none is found."""
    (H, f, A, least), n = programme, len(low)
    free = np.full(len(f) - n, 10.0)
    upper = np.concatenate([high, free, np.full(len(A), np.inf)])
    lower = np.concatenate([low, -free, least])
    x, _, flag, _ = daqp.solve(
        H, f, np.ascontiguousarray(A), upper, lower, np.zeros_like(lower, dtype=np.int32)
    )
    return np.asarray(x) if flag > 0 else np.zeros(len(f))
