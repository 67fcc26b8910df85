"""`telerobot bench`: the benchmarks, as a table and as JSON."""

import argparse
import json
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Final

from ...config.load import Cell, load_cell
from ..client.operator import OperatorError
from ..host.local_plant import ChildDied
from ..simulation.simulation import simulate
from . import latency, sync, tick
from .figures import Figures, machine

Bench = Callable[[Cell, bool], Figures]
Benches = Mapping[str, tuple[Bench, tuple[str, ...]]]

TARGET: Final = 5.0  # virtual seconds per real second [1]
RUNS: Final = 3


def simulated(cell: Cell, runs: int = RUNS) -> Figures:
    """Simulate the cell's default script a number of times: others only ever make a run slower."""
    best = virtual_s = 0.0
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


BENCHES: Final[Benches] = {
    "tick": (
        lambda cell, quick: tick.bench(cell, tick.QUICK_TICKS if quick else tick.TICKS),
        ("pa10", "ur5e", "pa10_hand_torque", "snake", "rover"),
    ),
    "simulate": (
        lambda cell, quick: simulated(cell, 1 if quick else RUNS),
        ("pa10", "ur5e"),
    ),
    "sync": (
        lambda cell, quick: sync.bench(cell, sync.QUICK_SECONDS if quick else sync.SECONDS),
        ("pa10",),
    ),
    "latency": (
        lambda cell, quick: latency.bench(cell, latency.QUICK_STEPS if quick else latency.STEPS),
        ("pa10",),
    ),
}
"""Every benchmark by name, and the cells that it runs with."""


def run(args: argparse.Namespace, benches: Benches = BENCHES) -> int:
    """Measure; return 1 only if something could not be measured: speed depends on the machine."""
    facts = told_machine()
    results: dict[str, dict[str, Figures]] = {}
    failed = False
    for name in args.only:
        bench, cells = benches[name]
        for cell in cells:
            try:
                figures = bench(load_cell(cell), args.quick)
            except (ChildDied, OperatorError) as error:
                figures = {"error": " ".join(str(error).split())}
                failed = True
            results.setdefault(name, {})[cell] = figures
            for line in table(f"{name} {cell}", figures):
                print(line, flush=True)
    if args.json:
        args.json.write_text(
            json.dumps({"machine": facts, "quick": args.quick, **results}, indent=1)
        )
    return 1 if failed else 0


def told_machine() -> Figures:
    """Print what is measured on, and return it."""
    facts = machine()
    print(f"{facts['cores']} cores, {facts['processor']}, Python {facts['python']}")
    return facts


def table(title: str, figures: Figures) -> Iterator[str]:
    """Yield the lines of a table: a figure each."""
    for key, value in figures.items():
        shown = str(value)
        if isinstance(value, dict):
            shown = "  ".join(f"{k} {v}" for k, v in value.items())
        elif isinstance(value, bool):
            shown = "yes" if value else "no"
        yield f"{title:14} {key:18} {shown}"
        title = ""
