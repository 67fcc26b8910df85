"""Search for a way out of an arm among obstacles, by other means than the server's.

A tree of postures grows from the arm's (`random_tree.py`): each is a small step from one that is
there, towards a posture drawn at random, away from things or along a straight way of the tool. It
is the nearest step that keeps the gaps to first order; then the gaps
themselves are looked at, half way and in the end. Those to things are the physics' own, those
between links are of the oracle's own model of the arm. A gap below the promise may not become
smaller, joints keep their limits, and what moves stands. A way out is one on which

- the least gap to things grows by `WIDER`, or
- the tool goes by `AWAY` without being turned by more than `TURNED`.

A search can show that there is a way; that there is none, it makes likely.
"""

from collections.abc import Callable, Sequence
from functools import partial

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

Wish = Callable[[Array, Array], Array]
"""Joint motion (n,) wished for at a posture (n,), where gaps have slopes (k, n)."""

WIDER = 0.01
"""The least gap has grown by so much [m]."""
AWAY = 0.03
"""Or the tool has gone so far [m] …"""
TURNED = 0.1
"""… and turned by no more than this: a straight way asks for no turn [rad]."""
HELD = 2e-4
"""A gap below the promise may shrink by so much in all: twice what the daemon lets it [m]."""
POSTURES = 600
"""Number of tries [1]."""
STEP = 0.1
"""Most that a joint turns from one to the next [rad]."""
LEAST = 2e-3
"""A step in which no joint turns so far leads nowhere [rad]."""
IN_A_ROW = 12
"""Most steps one way [1]."""
NEAR = 0.05
"""Extra distance beyond which a pair does not matter for a step [m]."""
FAR = 0.15
"""Gaps count up to this [m]."""


def closed_in(cell: Cell, world: World, postures: Sequence[Array], promise: float) -> bool:
    """Return whether no way out is found from any of some postures (n,) [rad] of a cell's arm."""
    return not any(way_out(cell, world, q, promise) for q in postures)


def way_out(cell: Cell, world: World, q: Array, promise: float, held: float = HELD) -> bool:
    """Return whether a way out is found for the arm of a cell at joint angles q (n,) [rad].

    `promise` is the clearance that is kept from things [m], which stand where `world` has them; a
    gap below it may shrink by `held` [m] in all. The posture of `world` is changed.
    """
    return _Search(cell, world, q, promise, held).found()


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
        self._draw = np.random.default_rng(0)

    def found(self) -> bool:
        """Grow the tree until it leads out, or enough is tried; return whether it does."""
        tried = 0
        while tried < POSTURES:
            q, wish = self._aim()
            out, steps = self._tree.grow(q, partial(self._step, wish), self._out, IN_A_ROW)
            if out:
                return True
            tried += steps
        return False

    def _aim(self) -> tuple[Array, Wish]:
        """Draw a posture of the tree, and what is wished for from there on."""
        draw, nodes = self._draw, self._tree.nodes
        kind = int(draw.integers(3))
        if kind == 0:
            target = draw.uniform(self._low, self._high)
            return self._tree.nearest(target), lambda q, _: target - q
        q = nodes[-1] if draw.random() < 0.5 else nodes[int(draw.integers(len(nodes)))]
        if kind == 1:
            weights = draw.random(len(self._floor))
            return q, lambda _, slopes: weights @ slopes
        way = draw.normal(size=3)
        return q, lambda q, _: np.linalg.pinv(self._arm.jacobian(q), rcond=0.05)[:, :3] @ way

    def _step(self, wish: Wish, q: Array) -> Array | None:
        """Return a posture on the wished way from q, with gaps kept up to it; None for none."""
        gaps = self._gaps(q)
        near = gaps - self._floor < NEAR
        slopes = self._slopes(q, near)
        way, identity, size = wish(q, slopes), np.eye(len(q)), STEP
        for _ in range(3):
            way = way * min(1.0, size / max(float(np.abs(way).max()), 1e-12))
            low, high = np.maximum(self._low - q, -size), np.minimum(self._high - q, size)
            A = np.vstack([slopes[near], identity, -identity])
            change = projected(way, A, np.concatenate([(self._floor - gaps)[near], low, -high]))
            found = np.clip(q + change, self._low, self._high)
            if np.abs(found - q).max() < LEAST:
                return None
            if all((self._gaps(p) >= self._floor).all() for p in (found, 0.5 * (q + found))):
                return found
            size *= 0.4
        return None

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


def projected(wish: Array, A: Array, least: Array) -> Array:
    """Return the x (n,) nearest to `wish` with A x ≥ least (k,); 0 where none is found."""
    n, k = len(wish), len(least)
    unbounded, of_each = np.full(k, np.inf), np.zeros(k, dtype=np.int32)
    x, _, flag, _ = daqp.solve(np.eye(n), -wish, A, unbounded, least, of_each)
    return np.asarray(x) if flag > 0 else np.zeros(n)
