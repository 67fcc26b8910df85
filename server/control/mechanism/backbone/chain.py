"""The joints of a mechanism as a chain whose points follow a curve."""

from typing import Self

import numpy as np

from .....config.errors import ConfigError
from .....config.load import Cell
from ...proximity.forest import Branch
from ...scene import Flags
from ...spatial import Array
from .fit import Fitted, Links, fitted_at, points_at

SETTLED = 1e-11
"""A fit from afar goes on until its steps are below this [rad]."""
MOST_STEPS = 200
LONGEST_STEP = 0.3
"""So far from the curve, linearisation is not trusted farther than this [rad]."""
AHEAD = (1, 2, 3)
"""A first guess aims at the point of the curve that is so many links ahead [1]."""


class Chain:
    """A serial chain of n joints; a point is each joint but the first, and the tip."""

    def __init__(self, links: Links, n: int) -> None:
        self.links, self.n = links, n
        straight = self.points(np.zeros((1, n)))[0]
        lengths = np.linalg.norm(np.diff(straight, axis=0), axis=1)
        self.links = links._replace(counts=lengths > 1e-9)
        self.base = straight[0]
        """Where the first joint is, in World (3,) [m]."""
        self._even, self._free = np.ones(n), np.ones(n, dtype=bool)
        self.stations = np.cumsum(lengths)
        """Arc length from the first joint to each point (n,) [m]."""

    @classmethod
    def from_cell(cls, cell: Cell) -> Self:
        """Take that of a cell's only mechanism. Raises `ConfigError` for one that is no chain."""
        m, branch = cell.config.mechanism, Branch(cell, 0, 0)
        body, T = branch.body_of(m.tip_link)
        serial = np.array_equal(branch.tree.parent, np.arange(-1, branch.n - 1))
        if body != branch.n or not serial or branch.tree.prismatic.any():
            raise ConfigError(
                f"{cell.path}: mechanism.backbone: a serial chain of revolute joints is needed"
            )
        root = np.column_stack((branch.T_world_base.R, branch.T_world_base.p))
        tree, counts = branch.tree, np.ones(branch.n, dtype=bool)
        return cls(Links(root, tree.parts, tree.axis, T.p, counts), branch.n)

    @property
    def length(self) -> float:
        """From the first joint to the tip [m]."""
        return float(self.stations[-1])

    def points(self, q: Array) -> Array:
        """Return the first joint and all points (s, n + 1, 3) in World at q (s, n) [rad]."""
        found = np.empty((len(q), self.n + 1, 3))
        points_at(self.links[:], q, found)
        return found

    def fitted(
        self,
        q: Array,
        curve: Array,
        rates: Array,
        iterations: int,
        weights: Array | None = None,
        free: Flags | None = None,
    ) -> Fitted:
        """Return joints near q (n,) that follow points (n, 3) of a curve, and their rates.

        `rates` (n, 3) are the curve's along any parameter; the joints' are along the same. Points
        may have `weights` (n,); joints that are not `free` (n,) stay at q.
        """
        found, slopes = np.empty(self.n), np.empty(self.n)
        weights = self._even if weights is None else weights
        free = self._free if free is None else free
        fitted_at(self.links[:], q, curve, rates, weights, free, iterations, found, slopes)
        return Fitted(found, slopes)

    def guess(self, curve: Array) -> Array:
        """Return joints (n,) that lead roughly along points (n, 3) of a curve, base to tip.

        In the place of eq. 29: each joint turns the link beyond it towards a point ahead.
        """
        guesses = [self._aimed(curve, ahead) for ahead in AHEAD]
        off = self.points(np.stack(guesses))[:, 1:] - curve
        return guesses[int(np.einsum("gij,gij->g", off, off).argmin())]

    def _aimed(self, curve: Array, by: int) -> Array:
        q = np.zeros(self.n)
        for i in range(self.n):
            here, ahead = i, min(i + by, self.n)
            placed, turned = self.points(np.stack((q, q + 1e-6 * (np.arange(self.n) == i))))
            # Of the axis only what it does to the point ahead is needed.
            way, aim = placed[ahead] - placed[here], curve[ahead - 1] - placed[here]
            push = (turned[ahead] - placed[ahead]) / 1e-6
            lever = float(np.linalg.norm(push))
            if lever < 1e-6:
                continue
            across = push / lever
            along = np.cross(across, np.cross(way, push)) / lever
            q[i] = np.arctan2(aim @ across, aim @ along / max(np.linalg.norm(along), 1e-12))
        return q

    def settled(self, q: Array, curve: Array, rates: Array) -> Fitted:
        """Return joints that follow the curve exactly in the least-squares sense, from near q.

        Raises `ValueError` where the iteration does not settle.
        """
        for _ in range(MOST_STEPS):
            found = self.fitted(q, curve, rates, 1)
            step = found.q - q
            way = float(np.abs(step).max())
            q = q + step * min(1.0, LONGEST_STEP / max(way, 1e-300))
            if way < SETTLED:
                return self.fitted(q, curve, rates, 1)
        raise ValueError(f"the joints' fit does not settle: steps of {way:.1e} rad are left")
