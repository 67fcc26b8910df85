"""Joints of a chain that follow a curve: nonlinear least squares in O(n), by recursion."""

from typing import NamedTuple, Self

import numpy as np

from ....config.errors import ConfigError
from ....config.load import Cell
from ..compiled import (
    ARRAY3,
    COUNT,
    FLAGS,
    MATRIX,
    ROW,
    STACK,
    VECTOR,
    compiled,
    inner_kernel,
    record,
)
from ..forest import TREE, Branch, TreeArrays, axes_of, frames_of
from ..scene import Flags
from ..spatial import Array, Pose

# --- Joints of a chain that follow a curve: nonlinear least squares in O(n), by recursion ---------
#
# Chirikjian & Burdick, eqs. 26 to 30: the sum of squared distances between the chain's points
# and the curve's, at the same arc lengths, is least. What is sought are the joints' angles
# themselves, in place of the ε of eq. 29: so planar, universal and alternating chains are one
# case, and no attitude is a singularity. Each linearised step is a linear-quadratic problem
# along the chain: a joint moves all that is outboard, and what it does to that is a quadratic
# form of six numbers,
#
#     ξ = (ω, v): displacement of all that is outboard, seen at World's origin
#     cost to go of ξ after joint i:  ½ ξᵀ S ξ + gᵀ ξ
#     at each point p:  S += HᵀH, g += Hᵀ r,  where H ξ = v + ω × p
#     joint i adds s u, s = (a; o × a):   u = −(s·S ξ + s·g) / (s·S s)
#
# and s = (0; a) where it slides, as a feed does that carries the chain's foot.
#
# Backward S and g, forward ξ and u. The joints' rates along the curve's parameter are the same
# pass with the curve's own rates as the residual.

FLAT = 1e-14
"""A joint whose own motion costs less than this [m²/rad²] moves nothing, and stays."""

LINKS = record(TREE, ARRAY3, MATRIX, VECTOR, FLAGS)
"""`Links` as kernels take it."""
LinkArrays = tuple[TreeArrays, Array, Array, Array, Flags]


class Links(NamedTuple):
    """A serial chain of n joints, as arrays: they turn, but the first may slide."""

    tree: TreeArrays
    R: Array
    """Attitude of its only root in World (1, 3, 3)."""
    p: Array
    """And where that is (1, 3) [m]."""
    tip: Array
    """In the last joint's frame (3,) [m]."""
    counts: Flags
    """Which points count (n,): each joint but the first, and the tip. One that falls on the point
    before it, as between the axes of a universal joint, does not count twice."""


class Fitted(NamedTuple):
    """Joints that follow a curve."""

    q: Array
    """(n,) [rad]"""
    rates: Array
    """Their derivative along the curve's parameter (n,)."""


@inner_kernel
def _place(links: LinkArrays, q: Array, frames: Array, axes: Array, points: Array) -> None:
    """Write the joints' frames (n, 3, 4), axes, and the points that follow (n, 3), in World."""
    tree, R, p, tip, _ = links
    last = len(q) - 1
    frames_of(tree, q, R, p, frames)
    axes_of(frames, tree[3], axes)
    for row in range(3):
        for i in range(last):
            points[i, row] = frames[i + 1, row, 3]
        points[last, row] = frames[last, row, 3]
        for k in range(3):
            points[last, row] += frames[last, row, k] * tip[k]


@compiled(LINKS, MATRIX, STACK)
def points_at(links: LinkArrays, q: Array, found: Array) -> None:
    """Write the base and all points (s, n + 1, 3) in World [m] at postures q (s, n) [rad]."""
    n = q.shape[1]
    frames, axes, points = np.empty((n, 3, 4)), np.empty((n, 3)), np.empty((n, 3))
    for s in range(len(q)):
        _place(links, q[s], frames, axes, points)
        for row in range(3):
            found[s, 0, row] = frames[0, row, 3]
            for i in range(n):
                found[s, i + 1, row] = points[i, row]


