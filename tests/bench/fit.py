"""Time of the fit of joints to a backbone's curve, with rates, from 10 to 1000 joints.

The chain is planar, of one length, in the paper's maze; beside the recursion a dense least-squares
solve of the same step. Each figure is the least of several rounds: on a machine that others use,
the others show in the rest.
"""

import math
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from telerobot.config.load import Cell
from telerobot.server.control.backbone.curve import Bow, Chord, Curve
from telerobot.server.control.backbone.fit import Chain, Links
from telerobot.server.control.backbone.tunnels import Arcs, Turn
from telerobot.server.control.spatial import Array, Pose, skew
from telerobot.tools.bench.figures import Figures

JOINTS = (10, 30, 100, 300, 1000)
MOST_DENSE = 300
"""A dense solve of more joints takes too long to be measured [1]."""
S1 = 0.68
PAPER = (1.00, 0.94, 0.83, 0.68, 0.54, 0.44)
"""Free lengths of the paper's figures, in lengths of the arm [1]."""
ROUNDS, QUICK_ROUNDS = 40, 8
REPEATED = 10

_Y, _Z = np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])


def bench(_cell: Cell, quick: bool) -> Figures:
    """Measure one step of the fit with rates, the curve, and the paper's whole computation [µs]."""
    rounds = QUICK_ROUNDS if quick else ROUNDS
    curve, found = _maze(), Figures()
    for n in JOINTS:
        chain = _chain(n)
        sampled = curve.at(S1, chain.stations)
        q = chain.settled(chain.guess(sampled.points), *sampled).q
        row = {
            "fit_us": _least(partial(chain.fitted, q, *sampled, 1), rounds),
            "with_curve_us": _least(partial(_step, chain, curve, q), rounds),
        }
        if n <= MOST_DENSE:
            J, off = _dense(chain, q, sampled.points)
            solve = partial(np.linalg.lstsq, J, off, rcond=None)
            row["dense_us"] = _least(solve, max(2, rounds // 8), 1)
        found[f"{n} joints"] = row
    found["growth_100_to_1000"] = round(
        found["1000 joints"]["fit_us"] / found["100 joints"]["fit_us"], 2
    )
    found["paper_figures_ms"] = 1e-3 * _least(partial(_figures, curve), 3, 1)
    return found


def _step(chain: Chain, curve: Curve, q: Array) -> object:
    return chain.fitted(q, *curve.at(S1, chain.stations), 1)


def _figures(curve: Curve) -> None:
    """Compute the curves and the ten-link arms of the paper's figures 4 and 5, from nothing."""
    chain = _chain(10)
    for s1 in PAPER:
        curve.at(s1, np.linspace(0.0, 1.0, 200))
        sampled = curve.at(s1, chain.stations)
        chain.settled(chain.guess(sampled.points), *sampled)


def _maze() -> Curve:
    entrance = Pose.from_xyz_rpy((0.0, 0.4, 0.0), (0.0, 0.0, 0.5 * math.pi))
    turns = [Turn(0.2, math.pi), Turn(0.2, -math.pi), Turn(0.2, math.pi)]
    bow = Bow(Chord(np.zeros(3), np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), 0.4))
    return Curve(bow, Arcs.from_entrance(entrance, turns))


def _chain(n: int) -> Chain:
    """Return a planar chain of n joints, of length 1."""
    parts, K = np.zeros((n, 3, 3, 4)), skew(_Z)
    parts[:, 0, :, :3], parts[1:, 0, 1, 3] = np.eye(3), 1.0 / n
    parts[:, 1, :, :3], parts[:, 2, :, :3] = K, K @ K
    root = np.column_stack((np.eye(3), np.zeros(3)))
    return Chain(Links(root, parts, np.tile(_Z, (n, 1)), _Y / n, np.ones(n, dtype=bool)), n)


def _dense(chain: Chain, q: Array, curve: Array) -> tuple[Array, Array]:
    """Return the Jacobian of all points (3 n, n), and how far they are off (3 n,)."""
    points = chain.points(q[None])[0]
    J = np.zeros((chain.n, 3, chain.n))
    for j in range(chain.n):
        J[j:, :, j] = np.cross(_Z, points[j + 1 :] - points[j])
    return J.reshape(-1, chain.n), (curve - points[1:]).ravel()


def _least(work: Callable[[], object], rounds: int, repeated: int = REPEATED) -> float:
    """Return the least time that work takes [µs]."""
    least = math.inf
    for _ in range(rounds):
        start = time.perf_counter()
        for _ in range(repeated):
            work()
        least = min(least, (time.perf_counter() - start) / repeated)
    return round(1e6 * least, 1)
