"""`telerobot campaign`: behaviour at scale, from seeds that anyone can run again."""

import argparse
import json
import multiprocessing
import os
import sys
from collections.abc import Iterator
from pathlib import Path

from ...config.load import load_cell
from .report import Report
from .verdict import Verdict, verdict


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.add_argument(
        "--cells", default="pa10,ur5e", metavar="A,B", help="cells to run (default %(default)s)"
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


def run(args: argparse.Namespace) -> int:
    """Run the campaign; return 0 only if every promise was kept."""
    cells = [name for name in args.cells.split(",") if name]
    for name in cells:
        load_cell(name)  # a mistake in a cell shows here, in one line, and not in every worker
    jobs = [(name, seed) for seed in args.seeds for name in cells]
    verdicts = []
    for v in _played(jobs, max(1, args.jobs)):
        verdicts.append(v)
        _progress(len(verdicts), len(jobs), v)
    report = Report(verdicts)
    if args.json:
        args.json.write_text(json.dumps(report.figures(), indent=1))
    print("\n".join(report.lines()))
    return 0 if report.kept else 1


def _seeds(text: str) -> range:
    first, _, last = text.partition(":")
    try:
        seeds = range(int(first), int(last) if last else int(first) + 1)
    except ValueError:
        seeds = range(0)
    if not seeds or seeds.start < 0:
        raise argparse.ArgumentTypeError(f"{text}: must be A:B with 0 <= A < B")
    return seeds


def _played(jobs: list[tuple[str, int]], processes: int) -> Iterator[Verdict]:
    if processes == 1:
        for job in jobs:
            yield _play(job)
        return
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # inherited by the workers
    # Spawned, not forked: a run must depend on its cell and seed alone.
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        yield from pool.imap(_play, jobs)


def _play(job: tuple[str, int]) -> Verdict:
    return verdict(*job)


def _progress(done: int, of: int, v: Verdict) -> None:
    lasting = bool(v.reasons) or not sys.stderr.isatty() or done == of
    if v.reasons or not lasting or done % 10 == 0 or done == of:
        words = "; ".join(v.reasons) or "well"
        line = f"{done}/{of} {v.cell} seed {v.seed}: {words}"[:160]
        clear = "\x1b[K" if sys.stderr.isatty() else ""
        print(f"{line}{clear}", file=sys.stderr, end="\n" if lasting else "\r", flush=True)