@compiled(MATRIX, MATRIX, COUNT)
def farthest_apart(one: Array, other: Array, first: int) -> float:
    """Return how far the `first` points of two postures (n + 1, 3) are apart at most [m]."""
    most = 0.0
    for i in range(min(first, len(one))):
        square = 0.0
        for k in range(3):
            square += (one[i, k] - other[i, k]) ** 2
        most = max(most, square)
    return float(np.sqrt(most))


@compiled(LINKS, VECTOR, MATRIX, MATRIX, VECTOR, FLAGS, COUNT, ROW, ROW)
def fitted_at(
    links: LinkArrays,
    q: Array,
    curve: Array,
    rates: Array,
    weights: Array,
    free: Flags,
    iterations: int,
    found: Array,
    slopes: Array,
) -> None:
    """Write joints (n,) near q (n,) that follow points (n, 3) of a curve, and their rates (n,).

    `rates` (n, 3) are the curve's along any parameter; the joints' are along the same. `weights`
    (n,) are those of the points' squared distances; joints that are not `free` (n,) stay at q.
    """
    n = len(q)
    for i in range(n):
        found[i], slopes[i] = q[i], 0.0
    prismatic, counts = links[0][1], links[4]
    frames, axes, points = np.empty((n, 3, 4)), np.empty((n, 3)), np.empty((n, 3))
    s, b = np.empty((n, 6)), np.empty(6)
    K, k = np.zeros((n, 6)), np.zeros((n, 2))
    S, g = np.empty((6, 6)), np.empty((6, 2))
    r, moved = np.empty((3, 2)), np.empty((6, 2))
    for _ in range(iterations):
        _place(links, found, frames, axes, points)
        for u in range(6):
            g[u, 0], g[u, 1] = 0.0, 0.0
            for v in range(6):
                S[u, v] = 0.0
        for i in range(n - 1, -1, -1):
            if counts[i]:
                x, y, z, w = points[i, 0], points[i, 1], points[i, 2], weights[i]
                # HᵀH and Hᵀr of H = (−[p]×, 1)
                S[0, 0] += w * (y * y + z * z)
                S[1, 1] += w * (x * x + z * z)
                S[2, 2] += w * (x * x + y * y)
                S[1, 0] -= w * (x * y)
                S[2, 0] -= w * (x * z)
                S[2, 1] -= w * (y * z)
                S[3, 1] += w * z
                S[3, 2] -= w * y
                S[4, 0] -= w * z
                S[4, 2] += w * x
                S[5, 0] += w * y
                S[5, 1] -= w * x
                for row in range(3):
                    S[3 + row, 3 + row] += w
                    r[row, 0] = w * (points[i, row] - curve[i, row])
                    r[row, 1] = -w * rates[i, row]
                for c in range(2):
                    g[0, c] += y * r[2, c] - z * r[1, c]
                    g[1, c] += z * r[0, c] - x * r[2, c]
                    g[2, c] += x * r[1, c] - y * r[0, c]
                    for row in range(3):
                        g[3 + row, c] += r[row, c]
            ax, ay, az = axes[i, 0], axes[i, 1], axes[i, 2]
            ox, oy, oz = frames[i, 0, 3], frames[i, 1, 3], frames[i, 2, 3]
            s[i, 0], s[i, 1], s[i, 2] = ax, ay, az
            s[i, 3], s[i, 4], s[i, 5] = oy * az - oz * ay, oz * ax - ox * az, ox * ay - oy * ax
            if prismatic[i]:
                s[i, 0], s[i, 1], s[i, 2] = 0.0, 0.0, 0.0
                s[i, 3], s[i, 4], s[i, 5] = ax, ay, az
            stiff = 0.0
            for u in range(6):
                b[u] = 0.0
                for v in range(6):
                    b[u] += (S[u, v] if u >= v else S[v, u]) * s[i, v]
                stiff += s[i, u] * b[u]
            if stiff < FLAT or not free[i]:
                k[i, 0], k[i, 1] = 0.0, 0.0
                for u in range(6):
                    K[i, u] = 0.0
                continue
            for c in range(2):
                along = 0.0
                for u in range(6):
                    along += s[i, u] * g[u, c]
                k[i, c] = along / stiff
                for u in range(6):
                    g[u, c] -= b[u] * k[i, c]
            for u in range(6):
                K[i, u] = b[u] / stiff
                for v in range(u + 1):
                    S[u, v] -= b[u] * b[v] / stiff
        for v in range(6):
            moved[v, 0], moved[v, 1] = 0.0, 0.0
        for i in range(n):
            for c in range(2):
                u = -k[i, c]
                for v in range(6):
                    u -= K[i, v] * moved[v, c]
                for v in range(6):
                    moved[v, c] += s[i, v] * u
                if c == 0:
                    found[i] += u
                else:
                    slopes[i] = u


