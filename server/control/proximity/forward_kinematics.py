"""Forward kinematics of a forest of joints at several postures: frames, axes and segments at once.

A joint's frame in its parent's is a constant plus two constants times functions of its angle
(Rodrigues). A parent is a joint before it, or a root, whose pose in World the caller gives.
"""

import math

import numpy as np

from ..compiled import ARRAY3, ARRAY4, BLOCK, INDEX, MATRIX, STACK, compiled
from ..scene import Index
from ..spatial import Array
from .records import ROOTS, TREE, Roots, Tree


def frames_at(tree: Tree, q: Array, roots: Roots) -> Array:
    """Return the joints' frames (s, n, 3, 4) in World at postures q (s, n) [rad or m]."""
    found = np.empty((*q.shape, 3, 4))
    _frame(tree, q, roots, found)
    return found


@compiled(TREE, MATRIX, ROOTS, BLOCK)
def _frame(tree: Tree, q: Array, roots: Roots, found: Array) -> None:
    (parents, prismatic, parts, _), (R, p) = tree, roots
    postures, n = q.shape
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


def axes_at(frames: Array, axis: Array) -> Array:
    """Return axes (n, 3), given in frames (s, n, 3, 4), in World (s, n, 3)."""
    found = np.empty((len(frames), len(axis), 3))
    _turn(frames, axis, found)
    return found


@compiled(ARRAY4, MATRIX, STACK)
def _turn(frames: Array, axis: Array, found: Array) -> None:
    for s in range(len(frames)):
        for j in range(len(axis)):
            x, y, z = axis[j]
            for i in range(3):
                found[s, j, i] = (
                    frames[s, j, i, 0] * x + frames[s, j, i, 1] * y + frames[s, j, i, 2] * z
                )


def placed_at(
    tree: Tree, q: Array, roots: Roots, body: Index, segments: Array
) -> tuple[Array, Array, Array]:
    """Return segments (c, 2, 3), fixed to bodies (c,), in World (s, c, 2, 3) [m].

    And the joints' frames, as `frames_at` has them, and their axes (s, n, 3).
    """
    postures, n = q.shape
    ends, frames = np.empty((postures, len(body), 2, 3)), np.empty((postures, n, 3, 4))
    axes = np.empty((postures, n, 3))
    _place(tree, q, roots, body, segments, ends, frames, axes)
    return ends, frames, axes


@compiled(TREE, MATRIX, ROOTS, INDEX, ARRAY3, BLOCK, BLOCK, STACK)
def _place(
    tree: Tree,
    q: Array,
    roots: Roots,
    body: Index,
    segments: Array,
    ends: Array,
    frames: Array,
    axes: Array,
) -> None:
    _frame(tree, q, roots, frames)
    _turn(frames, tree[3], axes)
    (R, p), capsules = roots, len(body)
    for s in range(len(frames)):
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
