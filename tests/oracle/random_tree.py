"""Trees of postures that grow at random (LaValle, Rapidly-exploring random trees, 1998).

Two searches grow them: `connected` from two postures towards each other (RRT-Connect: Kuffner,
LaValle 2000), and `way_out.py` from one until the arm is out.
"""

import math
from collections.abc import Callable

import numpy as np

from .poses import Array

BRANCHES = 600
"""Random branches that are tried before a way is given up [1]."""
STRIDE = 0.3
"""Length of a branch [rad]."""
LOOK = 0.04
"""Postures are looked at this often along a branch: largest joint step [rad]."""

Step = Callable[[Array], Array | None]
"""The posture (n,) one step on from another; None where no step is free."""
Clear = Callable[[Array], bool]
"""True for a posture (n,) that is free."""


class PostureTree:
    """Postures (n,), each one step from one that was there before."""

    def __init__(self, root: Array) -> None:
        self.nodes = [root.copy()]

    def nearest(self, q: Array) -> Array:
        """Return the posture of the tree that is nearest to q (n,)."""
        return self.nodes[int(np.argmin(((np.array(self.nodes) - q) ** 2).sum(axis=1)))]

    def grow(self, q: Array, step: Step, arrived: Clear, most: int) -> tuple[bool, int]:
        """Add at most so many steps in a row from a posture of the tree.

        Return whether the last one arrived, and how many were tried.
        """
        for tried in range(1, most + 1):
            found = step(q)
            if found is None:
                return False, tried
            self.nodes.append(found)
            if arrived(found):
                return True, tried
            q = found
        return False, most


def connected(
    draw: np.random.Generator, clear: Clear, start: Array, goal: Array, low: Array, high: Array
) -> bool:
    """Return whether a free way between two postures is found, inside bounds (n,) [rad]."""
    if not (clear(start) and clear(goal)):
        return False
    here, there = PostureTree(start), PostureTree(goal)
    if _towards(here, goal, clear, far=True):
        return True
    for _ in range(BRANCHES):
        before = len(here.nodes)
        _towards(here, draw.uniform(low, high), clear, far=False)
        if len(here.nodes) > before and _towards(there, here.nodes[-1], clear, far=True):
            return True
        here, there = there, here
    return False


def _towards(tree: PostureTree, to: Array, clear: Clear, far: bool) -> bool:
    """Grow a tree straight to a posture, one branch or as `far` as it goes; True if it arrived."""
    q = tree.nearest(to)

    def step(q: Array) -> Array | None:
        way = to - q
        part = way * min(1.0, STRIDE / max(float(np.linalg.norm(way)), 1e-12))
        looks = max(1, math.ceil(float(np.abs(part).max()) / LOOK))
        free = all(clear(q + part * (i / looks)) for i in range(1, looks + 1))
        return q + part if free else None

    whole = math.ceil(float(np.linalg.norm(to - q)) / STRIDE) + 1
    most = whole if far else 1
    return tree.grow(q, step, lambda q: bool(np.abs(q - to).max() < 1e-9), most)[0]