# --- The joints of a mechanism as a chain whose points follow a curve -----------------------------

SETTLED = 1e-11
"""A fit from afar goes on until its steps are below this [rad]."""
MOST_STEPS = 200
LONGEST_STEP = 0.3
"""So far from the curve, linearisation is not trusted farther than this [rad]."""
AHEAD = (1, 2, 3)
"""A first guess aims at the point of the curve that is so many links ahead [1]."""


class Chain:
    """A serial chain of n joints; a point is each joint but the first, and the tip.

    Its foot is the first joint that turns: the one before it, if any, is a feed.
    """

    def __init__(self, links: Links, n: int) -> None:
        self.links, self.n = links, n
        self.foot = int(links.tree[1][0])
        """The first joint that turns: 1 behind a feed, else 0."""
        straight = self.points(np.zeros((1, n)))[0]
        lengths = np.linalg.norm(np.diff(straight, axis=0), axis=1)
        counts = lengths > 1e-9
        counts[: self.foot] = True  # where the foot is says where the feed is
        self.links = links._replace(counts=counts)
        self._even, self._free = np.ones(n), np.ones(n, dtype=bool)
        self.stations = np.cumsum(lengths) - lengths[: self.foot].sum()
        """Arc length from the foot to each point (n,) [m]."""

    @classmethod
    def from_cell(cls, cell: Cell) -> Self:
        """Take that of a cell's only mechanism. Raises `ConfigError` for one that is no chain."""
        m, branch = cell.config.mechanism, Branch.of(cell)
        body, T = branch.body_of(m.tip_link)
        serial = np.array_equal(branch.tree.parent, np.arange(-1, branch.n - 1))
        fed = m.backbone is not None and m.backbone.feed is not None
        if body != branch.n or not serial or branch.tree.prismatic[int(fed) :].any():
            raise ConfigError(
                f"{cell.path}: mechanism.backbone: a serial chain of revolute joints is needed, "
                "behind the one of [mechanism.backbone.feed] if any"
            )
        base = Pose.from_xyz_rpy(m.T_world_base.xyz, m.T_world_base.rpy)
        counts = np.ones(branch.n, dtype=bool)
        return cls(Links(branch.tree[:], base.R[None], base.p[None], T.p, counts), branch.n)

    @property
    def length(self) -> float:
        """From the foot to the tip [m]."""
        return float(self.stations[-1])

    def points(self, q: Array) -> Array:
        """Return the first joint and all points (s, n + 1, 3) in World at q (s, n) [rad]."""
        found = np.empty((len(q), self.n + 1, 3))
        points_at(self.links[:], q, found)
        return found

    def foot_at(self, feed: float) -> Array:
        """Return where the foot is in World (3,) [m], with a feed that is so far out [m]."""
        return np.asarray(self.points(np.full((1, self.n), feed))[0, self.foot])

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
            if self.links.tree[1][i]:
                q[i] = (curve[i] - placed[i + 1]) @ across
                continue
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
