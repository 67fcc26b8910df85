"""How the tick's time grows with obstacles and with joints, beside a fixed piece of arithmetic.

The fixed piece is plain numpy, measured in the same minute: on a machine that others use, the
quotient of the two says more than microseconds.
"""

import tempfile
import time
from pathlib import Path

import numpy as np

from ...config.load import Cell
from . import tick
from .figures import Figures, percentiles
from .load import OBSTACLES, among, chain

COUNTS = (1, 2, 4, 8, 16, 32, 64)
JOINTS = (6, 7, 8, 9, 10, 11, 12)
TICKS = 1500
QUICK_TICKS = 200


def growth(cell: Cell, quick: bool) -> Figures:
    """Measure every number of obstacles with the cell's arm, and every number of joints."""
    ticks = QUICK_TICKS if quick else TICKS
    rows: Figures = {"obstacles": {}, "joints": {}}
    for count in COUNTS:
        rows["obstacles"][count] = _row(among(cell, count), ticks)
    with tempfile.TemporaryDirectory() as folder:
        for joints in JOINTS:
            made = among(chain(cell, joints, Path(folder)), OBSTACLES)
            rows["joints"][joints] = _row(made, ticks)
    return rows


def _row(cell: Cell, ticks: int) -> Figures:
    before = arithmetic_us()
    times = tick.bench(cell, ticks)
    own = min(before, arithmetic_us())
    return {
        "free_us": times["free_us"],
        "limited_us": times["limited_us"],
        "arithmetic_us": round(own, 1),
        "times_arithmetic": round(times["free_us"]["p50"] / own, 1),
    }


def arithmetic_us(rounds: int = 200) -> float:
    """Return the median time of a fixed piece of numpy: ten products and one SVD of 6 × 7 [µs]."""
    A = np.random.default_rng(1).normal(0.0, 1.0, (6, 7))
    seconds = []
    for _ in range(rounds):
        start = time.perf_counter()
        for _ in range(10):
            A @ A.T
        np.linalg.svd(A)
        seconds.append(time.perf_counter() - start)
    return percentiles(1e6 * np.array(seconds))["p50"]
