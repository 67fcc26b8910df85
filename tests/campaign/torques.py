"""Part `torques`: at torque level no push, stop, reversal or payload makes the gate refuse.

One run for each seed: a hand that comes within 0 to 0.3 s, from any side and with up to 35 N, and
is turned round, moved aside or taken away; stops and holds in the middle of it, and their end;
payloads that are declared and are not there. Judged are refusals, faults and bounds broken on the
bus. A payload that is told wrong is a promise, too, and no abuse: the law does not swing by it at
rest (`torque.py`), and what steers by the sensor waits once it is found (`load_unexplained`).
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from laboratory.oracle.poses import Array
from telerobot.config.load import load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation
from telerobot.tools.soak.segments import Draw

from .part import Part, Selection
from .runs import Runs

CELL = "pa10_hand_torque"
MOST_N = 35.0
"""Greatest push [N]."""
RISES_S = (0.0, 0.02, 0.05, 0.2, 0.3)
"""Within this a push comes, or turns into another [s]."""
WRONG_KG = 3.0
"""A payload is declared up to so much heavier than it is [kg]."""
BEGIN_S, LENGTH_S = 0.4, 2.4


@dataclass(frozen=True)
class TorqueRun:
    """Result of one run."""

    name: str
    held_back_ticks: int
    """Ticks in which a torque or its step was bounded."""
    reasons: list[str] = field(default_factory=list)


class Kept(Runs[TorqueRun]):
    """Summary of all runs."""

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        return super().figures() | {
            "runs_held_back": sum(run.held_back_ticks > 0 for run in self.runs),
            "most_ticks_held_back": max((run.held_back_ticks for run in self.runs), default=0),
        }

    def lines(self) -> list[str]:
        """Return the report."""
        f = self.figures()
        return [
            f"pushes, stops and payloads at torque level: {f['runs']} runs, {len(self.failing)} "
            f"failed; torques held back in {f['runs_held_back']}, at most "
            f"{f['most_ticks_held_back']} ticks",
            *super().lines(),
        ]


def script(seed: int) -> Script:
    """Return a run of pushes with what comes between them."""
    draw = np.random.default_rng(seed)
    steps: list[dict[str, Any]] = []
    at_s, force = BEGIN_S, np.zeros(3)
    while at_s < LENGTH_S - 0.4:
        after = _next(draw, force)
        rise_s = float(draw.choice(RISES_S))
        steps += _risen(at_s, force, after, rise_s)
        force = after
        steps += _between(draw, at_s + rise_s * draw.uniform(0.0, 1.5))
        at_s += rise_s + draw.uniform(0.02, 0.6)
    steps.sort(key=lambda step: step["at_s"])
    return Script.model_validate({"duration_s": LENGTH_S, "step": steps})


def _next(draw: Draw, force: Array) -> Array:
    """Return another push (3,) [N]: the same turned round, none, or one from any side."""
    turn = draw.uniform()
    if turn < 0.3:
        return -force
    if turn < 0.4:
        return np.zeros(3)
    way = draw.normal(size=3)
    return np.asarray(draw.uniform(5.0, MOST_N) * way / np.linalg.norm(way))


def _risen(at_s: float, before: Array, after: Array, rise_s: float) -> list[dict[str, Any]]:
    """Return the steps that take a push from one value to another within a time."""
    parts = max(1, round(rise_s / 0.01))
    return [
        {
            "at_s": round(at_s + (i + 1) * rise_s / parts, 3),
            "rig/fault": {
                "kind": "hand",
                "target": "force_torque",
                "vector": np.round(before + (i + 1) / parts * (after - before), 2).tolist(),
            },
        }
        for i in range(parts)
    ]


def _between(draw: Draw, at_s: float) -> list[dict[str, Any]]:
    """Return what happens beside a push: a stop and its end, another payload, or nothing."""
    at_s, end_s = round(at_s, 3), round(at_s + draw.uniform(0.05, 0.6), 3)
    match int(draw.integers(5)):
        case 0:
            return [
                {"at_s": at_s, "operator/protective_stop": {}},
                {"at_s": end_s, "operator/protective_clear": {}},
                {"at_s": round(end_s + 0.02, 3), "operator/mode": {"action": "resume"}},
            ]
        case 1:
            return [
                {"at_s": at_s, "operator/mode": {"action": "hold"}},
                {"at_s": end_s, "operator/mode": {"action": "resume"}},
            ]
        case 2:
            mass, z = draw.uniform(0.98, 0.98 + WRONG_KG), draw.uniform(0.04, 0.12)
            payload = {"mass": round(mass, 2), "com": [0.0, 0.0, round(z, 3)]}
            return [{"at_s": at_s, "operator/payload": payload}]
        case _:
            return []


def play(seed: int) -> TorqueRun:
    """Simulate one run and judge it."""
    simulation = Simulation(load_cell(CELL), script(seed))
    result = simulation.run()
    wrong = ("gate_refused", "fault", "tick_raised")
    reasons = [f"{e.name}: {e.detail}" for e in simulation.events if e.name in wrong]
    if result.summary["failure"] is not None:
        reasons.append(str(result.summary["failure"]))
    if result.summary["limit_violations"]:
        reasons.append(f"{result.summary['limit_violations']} limit violations")
    told = sum(any(limit.startswith("torque:") for limit in s.limits) for s in result.states)
    return TorqueRun(f"torques {seed}", told, reasons)


def jobs(selection: Selection) -> list[int]:
    """Return the seeds."""
    return list(selection.seeds)


TORQUES = Part(jobs, play, Kept)
