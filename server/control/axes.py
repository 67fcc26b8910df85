"""The axes of its MRF that a task holds; what it leaves free is the null space's.

Scott & Carignan 2008, section IV: an arm of three joints whose tool keeps its place alone has one
motion to spare. Williams 1997, section 2.8: freedoms that a task does not need.

A row of the task that is held to the part h, 1 in full and 0 not at all, reads

    h e·(J q̇) + √(1 − h²) σ = h e·ẋ

with a rate σ of no joint, the slack of that row. So its answer in the joints goes over smoothly
from the task's to nothing, and no singular value is lost on the way: those of the rows with their
slack are no less than those of the rows, or than 1 m and 1 rad.
"""

import math
from collections.abc import Collection
from typing import Final, NamedTuple, Self

import numpy as np

from .spatial import Array, rotation_exp, rotation_log

FREE_TIME_S = 0.5
"""An axis is let go of, or held again, within this time [s]."""


AXES: Final = ("x", "y", "z", "rx", "ry", "rz")
"""Names of the axes: along, and about, each axis of the MRF."""


def holding(free: Collection[str]) -> Array | None:
    """Return the axes that are held where those named are `free`: 1 and 0 (6,); None for all."""
    return np.array([float(name not in free) for name in AXES]) if free else None


def faded(now: Array | None, aim: Array | None, step: float) -> Array | None:
    """Return how far the axes (6,) are held a tick later, at most a `step` further [1].

    From 0, free, to 1, held; None: all are held. The `aim` itself once it is reached.
    """
    if now is aim:
        return aim
    before, after = (np.ones(6) if x is None else x for x in (now, aim))
    found: Array = before + np.clip(after - before, -step, step)
    return aim if np.abs(found - after).max() < 1e-9 else found


class HeldAxes(NamedTuple):
    """How a task holds the axes of its MRF in one tick."""

    h: Array
    """Part (6,) of each axis that is held, 0 to 1 [1]."""
    R: Array
    """Axes (3, 3) of the MRF."""
    ranks: tuple[int, int]
    """So many of the rows with their slack are reached: by an arm on a base that stands, and by
    arm and base."""
    keep: Array
    """What is held of a twist (6, 6)."""
    slack: Array
    """Columns (6, f) of the rows that are neither held nor free."""

    @classmethod
    def of(cls, held: Array, R: Array, ranks: tuple[int, int]) -> Self:
        """Return those of axes that are `held` (6,) from 0 to 1, with MRF axes R (3, 3) in World.

        `ranks` are those of the rows that are held in full.
        """
        h = np.sin(0.5 * math.pi * held)
        under = np.flatnonzero((held > 0.0) & (held < 1.0))
        turn = _both(R)
        slack = turn[:, under] * np.cos(0.5 * math.pi * held[under])
        more = len(under)
        return cls(h, R, (ranks[0] + more, ranks[1] + more), (turn * h) @ turn.T, slack)

    @property
    def rank(self) -> int:
        """So many of the rows with their slack are reached by arm and base."""
        return self.ranks[1]

    def rows(self, J: Array) -> Array:
        """Return the task's rows (6, n + f) of a Jacobian of the MRF (6, n), with their slack."""
        rows: Array = self.keep @ J
        return np.hstack([rows, self.slack]) if self.slack.size else rows

    def own(self, J: Array) -> Array:
        """Return the rows (6, n) in the axes of the MRF, without slack: zeros for free axes."""
        return np.asarray((_both(self.R) * self.h).T @ J)

    def part(self, twist: Array) -> Array:
        """Return what is held of a twist (6,) of the MRF."""
        return np.asarray(self.keep @ twist)

    def error(self, error: Array) -> Array:
        """Return what is held of a pose error (6,) of the MRF, rotation by logarithm.

        Where one axis of rotation is free, the rest is what turns that axis to its target by the
        shortest way, however far the tool is turned about it.
        """
        free = np.flatnonzero(self.h[3:] < 1.0)
        if len(free) == 1:
            axis, r = self.R[:, free[0]], error[3:]
            angle = math.sqrt(float(r @ r))
            if angle > 0.0:
                along = math.sin(0.5 * angle) / angle * float(r @ axis)
                about = 2.0 * math.atan2(along, math.cos(0.5 * angle))
                more = (1.0 - float(self.h[3 + free[0]])) * about
                rest = rotation_log(rotation_exp(r) @ rotation_exp(-more * axis))
                error = np.concatenate([error[:3], rest])
        return self.part(error)

    def seen(self, R: Array) -> "HeldAxes":
        """Return the same in other axes, to which R (3, 3) turns World's."""
        turn = _both(R)
        return self._replace(R=R @ self.R, keep=turn @ self.keep @ turn.T, slack=turn @ self.slack)


def _both(R: Array) -> Array:
    """Return what turns twists (6, 6) as R (3, 3) turns vectors."""
    turn = np.zeros((6, 6))
    turn[:3, :3] = turn[3:, 3:] = R
    return turn
