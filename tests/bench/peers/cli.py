"""`make bench-peers`: the same scenes for all controllers, as one table."""

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

from telerobot.config.load import Cell, load_cell
from telerobot.tools.bench.figures import machine

from .controllers.contract import Controller
from .generator import generate
from .report import LEGEND, as_json, markdown, text
from .run import run
from .scenes import PeerScene, write

NAMES = ("telerobot", "pink", "pink, A", "mink")
LIBRARIES = ("pin-pink", "mink", "qpsolvers", "daqp", "pin", "coal", "mujoco", "numpy")

A = TypeVar("A")
B = TypeVar("B")


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
    parser.add_argument("--seeds", type=_seeds, default=range(200), metavar="A:B", help="(0:200)")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="processes (1)")
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
    cell = load_cell(args.cell)
    with _pool(args.jobs) as pool:
        scenes = tuple(_each(pool, partial(generate, cell), list(args.seeds), "scenes"))
        if args.scenes:
            write(scenes, args.scenes)
        work = [(name, scene) for scene in scenes for name in args.controllers]
        results = list(_each(pool, partial(_run, cell), work, "runs"))
    print(text(results))
    print("\n".join(LEGEND))
    if args.markdown:
        args.markdown.write_text(markdown(results), encoding="utf-8")
    if args.json:
        facts = {"machine": machine(LIBRARIES), "settings": settings, "runs": results}
        args.json.write_text(json.dumps(facts, indent=1), encoding="utf-8")
    return 0


def _run(cell: Cell, work: tuple[str, PeerScene]) -> dict[str, Any]:
    name, scene = work
    return as_json(run(name, controller(name), cell, scene))


def _pool(jobs: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(jobs, mp_context=get_context("spawn"))


def _each(pool: Executor, what: Callable[[A], B], items: list[A], name: str) -> Iterator[B]:
    """Yield the answers in order, and count them on a terminal's standard error."""
    for i, answer in enumerate(pool.map(what, items), start=1):
        if sys.stderr.isatty():
            end = "\n" if i == len(items) else ""
            print(f"\r{name}: {i} of {len(items)}", end=end, file=sys.stderr, flush=True)
        yield answer


def _seeds(words: str) -> range:
    first, colon, last = words.partition(":")
    try:
        found = range(int(first), int(last) if colon else int(first) + 1)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{words}' is not A:B or A") from None
    if not found or found.start < 0:
        raise argparse.ArgumentTypeError(f"'{words}' holds no seed of 0 or more")
    return found
