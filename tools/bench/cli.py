"""`telerobot bench`: the benchmarks, as a table and as JSON."""

import argparse
import json
from collections.abc import Callable, Iterator, Mapping
from typing import Final

from ...config.load import Cell, load_cell
from ..client.operator import OperatorError
from ..host.local_plant import ChildDied
from . import latency, simulate, sync, tick
from .figures import Figures, machine

Bench = Callable[[Cell, bool], Figures]
Benches = Mapping[str, tuple[Bench, tuple[str, ...]]]

BENCHES: Final[Benches] = {
    "tick": (
        lambda cell, quick: tick.bench(cell, tick.QUICK_TICKS if quick else tick.TICKS),
        ("pa10", "ur5e", "pa10_hand_torque", "snake", "rover"),
    ),
    "simulate": (
        lambda cell, quick: simulate.bench(cell, 1 if quick else simulate.RUNS),
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
