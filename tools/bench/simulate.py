"""Speed of a simulation against real time: the cell's default script, best of some."""

import time

from ...config.load import Cell
from ..simulation.simulation import simulate
from .figures import Figures

TARGET = 5.0  # virtual seconds per real second [1]
RUNS = 3


def bench(cell: Cell, runs: int = RUNS) -> Figures:
    """Simulate a number of times; other programs only ever make a run slower."""
    best = 0.0
    virtual_s = 0.0
    for _ in range(runs):
        start = time.perf_counter()
        states = simulate(cell).states
        real_s = time.perf_counter() - start
        virtual_s = states[-1].time_s if states else 0.0
        best = max(best, virtual_s / real_s)
    return {
        "virtual_s": round(virtual_s, 3),
        "times_real_time": round(best, 2),
        "target": TARGET,
        "met": best >= TARGET,
    }
