"""`telerobot replay RUN.mcap`: the pure tick on recorded inputs, compared bit by bit."""

import argparse
import sys
from importlib import metadata
from pathlib import Path

from ....config.errors import printable
from ....server.recorder import TICK, read_row
from ...host.progress import counted
from ..run_file import RecordError, read_about, read_cell, read_run
from .explain import explain
from .replay import Replay


def run(args: argparse.Namespace) -> int:
    """Replay; return 0 where every output is the recorded one, else 1.

    Raises `RecordError`, `OSError`.
    """
    return _replay(args.file, args.until, args.explain)


def _replay(path: Path, until: float | None, explained: bool) -> int:
    cell, version = read_cell(path), read_about(path).get("version")
    ours = metadata.version("telerobot")
    if version not in (None, ours):
        print(
            f"telerobot: recorded by version {printable(version)}, replayed by {ours}",
            file=sys.stderr,
        )
    replay = Replay(path, cell)
    judgement, last = replay.judgement, None
    end_s = None if until is None else until + _origin_s(path, until)
    for tick in counted(replay.run(), "replayed", "ticks"):
        if end_s is not None and last is not None and tick.record.time_s > end_s:
            break
        last = tick
    if last is None:
        raise RecordError(f"{path}: holds no memory that a tick began with: nothing to replay")
    if explained:
        print(*map(printable, explain(cell, last).splitlines()), sep="\n")
    same = judgement.difference is None
    first, skipped = judgement.first_s or 0.0, ""
    if judgement.skipped:
        skipped = f", {judgement.skipped} skipped without a memory to begin with"
    print(
        f"{judgement.ticks} ticks to {last.record.time_s - first:.2f} s and "
        f"{judgement.memories} memories replayed{skipped}: "
        + ("all as recorded, to the last bit" if same else "NOT as recorded")
    )
    if not same:
        print(f"first difference: {printable(judgement.difference)}")
    return 0 if same else 1


def _origin_s(path: Path, until: float) -> float:
    """Return the time of the first recorded tick, or of the last one for a time below 0 [s]."""
    times = (read_row(message.data).time_s for message in read_run(path, (TICK,)))
    if until >= 0.0:
        return next(times, 0.0)
    newest = 0.0
    for time_s in times:
        newest = time_s
    return newest
