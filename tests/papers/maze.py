"""Chains and tunnels of Chirikjian & Burdick's example, in lengths of the arm."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from telerobot.server.control.backbone.curve import Bow, Chord, Curve
from telerobot.server.control.backbone.fit import Chain, Links
from telerobot.server.control.backbone.tunnels import Arcs, Turn
from telerobot.server.control.forest import Tree
from telerobot.server.control.spatial import Array, Pose, skew

X, Y, Z = np.eye(3)

S1: Final = (1.00, 0.94, 0.83, 0.68, 0.54, 0.44)
"""The free lengths of figures 4 and 5."""
H, L = 0.4, 0.2
"""Distance of the entrance, and length of each semicircle: figure 3."""

ENTRANCE = Pose.from_xyz_rpy((0.0, H, 0.0), (0.0, 0.0, np.pi / 2))
MAZE = Curve(
    Bow(Chord(np.zeros(3), np.stack((X, Y)), H)),
    Arcs.from_entrance(ENTRANCE, [Turn(L, np.pi), Turn(L, -np.pi), Turn(L, np.pi)]),
)

FED = MAZE._replace(fed=0.3, longest=1.0)
"""The same with a base that advances, from where it was with all of the arm outside."""

SPACE = Curve(
    Bow(Chord(np.zeros(3), np.stack(((X + Z) / np.sqrt(2), Y)), H)),
    Arcs.from_entrance(
        ENTRANCE, [Turn(0.2, np.pi / 2), Turn(0.15, 0.0, np.pi / 3), Turn(0.15, 0.0, -np.pi / 3)]
    ),
)
"""A tunnel in space, of our own."""


def chain(axes: Sequence[Array], lengths: Sequence[float]) -> Chain:
    """Return a chain of joints about axes (n, 3) with links of lengths (n,), straight along y."""
    n = len(axes)
    parts = np.zeros((n, 3, 3, 4))
    for i, axis in enumerate(axes):
        K = skew(np.asarray(axis, dtype=float))
        parts[i, 0, :, :3] = np.eye(3)
        parts[i, 0, 1, 3] = lengths[i - 1] if i else 0.0
        parts[i, 1, :, :3], parts[i, 2, :, :3] = K, K @ K
    tree = Tree(np.arange(-1, n - 1), np.zeros(n, dtype=bool), parts, np.array(axes, dtype=float))
    tip, counts = np.array([0.0, lengths[-1], 0.0]), np.ones(n, dtype=bool)
    return Chain(Links(tree[:], np.eye(3)[None], np.zeros((1, 3)), tip, counts), n)


def fed(n: int) -> Chain:
    """Return n joints: a feed along y, and behind it the planar arm."""
    arm = planar(n - 1).links
    parent, _, parts, axis = arm.tree
    rail = np.zeros((1, 3, 3, 4))
    rail[0, 0, :, :3], rail[0, 1, :, 3] = np.eye(3), Y
    tree = Tree(
        np.append(-1, parent + 1),
        np.arange(n) == 0,
        np.concatenate((rail, parts)),
        np.concatenate((Y[None], axis)),
    )
    return Chain(arm._replace(tree=tree[:], counts=np.ones(n, dtype=bool)), n)


def planar(n: int) -> Chain:
    """Return n joints about z: the arm of eqs. 26–28."""
    return chain([Z] * n, [1.0 / n] * n)


def alternating(n: int) -> Chain:
    """Return n joints about z and x in turn."""
    return chain([Z, X] * (n // 2), [1.0 / n] * n)


def universal(n: int) -> Chain:
    """Return n joints in pairs about z and x, without a link inside a pair."""
    return chain([Z, X] * (n // 2), [0.0, 2.0 / n] * (n // 2))


def planar_points(q: Array) -> tuple[Array, Array]:
    """Points (k, n, 2) of chains (k, n) of length 1, by eqs. 26 and 27, and their Jacobians."""
    angle = np.cumsum(q, axis=1)
    links = np.stack((-np.sin(angle), np.cos(angle)), axis=2) / q.shape[1]
    points = np.cumsum(links, axis=1)
    begins = np.concatenate((np.zeros((len(q), 1, 2)), points[:, :-1]), axis=1)
    ways = points[:, :, None] - begins[:, None]
    turned = np.stack((-ways[..., 1], ways[..., 0]), axis=2)
    return points, turned * np.tri(q.shape[1])[None, :, None]


def descended(q: Array, goal: Array, weights: Array, steps: int) -> tuple[Array, Array]:
    """Joints (k, n) of locally least weighted sums of squares, and these: dense, no structure used.

    Levenberg and Marquardt's method from joints (k, n) to points (n, 2) with weights (n,).
    """
    k, n = q.shape
    damping = np.full(k, 1e-3)

    def residuals(q: Array) -> tuple[Array, Array]:
        points, J = planar_points(q)
        root = np.sqrt(weights)[:, None]
        return ((points - goal) * root).reshape(k, -1), (J * root[..., None]).reshape(k, 2 * n, n)

    r, J = residuals(q)
    for _ in range(steps):
        JT = J.transpose(0, 2, 1)
        H = JT @ J + damping[:, None, None] * np.eye(n) * 1e-2
        tried = q - np.linalg.solve(H, JT @ r[..., None])[..., 0]
        r_tried, J_tried = residuals(tried)
        better = (r_tried**2).sum(axis=1) < (r**2).sum(axis=1)
        q = np.where(better[:, None], tried, q)
        r, J = np.where(better[:, None], r_tried, r), np.where(better[:, None, None], J_tried, J)
        damping = np.where(better, 0.2 * damping, 10.0 * damping).clip(1e-12, 1e6)
    return q, (r**2).sum(axis=1)
