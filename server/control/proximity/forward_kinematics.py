"""Where the bodies of a serial chain are at several postures: frames, capsules and axes at once.

A joint's frame in the one before it is a constant plus two constants times functions of its angle
(Rodrigues).
"""

import math

import numpy as np

from ..compiled import ARRAY3, ARRAY4, FLAGS, INDEX, MATRIX, VECTOR, compiled
from ..scene import Flags, Index
from ..spatial import Array


@compiled(ARRAY4, FLAGS, MATRIX, MATRIX, VECTOR)
def frames_at(parts: Array, prismatic: Flags, q: Array, R: Array, p: Array) -> Array:
    """Return the joints' frames (s, n, 3, 4) at postures q (s, n), Base at R (3, 3), p (3,).

    `parts` (n, 3, 3, 4) and `prismatic` (n,) are the chain's.
    """
    postures, n = q.shape
    found = np.empty((postures, n, 3, 4))
    step = np.empty((3, 4))
    for s in range(postures):
        for i in range(n):
            sine, cosine = q[s, i], 0.0
            if not prismatic[i]:
                sine, cosine = math.sin(q[s, i]), 1.0 - math.cos(q[s, i])
            for row in range(3):
                for k in range(4):
                    step[row, k] = parts[i, 0, row, k] + sine * parts[i, 1, row, k]
                    step[row, k] += cosine * parts[i, 2, row, k]
            for row in range(3):
                x, y, z, place = R[row, 0], R[row, 1], R[row, 2], p[row]
                if i:
                    x, y = found[s, i - 1, row, 0], found[s, i - 1, row, 1]
                    z, place = found[s, i - 1, row, 2], found[s, i - 1, row, 3]
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


@compiled(ARRAY4, FLAGS, MATRIX, INDEX, ARRAY3, MATRIX, MATRIX, VECTOR)
def placed_at(
    parts: Array, prismatic: Flags, axis: Array, body: Index, segments: Array,
    q: Array, R: Array, p: Array,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Return where segments (c, 2, 3), fixed to bodies (c,), are in World (s, c, 2, 3) [m].

    And the joints' frames, as `frames_at` has them, and their axes (s, n, 3).
    """
    frames = frames_at(parts, prismatic, q, R, p)
    postures, capsules = len(frames), len(body)
    ends = np.empty((postures, capsules, 2, 3))
    for s in range(postures):
        for c in range(capsules):
            joint = body[c] - 1
            for row in range(3):
                x, y, z, place = R[row, 0], R[row, 1], R[row, 2], p[row]
                if joint >= 0:
                    x, y = frames[s, joint, row, 0], frames[s, joint, row, 1]
                    z, place = frames[s, joint, row, 2], frames[s, joint, row, 3]
                for e in range(2):
                    way = x * segments[c, e, 0] + y * segments[c, e, 1] + z * segments[c, e, 2]
                    ends[s, c, e, row] = way + place
    return ends, frames, axes_at(frames, axis)
