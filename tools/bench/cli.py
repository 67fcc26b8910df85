"""`telerobot bench`: the benchmarks, as a table and as JSON."""

import argparse
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from ...config.load import Cell, load_cell
from ...drivers.device import DeviceError
from ..host.local_plant import ChildDied
from ..operator.client.connection import OperatorError
from . import latency, simulate, sync, tick
from .curves import fit
from .figures import Figures, machine
from .growth import QUICK_TICKS, ROUNDS, TICKS, arms, growth
from .load import OBSTACLES, among
from .page import page
from .rover import rover

Bench = Callable[[Cell, bool], Figures]

BENCHES: Final[dict[str, tuple[Bench, tuple[str, ...]]]] = {
    "tick": (
        lambda cell, quick: tick.bench(cell, tick.QUICK_TICKS if quick else tick.TICKS),
        ("pa10", "ur5e", "pa10_hand_torque", "snake", "rover"),
    ),
    "load": (
        lambda cell, quick: tick.bench(
            among(cell, OBSTACLES), tick.QUICK_TICKS if quick else tick.TICKS
        ),
        ("pa10",),
    ),
    "arms": (
        lambda cell, quick: arms(cell, *((QUICK_TICKS, 1) if quick else (TICKS, ROUNDS))),
        ("pa10",),
    ),
    "fit": (fit.bench, ("snake",)),
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
    "page": (page.bench, ("pa10",)),
    "rover": (rover.bench, ("rover_bridge",)),
}
"""Every benchmark by name, and the cells that it runs with."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures as JSON")
    parser.add_argument(
        "--growth", type=Path, metavar="FILE",
        help="measure instead how the tick grows with obstacles and joints, as JSON or as .svg",
    )  # fmt: skip
    parser.add_argument("--quick", action="store_true", help="fewer samples, within a minute")
    parser.add_argument(
        "--only", nargs="+", choices=tuple(BENCHES), metavar="NAME",
        default=tuple(BENCHES), help=f"of {', '.join(BENCHES)}",
    )  # fmt: skip


def run(args: argparse.Namespace) -> int:
    """Measure; return 1 only if something could not be measured: speed depends on the machine."""
    facts = machine()
    print(f"{facts['cores']} cores, {facts['processor']}, Python {facts['python']}")
    if args.growth:
        draw = _drawing() if args.growth.suffix == ".svg" else None
        grown = growth(load_cell("pa10"), args.quick)
        for of, rows in grown.items():
            for count, figures in rows.items():
                for line in table(f"{count} {of}", figures):
                    print(line)
        if draw is None:
            args.growth.write_text(json.dumps({"machine": facts, **grown}, indent=1))
        else:
            draw(grown, args.growth)
        return 0
    results: dict[str, dict[str, Figures]] = {}
    failed = False
    for name in args.only:
        bench, cells = BENCHES[name]
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


def _drawing() -> Callable[[Figures, Path], None]:
    """Return a function that draws the growth; raises `DeviceError` without matplotlib."""
    try:
        from .growth_plot import draw
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "matplotlib":
            raise
        raise DeviceError("nothing to draw with: pip install 'telerobot[plot]'") from None
    return draw


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
