"""Part `replays`: hostile runs are recorded, and replay from their files to the last bit.

The cell is the file's, and the control computation a new one: what it kept between two ticks and
did not tell shows as a difference. A second replay begins in the middle, as a black box does.
Of ten runs one is played to its end, and the others begin: a thousand of them take half an hour.
"""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from telerobot.config.bundle import to_text
from telerobot.config.load import load_cell
from telerobot.server.recorder import MEMORY, TICK, KeptTick, Stamped, joined, pack
from telerobot.tools.recording.replay import Judgement, Replay
from telerobot.tools.recording.run_file import read_cell
from telerobot.tools.simulation.simulation import Simulation
from telerobot.tools.soak.cli import ComputedSights

from ..part import Part, Selection
from ..runs import Runs
from .generator import generate

Job = tuple[str, int]
"""Cell and seed."""

WHOLE_EVERY: Final = 10
TICKS: Final = 500
"""Ticks of a run that is not played to its end [1]."""


@dataclass(frozen=True)
class ReplayedRun:
    """A run that was recorded and replayed; plain values."""

    name: str
    ticks: int
    memories: int
    reasons: list[str]


class Replays(Runs[ReplayedRun]):
    """Summary of all recorded runs."""

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        ticks = sum(run.ticks for run in self.runs)
        memories = sum(run.memories for run in self.runs)
        return {**super().figures(), "ticks": ticks, "memories": memories}

    def lines(self) -> list[str]:
        """Return the report."""
        figures = self.figures()
        told = f"{figures['runs']} runs, {figures['ticks']} ticks, {figures['memories']} memories"
        return [f"{told} replayed, {len(self.failing)} not as recorded", *super().lines()]


def replayed(cell_name: str, seed: int, ticks: int | None = None) -> ReplayedRun:
    """Play the hostile run of a seed, and replay what it recorded, whole and from its middle.

    `ticks`: the run ends after so many [1]; None: where its script ends.
    """
    plan = generate(load_cell(cell_name), seed)
    simulation = Simulation(plan.cell, plan.script, cameras=lambda s: ComputedSights(s, plan.seed))
    rows: list[KeptTick] = []
    simulation.cycle.flight.log.taps.append(rows.append)
    simulation.run(None if ticks is None else lambda: len(rows) >= ticks)
    whole = _replay(to_text(plan.cell), rows)
    middle = _replay(to_text(plan.cell), rows[len(rows) // 2 :])
    reasons = [j.difference for j in (whole, middle) if j.difference is not None]
    if whole.skipped or whole.ticks != len(rows):
        reasons.append(f"{len(rows)} ticks recorded, {whole.ticks} replayed")
    return ReplayedRun(f"{cell_name} {seed}", whole.ticks, whole.memories, reasons)


def _replay(cell: str, rows: Sequence[KeptTick]) -> Judgement:
    messages = []
    for row in rows:
        if row.memory is not None:
            messages.append(Stamped(MEMORY, row.stamp_ns, pack(row.memory)))
        messages.append(Stamped(TICK, row.stamp_ns, row.data))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        path.write_bytes(joined(cell, {}, messages))
        replay = Replay(path, read_cell(path))
        for _ in replay.run():
            pass
        return replay.judgement


def _jobs(selection: Selection) -> list[Job]:
    single = [name for name in selection.cells if len(load_cell(name).parts) == 1]
    return [(name, seed) for seed in selection.seeds for name in single]


def _play(job: Job) -> ReplayedRun:
    _, seed = job
    return replayed(*job, None if seed % WHOLE_EVERY == 0 else TICKS)


REPLAYS = Part(_jobs, _play, Replays)
