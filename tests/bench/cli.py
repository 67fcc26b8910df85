"""`make bench`: those of `telerobot bench`, and those that need the laboratory."""

import argparse
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from telerobot.config.load import load_cell
from telerobot.tools import arguments
from telerobot.tools.bench import cli, tick
from telerobot.tools.bench.figures import Figures
from telerobot.tools.recording.plot import require_matplotlib

from ..equipment.alone import run_alone
from . import fit, held, rover
from .against import compare
from .growth import QUICK_TICKS, ROUNDS, TICKS, arms, growth
from .in_turn import in_turn
from .load import OBSTACLES, among
from .page import page

BENCHES: Final[cli.Benches] = {
    **cli.BENCHES,
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
    "held": (held.bench, ("pa10",)),
    "short": (held.short, ("planar3",)),
    "fit": (fit.bench, ("snake",)),
    "page": (page.bench, ("pa10",)),
    "rover": (rover.bench, ("rover_bridge",)),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Measure what the arguments choose; return the exit code."""
    return run_alone("bench", _add_arguments, _run, argv)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    arguments.bench(parser, BENCHES)
    parser.add_argument(
        "--growth", type=Path, metavar="FILE",
        help="measure instead how the tick grows with obstacles and joints, as JSON or as .svg",
    )  # fmt: skip
    parser.add_argument(
        "--against", metavar="REVISION",
        help="measure this revision and another one in turn, and tell the ratios",
    )  # fmt: skip
    parser.add_argument(
        "--in-turn", metavar="REVISION",
        help="measure instead a daemon's period of both, period by period in turn on one core",
    )  # fmt: skip


def _run(args: argparse.Namespace) -> int:
    if args.against is not None or args.in_turn is not None:
        if args.in_turn is not None:
            found = in_turn(args.in_turn, args.quick)
        else:
            found = compare(args.against, args.only, args.quick)
        if args.json:
            args.json.write_text(json.dumps(found, indent=1))
        return 0
    return cli.run(args, BENCHES) if args.growth is None else _grown(args.growth, args.quick)


def _grown(file: Path, quick: bool) -> int:
    draw = _drawing() if file.suffix == ".svg" else None
    facts, grown = cli.told_machine(), growth(load_cell("pa10"), quick)
    for of, rows in grown.items():
        for count, figures in rows.items():
            for line in cli.table(f"{count} {of}", figures):
                print(line)
    if draw is None:
        file.write_text(json.dumps({"machine": facts, **grown}, indent=1))
    else:
        draw(grown, file)
    return 0


def _drawing() -> Callable[[Figures, Path], None]:
    """Return a function that draws the growth; raises `DeviceError` without matplotlib."""
    require_matplotlib()
    from .growth_plot import draw

    return draw
