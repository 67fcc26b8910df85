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
from laboratory.papers.maze import MAZE, S1, Z, planar
from telerobot.config.load import Cell
from telerobot.server.control.backbone.curve import Curve
from telerobot.server.control.backbone.fit import Chain
from telerobot.server.control.spatial import Array
from telerobot.tools.bench.figures import Figures

JOINTS = (10, 30, 100, 300, 1000)
MOST_DENSE = 300
"""A dense solve of more joints takes too long to be measured [1]."""
FREE = 0.68
"""Free length, in lengths of the arm [1]."""
ROUNDS, QUICK_ROUNDS = 40, 8
REPEATED = 10


def bench(_cell: Cell, quick: bool) -> Figures:
    """Measure one step of the fit with rates, the curve, and the paper's whole computation [µs]."""
    rounds = QUICK_ROUNDS if quick else ROUNDS
    curve, found = MAZE, Figures()
    for n in JOINTS:
        chain = planar(n)
        sampled = curve.at(FREE, chain.stations)
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
    return chain.fitted(q, *curve.at(FREE, chain.stations), 1)


def _figures(curve: Curve) -> None:
    """Compute the curves and the ten-link arms of the paper's figures 4 and 5, from nothing."""
    chain = planar(10)
    for s1 in S1:
        curve.at(s1, np.linspace(0.0, 1.0, 200))
        sampled = curve.at(s1, chain.stations)
        chain.settled(chain.guess(sampled.points), *sampled)


def _dense(chain: Chain, q: Array, curve: Array) -> tuple[Array, Array]:
    """Return the Jacobian of all points (3 n, n), and how far they are off (3 n,)."""
    points = chain.points(q[None])[0]
    J = np.zeros((chain.n, 3, chain.n))
    for j in range(chain.n):
        J[j:, :, j] = np.cross(Z, points[j + 1 :] - points[j])
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
