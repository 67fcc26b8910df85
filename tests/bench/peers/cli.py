"""`make bench-peers`: the same scenes for all controllers, as one table."""

import argparse
import json
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from telerobot.config.load import Cell, load_cell
from telerobot.tools.arguments import jobs as add_jobs
from telerobot.tools.bench.figures import machine
from telerobot.tools.host import jobs
from telerobot.tools.host.jobs import seeds

from .controllers.contract import Controller
from .generator import generate
from .report import LEGEND, as_json, markdown, text
from .run import run
from .scenes import PeerScene, write

NAMES = ("telerobot", "pink", "pink, A", "mink")
LIBRARIES = ("pin-pink", "mink", "qpsolvers", "daqp", "pin", "coal", "mujoco", "numpy")


def controller(name: str) -> type[Controller]:
    """Return a controller by name. Raises `ImportError` where its library is not installed."""
    # Here, because each library but our own is there in the environment of this benchmark only.
    match name:
        case "pink":
            from .controllers.with_pink import Pink

            return Pink
        case "pink, A":
            from .controllers.with_pink import PinkAccelerating

            return PinkAccelerating
        case "mink":
            from .controllers.with_mink import Mink

            return Mink
        case _:
            from .controllers.with_telerobot import Telerobot

            return Telerobot


def main(arguments: list[str] | None = None) -> int:
    """Make the scenes, run them all, and tell."""
    parser = argparse.ArgumentParser(prog="bench-peers", description=__doc__)
    parser.add_argument("--cell", default="pa10", help="cell whose arm it is (pa10)")
    parser.add_argument("--seeds", type=seeds, default=range(200), metavar="A:B", help="(0:200)")
    add_jobs(parser, 1, Path("out/peers.jsonl"))
    parser.add_argument(
        "--controllers", nargs="+", choices=NAMES, default=NAMES, metavar="NAME",
        help=f"of {', '.join(repr(name) for name in NAMES)} (all)",
    )  # fmt: skip
    parser.add_argument("--scenes", type=Path, metavar="FILE", help="write the scenes as JSON")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every run as JSON")
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the table")
    args = parser.parse_args(arguments)
    try:
        settings = {name: controller(name).settings() for name in args.controllers}
    except ImportError as error:
        print(f"bench-peers: {error}: run it by `make bench-peers`", file=sys.stderr)
        return 2
    cell, place = load_cell(args.cell), jobs.place_of(args)
    made = jobs.run_all(
        partial(generate, cell), args.seeds, replace(place, rows=None, resume=False), "scenes"
    )
    if made.interrupted:
        return 130
    if args.scenes:
        write(tuple(made.results), args.scenes)
    finished = jobs.run_all(
        partial(_run, cell),
        [(name, scene) for scene in made.results for name in args.controllers],
        place,
        "runs",
        named=lambda work: f"{args.cell}, {work[1].seed}, {work[0]}",
    )
    results = finished.results
    print(text(results))
    print("\n".join(LEGEND))
    if args.markdown:
        args.markdown.write_text(markdown(results), encoding="utf-8")
    if args.json:
        facts = {"machine": machine(*LIBRARIES), "settings": settings, "runs": results}
        args.json.write_text(json.dumps(facts, indent=1), encoding="utf-8")
    return 130 if finished.interrupted else 0


def _run(cell: Cell, work: tuple[str, PeerScene]) -> dict[str, Any]:
    name, scene = work
    return as_json(run(name, controller(name), cell, scene))
