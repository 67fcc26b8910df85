"""Part `hostile`: every seed in every cell, with a goal at the end of each run."""

from ....config.load import load_cell
from ..part import Part, Selection
from .report import Report
from .verdict import Verdict, verdict

Job = tuple[str, int]
"""Cell and seed."""


SEEING_EVERY = 4
"""A cell with cameras takes the first seed and every fourth after it: its runs are longer [1]."""


def _jobs(selection: Selection) -> list[Job]:
    # A mistake in a cell shows here, in one line, and not in every worker.
    every = {n: SEEING_EVERY if load_cell(n).config.cameras else 1 for n in selection.cells}
    return [
        (name, seed)
        for i, seed in enumerate(selection.seeds)
        for name in selection.cells
        if i % every[name] == 0
    ]


def _play(job: Job) -> Verdict:
    return verdict(*job)


HOSTILE = Part(_jobs, _play, Report)
