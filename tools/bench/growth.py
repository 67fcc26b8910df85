"""How the tick's time grows with obstacles and with joints, beside a fixed piece of arithmetic.

The fixed piece is plain numpy, measured among the ticks: on a machine that others use, the quotient
of the two says more than microseconds.
"""

import tempfile
from pathlib import Path

from ...config.load import Cell
from . import tick
from .figures import Figures
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
    times = tick.bench(cell, ticks)
    own = times["arithmetic_us"]["p50"]
    return {
        "free_us": times["free_us"],
        "limited_us": times["limited_us"],
        "arithmetic_us": own,
        "times_arithmetic": round(times["free_us"]["p50"] / own, 1),
    }
