"""Growth of the tick's time with obstacles, joints and arms, beside a fixed piece of arithmetic.

The fixed piece is plain numpy, measured among the ticks: on a machine that others use, the quotient
of the two says more than microseconds.
"""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from statistics import median

from telerobot.config.load import Cell
from telerobot.tools.bench import tick
from telerobot.tools.bench.figures import Figures

from .load import OBSTACLES, among, chain, on_one_payload, several

COUNTS = (1, 2, 4, 8, 16, 32, 64)
JOINTS = (6, 7, 8, 10, 12, 16, 24, 32, 48, 60)
ARMS = (1, 2, 4, 8)
PAYLOAD = "payload"
"""Row of two arms on one payload, beside those of arms with a task each."""
TICKS = 1000
ROUNDS = 5
"""Everything is measured so often, in turn, and each phase's quietest round counts: on a machine
that others use, some rounds show the others [1]."""
QUICK_TICKS = 200


def growth(cell: Cell, quick: bool) -> Figures:
    """Measure every number of obstacles with the cell's arm, and every number of joints."""
    ticks, rounds = (QUICK_TICKS, 1) if quick else (TICKS, ROUNDS)
    with tempfile.TemporaryDirectory() as folder:
        cells = [("obstacles", count, among(cell, count)) for count in COUNTS]
        chains = [(joints, chain(cell, joints, Path(folder))) for joints in JOINTS]
        cells += [("joints", joints, among(made, OBSTACLES)) for joints, made in chains]
        measured = [[tick.bench(made, ticks) for _, _, made in cells] for _ in range(rounds)]
    rows: Figures = {"obstacles": {}, "joints": {}}
    for (of, count, _), times in zip(cells, zip(*measured, strict=True), strict=True):
        rows[of][count] = _row(times)
    return rows


def arms(cell: Cell, ticks: int, rounds: int) -> Figures:
    """Measure one arm, several with a task each, and two on one payload, among as many obstacles.

    Of each phase the quietest round; `times_one` is the median, over the rounds, of how often the
    time of one arm it takes.
    """
    with tempfile.TemporaryDirectory() as folder:
        cells = [among(several(cell, count, Path(folder)), OBSTACLES) for count in ARMS]
        cells.append(among(on_one_payload(), OBSTACLES))
        measured = [[tick.bench(made, ticks) for made in cells] for _ in range(rounds)]
    found: Figures = {"obstacles": OBSTACLES, "pause_ms": 1e3 * tick.PAUSE_S}
    for phase in ("free_us", "limited_us", "back_to_back_us"):
        for i, count in enumerate((*ARMS, PAYLOAD)):
            ratios = [figures[i][phase]["p50"] / figures[0][phase]["p50"] for figures in measured]
            row = min((figures[i][phase] for figures in measured), key=lambda times: times["p99"])
            found[f"{phase}_{count}"] = {**row, "times_one": round(median(ratios), 2)}
    return found


def _row(times: Sequence[Figures]) -> Figures:
    row: Figures = {
        phase: min((t[phase] for t in times), key=lambda figures: figures["p99"])
        for phase in ("free_us", "limited_us", "back_to_back_us")
    }
    own = min(t["arithmetic_us"]["p50"] for t in times)
    return {
        **row,
        "arithmetic_us": own,
        "times_arithmetic": round(row["free_us"]["p50"] / own, 1),
    }
