"""Runs of the whole line, from script to physics, for exhibits."""

from typing import Any, NamedTuple

import numpy as np
from telerobot.config.load import Cell, load_cell
from telerobot.protocols.messages.rig import RigTruth
from telerobot.protocols.messages.telemetry import State
from telerobot.server.control.spatial import Array
from telerobot.tools.scripts.script import Script, load_script
from telerobot.tools.simulation.judges import ViewJudge
from telerobot.tools.simulation.simulation import Simulation


class Run(NamedTuple):
    """A run that nothing spoke against."""

    states: tuple[State, ...]
    truths: tuple[RigTruth, ...]
    summary: dict[str, Any]
    start_s: float
    """When the script began [s]."""
    view: ViewJudge
    """Knows the true views that were stored."""

    @property
    def times(self) -> Array:
        """Script's time of the truths (t,) [s]."""
        return np.array([truth.time_s for truth in self.truths]) - self.start_s


def run(cell: Cell | str, script: Script | str) -> Run:
    """Play a script; raises `ValueError` where the run failed or a limit was violated."""
    cell = load_cell(cell) if isinstance(cell, str) else cell
    script = load_script(script) if isinstance(script, str) else script
    simulation = Simulation(cell, script)
    found = simulation.run()
    if found.summary["failure"] is not None or found.summary["limit_violations"]:
        raise ValueError(f"{cell.config.name}: {found.summary}")
    return Run(
        found.states, found.truths, found.summary, simulation.player.start_s, simulation.view
    )
