"""`make campaign`: behaviour at scale, from seeds that anyone can run again."""

import argparse
import gc
import json
import multiprocessing
import os
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from telerobot.tools.cli import run_alone

from .part import JobResult, Selection, Summary
from .parts import PARTS

Job = tuple[str, Any]
"""A part's name, and one of its jobs."""


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
        type=_seeds,
        default=range(100),
        metavar="A:B",
        help="seeds to run in every cell, B excluded (default 0:100)",
    )
    parser.add_argument(
        "--jobs", type=int, default=2, metavar="N", help="processes (default %(default)s)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all figures as JSON")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the campaign that the arguments choose; return its exit code."""
    return run_alone("campaign", add_arguments, run, argv)


def run(args: argparse.Namespace) -> int:
    """Run the campaign; return 0 only if every promise was kept."""
    selection = Selection(tuple(name for name in args.cells.split(",") if name), args.seeds)
    chosen = [name for name in PARTS if not args.only or name in args.only]
    jobs = [(name, job) for name in chosen for job in PARTS[name].jobs(selection)]
    results: dict[str, list[JobResult]] = {name: [] for name in chosen}
    for done, ((name, _), played) in enumerate(
        zip(jobs, _played(jobs, max(1, args.jobs)), strict=True), start=1
    ):
        results[name].append(played)
        _progress(done, len(jobs), played)
    findings = {name: PARTS[name].report(found) for name, found in results.items()}
    if args.json:
        figures = {name: found.figures() for name, found in findings.items()}
        args.json.write_text(json.dumps(figures, indent=1))
    for name, found in findings.items():
        _show(name, found)
    return 0 if all(found.kept for found in findings.values()) else 1


def _seeds(text: str) -> range:
    first, _, last = text.partition(":")
    try:
        seeds = range(int(first), int(last) if last else int(first) + 1)
    except ValueError:
        seeds = range(0)
    if not seeds or seeds.start < 0:
        raise argparse.ArgumentTypeError(f"{text}: must be A:B with 0 <= A < B")
    return seeds


def _played(jobs: list[Job], processes: int) -> Iterator[JobResult]:
    if processes == 1:
        yield from map(_play, jobs)
        return
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # inherited by the workers
    # Spawned, not forked: a run must depend on its job alone.
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        yield from pool.imap(_play, jobs)


def _play(job: Job) -> JobResult:
    name, what = job
    # What a run keeps is not garbage: looking for some among it took a sixth of the time.
    gc.collect()
    gc.disable()
    try:
        return PARTS[name].play(what)
    finally:
        gc.enable()


def _show(name: str, found: Summary) -> None:
    print(f"--- {name}")
    print("\n".join(found.lines()))


def _progress(done: int, of: int, played: JobResult) -> None:
    lasting = bool(played.reasons) or not sys.stderr.isatty() or done == of
    if played.reasons or not lasting or done % 10 == 0 or done == of:
        words = "; ".join(played.reasons) or "well"
        line = f"{done}/{of} {played.name}: {words}"[:160]
        clear = "\x1b[K" if sys.stderr.isatty() else ""
        print(f"{line}{clear}", file=sys.stderr, end="\n" if lasting else "\r", flush=True)
