"""Part `payloads`: under each payload the tool comes to rest after a push, or is refused.

A grid: 0 to 5 kg more on the grip, rightly declared, M of 0.5 to 5 kg, B of 10 to 60 N·s/m, in CSP,
CSV and CST, pushed for a second from one side or another. At rest within two seconds by the
physics' truth, or `check` has an error; then the run is not played.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, Literal, NamedTuple

import numpy as np
from telerobot.config.load import Cell, load_cell
from telerobot.config.schema.mechanism import PayloadSection
from telerobot.tools.checks.drives import following
from telerobot.tools.checks.findings import Severity
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from .part import Part, Selection
from .runs import Runs

CELL = "pa10_hand"
MORE_AT = 0.10
"""Centre of the added mass in the Sensor frame [m]."""
PUSH_N, AT_S, PUSHED_S, REST_S, JUDGED_S = 4.0, 0.6, 1.0, 2.0, 0.2
STANDS = 0.01
"""A tool that is slower is at rest [m/s]."""
LAG_S = 0.1
"""M / B is up to half a second: what the law itself would leave so long before the look is rest."""
SIDES = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (-0.6, 0.0, -0.8))
KILOGRAMS, MASSES, DAMPINGS = (
    (0.0, 0.5, 1.0, 2.0, 3.0, 5.0),
    (0.5, 1.0, 2.0, 5.0),
    (10.0, 20.0, 60.0),
)
MODES: tuple["Mode", ...] = ("csp", "csv", "cst")

Mode = Literal["csp", "csv", "cst"]


class PayloadJob(NamedTuple):
    """One point of the grid."""

    mode: Mode
    more: float
    """On the grip, beside it [kg]."""
    mass: float
    damping: float
    side: int


def laden(more: float, mode: Mode = "csp", rate_hz: int | None = None, **impedance: float) -> Cell:
    """Return the cell with `more` kilograms on its grip, rightly declared."""
    cell = load_cell(CELL)
    c, sensor, rig = cell.config, cell.config.mechanism.force_torque, cell.config.rig
    if sensor is None or rig is None:
        raise ValueError(f"cell {c.name}: needs a force/torque sensor and a rig")
    own = sensor.payload
    mass = own.mass + more
    x, y, z = (
        (own.mass * a + more * b) / mass for a, b in zip(own.com, (0, 0, MORE_AT), strict=True)
    )
    told: dict[str, Any] = {"payload": PayloadSection(mass=mass, com=(x, y, z))}
    if rate_hz is not None:
        told["rate_hz"] = rate_hz
    mechanism = c.mechanism.model_copy(
        update={"force_torque": sensor.model_copy(update=told), "operation_mode": mode}
    )
    true = rig.model_copy(update={"payload_mass": more, "payload_com": (0.0, 0.0, MORE_AT)})
    source = c.sources.following.model_copy(update=impedance)
    changed = {
        "mechanism": mechanism,
        "rig": true,
        "sources": c.sources.model_copy(update={"following": source}),
    }
    return replace(cell, config=c.model_copy(update=changed))


def pushed(force: Sequence[float], seconds: float = PUSHED_S) -> Script:
    """Return a script in which a hand pushes the tool (3,) [N] for a while, then waits."""
    steps = [
        {
            "at_s": AT_S,
            "rig/fault": {"kind": "hand", "target": "force_torque", "vector": list(force)},
        },
        {
            "at_s": AT_S + seconds,
            "rig/fault": {"kind": "hand", "target": "force_torque", "on": False},
        },
    ]
    return Script.model_validate({"duration_s": AT_S + seconds + REST_S, "step": steps})


def speed_at_the_end(simulation: Simulation) -> float:
    """Return the tool's greatest true speed at the end of a run [m/s]."""
    period = simulation.cell.config.timing.period_s
    last = simulation.truths[-round(JUDGED_S / period) - 1 :]
    places = np.array([truth.pose_mrf[:3] for truth in last])
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).max() / period)


def left_by_the_law(mass: float, damping: float) -> float:
    """Return how fast M dv/dt + B v = F still is, a little before the judge's look [m/s]."""
    rate = damping / mass
    reached = PUSH_N / damping * (1.0 - math.exp(-rate * PUSHED_S))
    return reached * math.exp(-rate * (REST_S - JUDGED_S - LAG_S))


@dataclass(frozen=True)
class PayloadRun:
    """Result of one run."""

    name: str
    refused: bool
    """`check` has an error, so that it was not played."""
    speed: float
    """At the end [m/s]."""
    reasons: list[str] = field(default_factory=list)


class Grid(Runs[PayloadRun]):
    """Summary of all runs."""

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        return super().figures() | {
            "refused": sum(run.refused for run in self.runs),
            "fastest_at_the_end": max((run.speed for run in self.runs), default=0.0),
        }

    def lines(self) -> list[str]:
        """Return the report."""
        f = self.figures()
        return [
            f"payloads under a hand: {f['runs']} runs, {f['refused']} refused by check, "
            f"{len(self.failing)} not at rest; at the end at most "
            f"{f['fastest_at_the_end']:.4f} m/s",
            *super().lines(),
        ]


def play(job: PayloadJob) -> PayloadRun:
    """Judge one point of the grid by `check`, and by a simulation where that finds no error."""
    mode, more, mass, damping, side = job
    cell = laden(more, mode, mass=mass, damping=damping)
    name = f"payload {more:g} kg, {mode}, M = {mass:g}, B = {damping:g}, side {side}"
    if any(finding.status is Severity.ERROR for finding in following(cell)):
        return PayloadRun(name, True, 0.0)
    simulation = Simulation(cell, pushed([PUSH_N * x for x in SIDES[side]]))
    result = simulation.run()
    speed, reasons = speed_at_the_end(simulation), []
    if speed >= max(STANDS, left_by_the_law(mass, damping)):
        reasons.append(f"{speed:.3f} m/s, {REST_S:g} s after the push")
    if result.summary["mode"] != "enabled":
        reasons.append(f"the arm is in {result.summary['mode']}")
    if result.summary["limit_violations"]:
        reasons.append(f"{result.summary['limit_violations']} limit violations")
    return PayloadRun(name, False, speed, reasons)


def jobs(selection: Selection) -> list[PayloadJob]:
    """Return the grid, pushed from one side for each seed from 0 to 3 that is selected."""
    sides = sorted({seed % len(SIDES) for seed in selection.seeds})
    return [PayloadJob(*point) for point in product(MODES, KILOGRAMS, MASSES, DAMPINGS, sides)]


PAYLOADS = Part(jobs, play, Grid)
