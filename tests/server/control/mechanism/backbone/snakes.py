"""Chains and tunnels of the paper's example, for the backbone's tests."""

import numpy as np
from telerobot.server.control.backbone.curve import Bow, Chord, Curve
from telerobot.server.control.backbone.fit import Chain, Links
from telerobot.server.control.backbone.tunnels import Arcs, Turn
from telerobot.server.control.spatial import Pose, skew

X, Y, Z = np.eye(3)

S1 = (1.00, 0.94, 0.83, 0.68, 0.54, 0.44)
"""The free lengths of the paper's figures 4 and 5."""

ENTRANCE = Pose.from_xyz_rpy((0.0, 0.4, 0.0), (0.0, 0.0, np.pi / 2))
MAZE = Curve(
    Bow(Chord(np.zeros(3), np.stack((X, Y)), 0.4)),
    Arcs.from_entrance(ENTRANCE, [Turn(0.2, np.pi), Turn(0.2, -np.pi), Turn(0.2, np.pi)]),
)
"""Its figure 3: h = 0.4, L = 0.2, in lengths of the arm."""

SPACE = Curve(
    Bow(Chord(np.zeros(3), np.stack(((X + Z) / np.sqrt(2), Y)), 0.4)),
    Arcs.from_entrance(
        ENTRANCE, [Turn(0.2, np.pi / 2), Turn(0.15, 0.0, np.pi / 3), Turn(0.15, 0.0, -np.pi / 3)]
    ),
)


def chain(axes, lengths):
    """Return a chain of joints about axes (n, 3) with links of lengths (n,), straight along y."""
    n = len(axes)
    parts = np.zeros((n, 3, 3, 4))
    for i, axis in enumerate(axes):
        K = skew(np.asarray(axis, dtype=float))
        parts[i, 0, :, :3] = np.eye(3)
        parts[i, 0, 1, 3] = lengths[i - 1] if i else 0.0
        parts[i, 1, :, :3], parts[i, 2, :, :3] = K, K @ K
    root = np.column_stack((np.eye(3), np.zeros(3)))
    tip = np.array([0.0, lengths[-1], 0.0])
    links = Links(root, parts, np.array(axes, dtype=float), tip, np.ones(n, dtype=bool))
    return Chain(links, n)


def planar(n):
    return chain([Z] * n, [1.0 / n] * n)


def alternating(n):
    return chain([Z, X] * (n // 2), [1.0 / n] * n)


def universal(n):
    return chain([Z, X] * (n // 2), [0.0, 2.0 / n] * (n // 2))
