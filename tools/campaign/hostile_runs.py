"""The part `hostile`: every seed in every cell, with a goal at the end of each run."""

from ...config.load import load_cell
from .part import Part, Selection
from .report import Report
from .verdict import Verdict, verdict

Job = tuple[str, int]
"""Cell and seed."""


def _jobs(selection: Selection) -> list[Job]:
    for name in selection.cells:
        load_cell(name)  # a mistake in a cell shows here, in one line, and not in every worker
    return [(name, seed) for seed in selection.seeds for name in selection.cells]


def _play(job: Job) -> Verdict:
    return verdict(*job)


HOSTILE = Part(_jobs, _play, Report)
