"""Part `hostile`: every seed in every cell, with a goal at the end of each run."""

from telerobot.config.errors import ConfigError
from telerobot.config.load import load_cell

from ..part import Part, Selection
from .report import Report
from .verdict import Verdict, verdict

Job = tuple[str, int]
"""Cell and seed."""


SEEING_EVERY = 4
"""A cell with cameras takes the first seed and every fourth after it: its runs are longer [1]."""


def _jobs(selection: Selection) -> list[Job]:
    # A mistake in a cell shows here, in one line, and not in every worker.
    cells = {name: load_cell(name) for name in selection.cells}
    for cell in cells.values():
        if len(cell.parts) > 1:
            raise ConfigError(
                f"{cell.path}: mechanisms: {len(cell.parts)} tables: hostile parts lead one arm; "
                "the part 'arms' leads two"
            )
    every = {name: SEEING_EVERY if cell.config.cameras else 1 for name, cell in cells.items()}
    return [
        (name, seed)
        for i, seed in enumerate(selection.seeds)
        for name in selection.cells
        if i % every[name] == 0
    ]


def _play(job: Job) -> Verdict:
    return verdict(*job)


HOSTILE = Part(_jobs, _play, Report)
