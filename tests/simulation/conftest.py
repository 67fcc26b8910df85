"""Runs of the whole line in virtual time: script, lease, tick, CAN frames, drives, physics."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from telerobot.config.load import Cell, load_cell
from telerobot.protocols.messages.rig import RigTruth
from telerobot.protocols.messages.telemetry import Event, State
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Result, Simulation

STICK = {"twist": [0.0, 0.05, 0.02, 0.0, 0.0, 0.1], "expressed_in": "base"}
REST = {"twist": [0.0] * 6}


@dataclass(frozen=True)
class Run:
    """A finished simulation, with what tests ask of it most."""

    simulation: Simulation
    result: Result

    @property
    def summary(self) -> dict[str, Any]:
        return self.result.summary

    @property
    def states(self) -> tuple[State, ...]:
        return self.result.states

    @property
    def truths(self) -> tuple[RigTruth, ...]:
        return self.result.truths

    def events(self, name: str) -> list[Event]:
        return [e for e in self.simulation.events if e.name == name]

    def at(self, script_s: float) -> State:
        """Return the state at a time of the script."""
        start = self.simulation.player.start_s
        return min(self.states, key=lambda s: abs(s.time_s - start - script_s))

    def speeds(self, from_s: float, to_s: float) -> np.ndarray:
        """Return true joint speeds (k, n) between two times of the script [rad/s]."""
        start = self.simulation.player.start_s
        return np.array([t.dq for t in self.truths if from_s <= t.time_s - start - 1e-9 <= to_s])


@pytest.fixture(scope="session")
def pa10() -> Cell:
    return load_cell("pa10")


@pytest.fixture(scope="session")
def ur5e() -> Cell:
    return load_cell("ur5e")


@pytest.fixture
def play(pa10: Cell) -> Callable[..., Run]:
    """Run steps, given as tables of a script, on a cell (PA-10 by default)."""

    def run(*steps: dict[str, Any], seconds: float, cell: Cell = pa10, **script: Any) -> Run:
        made = Script.model_validate({"duration_s": seconds, "step": list(steps), **script})
        simulation = Simulation(cell, made)
        return Run(simulation, simulation.run())

    return run
