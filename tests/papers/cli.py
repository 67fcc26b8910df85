"""`make papers`: every exhibit of the five papers, on one page."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import TypeAdapter
from telerobot.tools import arguments
from telerobot.tools.host import jobs

from ..equipment.alone import run_alone
from . import page
from .exhibit import Number, Shown
from .exhibits import EXHIBITS
from .style import applied

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "papers"


class Played(NamedTuple):
    """An exhibit's name, and its result."""

    name: str
    shown: Shown


ROWS = TypeAdapter(Played)


def main(argv: Sequence[str] | None = None) -> int:
    """Show the exhibits that the arguments choose; return the exit code."""
    return run_alone("papers", _add_arguments, _run, argv)


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--only", action="append", choices=sorted(EXHIBITS), metavar="EXHIBIT",
        help="show this one, may be given again; all, and the page, by default: "
        + ", ".join(EXHIBITS),
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, default=FOLDER, metavar="FOLDER",
        help="write pictures and page here (default docs/papers)",
    )  # fmt: skip
    arguments.jobs(parser, 2, Path("out/papers.jsonl"))


def _run(args: argparse.Namespace) -> int:
    """Return 0 only if every number is inside its range, 130 if it was interrupted."""
    chosen = [name for name in EXHIBITS if not args.only or name in args.only]
    finished = jobs.run_all(play, chosen, jobs.place_of(args), "papers", _told, _packed, _unpacked)
    shown = {played.name: played.shown for played in finished.results}
    page.write(args.out, shown)
    for name, found in shown.items():
        print(f"--- {name}")
        for number in found.numbers:
            print(line(number))
    if finished.interrupted:
        return 130
    return 0 if all(number.kept for found in shown.values() for number in found.numbers) else 1


def play(name: str) -> Played:
    """Show one exhibit."""
    with applied():
        return Played(name, EXHIBITS[name].show())


def line(number: Number) -> str:
    """Return a number's line for the terminal."""
    mark = "  " if number.kept else "! "
    unit = "" if number.unit == "1" else f" {number.unit}"
    return f"{mark}{number.what}: {number.ours:.4g}{unit}, allowed {page.allowed(number)}"


def _told(played: Played) -> str:
    moved = [line(number)[2:] for number in played.shown.numbers if not number.kept]
    return "; ".join((f"{played.name}: out of range", *moved)) if moved else ""


def _packed(_name: str, played: Played) -> object:
    return ROWS.dump_python(played)


def _unpacked(_name: str, kept: Any) -> Played:
    return ROWS.validate_python(kept)
