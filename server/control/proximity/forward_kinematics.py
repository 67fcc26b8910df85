"""Forward kinematics of a forest of joints at several postures: frames, axes and segments at once.

A joint's frame in its parent's is a constant plus two constants times functions of its angle
(Rodrigues). A parent is a joint before it, or a root, whose pose in World the caller gives.
"""

import math

import numpy as np

from ..compiled import ARRAY3, ARRAY4, INDEX, MATRIX, compiled
from ..scene import Index
from ..spatial import Array
from .records import ROOTS, TREE, Roots, Tree


@compiled(TREE, MATRIX, ROOTS)
def frames_at(tree: Tree, q: Array, roots: Roots) -> Array:
    """Return the joints' frames (s, n, 3, 4) in World at postures q (s, n) [rad or m]."""
    (parents, prismatic, parts, _), (R, p) = tree, roots
    postures, n = q.shape
    found = np.empty((postures, n, 3, 4))
    step = np.empty((3, 4))
    for s in range(postures):
        instant = min(s, len(p) - 1)
        for i in range(n):
            sine, cosine = q[s, i], 0.0
            if not prismatic[i]:
                sine, cosine = math.sin(q[s, i]), 1.0 - math.cos(q[s, i])
            for row in range(3):
                for k in range(4):
                    step[row, k] = parts[i, 0, row, k] + sine * parts[i, 1, row, k]
                    step[row, k] += cosine * parts[i, 2, row, k]
            parent, root = parents[i], -1 - parents[i]
            for row in range(3):
                if parent >= 0:
                    x, y = found[s, parent, row, 0], found[s, parent, row, 1]
                    z, place = found[s, parent, row, 2], found[s, parent, row, 3]
                else:
                    x, y = R[instant, root, row, 0], R[instant, root, row, 1]
                    z, place = R[instant, root, row, 2], p[instant, root, row]
                for k in range(4):
                    found[s, i, row, k] = x * step[0, k] + y * step[1, k] + z * step[2, k]
                found[s, i, row, 3] += place
    return found


@compiled(ARRAY4, MATRIX)
def axes_at(frames: Array, axis: Array) -> Array:
    """Return axes (n, 3), given in frames (s, n, 3, 4), in World (s, n, 3)."""
    postures, n = len(frames), len(axis)
    found = np.empty((postures, n, 3))
    for s in range(postures):
        for j in range(n):
            x, y, z = axis[j]
            for i in range(3):
                found[s, j, i] = (
                    frames[s, j, i, 0] * x + frames[s, j, i, 1] * y + frames[s, j, i, 2] * z
                )
    return found


@compiled(TREE, MATRIX, ROOTS, INDEX, ARRAY3)
def placed_at(
    tree: Tree, q: Array, roots: Roots, body: Index, segments: Array
) -> tuple[Array, Array, Array]:
    """Return segments (c, 2, 3), fixed to bodies (c,), in World (s, c, 2, 3) [m].

    And the joints' frames, as `frames_at` has them, and their axes (s, n, 3).
    """
    frames, (R, p) = frames_at(tree, q, roots), roots
    postures, capsules = len(frames), len(body)
    ends = np.empty((postures, capsules, 2, 3))
    for s in range(postures):
        instant = min(s, len(p) - 1)
        for c in range(capsules):
            joint, root = body[c] - 1, -body[c]
            for row in range(3):
                if joint >= 0:
                    x, y = frames[s, joint, row, 0], frames[s, joint, row, 1]
                    z, place = frames[s, joint, row, 2], frames[s, joint, row, 3]
                else:
                    x, y = R[instant, root, row, 0], R[instant, root, row, 1]
                    z, place = R[instant, root, row, 2], p[instant, root, row]
                for e in range(2):
                    way = x * segments[c, e, 0] + y * segments[c, e, 1] + z * segments[c, e, 2]
                    ends[s, c, e, row] = way + place
    return ends, frames, axes_at(frames, tree[3])
