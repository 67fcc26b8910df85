"""`make campaign`: behaviour at scale, from seeds that anyone can run again."""

import argparse
import gc
import json
import sys
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

from pydantic import TypeAdapter
from telerobot.tools import arguments
from telerobot.tools.host import jobs
from telerobot.tools.host.jobs import seeds

from ..equipment.alone import run_alone
from .part import JobResult, Selection
from .parts import PARTS

Job = tuple[str, Any]
"""A part's name, and one of its jobs."""
Played = tuple[str, JobResult]
"""A part's name, and the result of one of its jobs."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.add_argument(
        "--only",
        action="append",
        choices=sorted(PARTS),
        metavar="PART",
        help=f"run this part, may be given again; all by default: {', '.join(PARTS)}",
    )
    parser.add_argument(
        "--cells",
        default="pa10,ur5e,pa10_vision",
        metavar="A,B",
        help="cells of the part 'hostile' (default %(default)s)",
    )
    parser.add_argument(
        "--seeds",
        type=seeds,
        default=range(100),
        metavar="A:B",
        help="seeds to run in every cell, B excluded (default 0:100)",
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures as JSON")
    arguments.jobs(parser, 2, Path("out/campaign.jsonl"))


def main(argv: Sequence[str] | None = None) -> int:
    """Run the campaign that the arguments choose; return its exit code."""
    return run_alone("campaign", add_arguments, run, argv)


def run(args: argparse.Namespace) -> int:
    """Run the campaign; return 0 only if every promise was kept, 130 if it was interrupted."""
    selection = Selection(tuple(name for name in args.cells.split(",") if name), args.seeds)
    chosen = [name for name in PARTS if not args.only or name in args.only]
    every = [(name, job) for name in chosen for job in PARTS[name].jobs(selection)]
    finished = jobs.run_all(
        _play, every, jobs.place_of(args), "campaign", _told, _packed, _unpacked
    )
    findings = {
        name: PARTS[name].report([played for part, played in finished.results if part == name])
        for name in chosen
    }
    if args.json:
        figures = {name: found.figures() for name, found in findings.items()}
        args.json.write_text(json.dumps(figures, indent=1))
    for name, found in findings.items():
        print("\n".join((f"--- {name}", *found.lines())))
    if finished.interrupted:
        return 130
    return 0 if all(found.kept for found in findings.values()) else 1


def _play(job: Job) -> Played:
    name, what = job
    # What a run keeps is not garbage: looking for some among it took a sixth of the time.
    gc.collect()
    gc.disable()
    try:
        return name, PARTS[name].play(what)
    finally:
        gc.enable()


def _told(played: Played) -> str:
    _, result = played
    words = "; ".join(result.reasons)
    return f"{result.name}: {words or 'well'}"[:160] if words or not sys.stderr.isatty() else ""


def _packed(_job: Job, played: Played) -> object:
    return _adapter(played[0]).dump_python(played[1], mode="python", warnings=False)


def _unpacked(job: Job, kept: object) -> Played:
    return job[0], _adapter(job[0]).validate_python(kept)


@cache
def _adapter(part: str) -> TypeAdapter[Any]:
    """Return what makes a part's results plain values, and results again."""
    return TypeAdapter(get_type_hints(PARTS[part].play)["return"])
