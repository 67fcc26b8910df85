"""Verdict on one run, by the bus, the physics and an independent model of the arm."""

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from laboratory.oracle.arm import OracleArm
from laboratory.oracle.poses import Array, difference, matrix
from telerobot.config.load import load_cell
from telerobot.config.schema.section import PoseSection
from telerobot.protocols.messages.rig import RigTruth
from telerobot.tools.simulation.judges import JUDGED_S
from telerobot.tools.simulation.simulation import Simulation
from telerobot.tools.soak.cli import ComputedSights, Touches

from .generator import Goal, HostilePlan, generate

REACHED = (1e-3, 2e-3)
"""A target pose is reached when the true tool stays within this of it [m], [rad]."""
POSTURE_REACHED = 1e-3
"""A posture is reached when every true joint is within this of it [rad]."""
TOUCHING = (0.5, 0.01)
"""Evidence of a touch: contact force on a fixed thing or an own link [N]; distance between own
links by the campaign's own model [m]."""
LOOK_EVERY = 2
"""Ticks between two looks at the distance between own links [1]."""


@dataclass(frozen=True)
class Verdict:
    """The figures of one run; all plain values."""

    cell: str
    seed: int
    scene: str
    goal: str
    infeasible: str
    """Reason for an infeasible goal, or empty."""
    failure: str
    ticks: int
    limited_ticks: int
    limits: dict[str, int]
    """Ticks in which each kind of limit was active."""
    limit_violations: int
    violations: tuple[str, ...]
    unexpected: tuple[str, ...]
    """Faults and refusals of the gate that no touch just before them explains."""
    touched: bool
    """The arm hit something, or itself: its goal does not count."""
    max_speed_ratio: float
    max_acceleration_ratio: float
    error: tuple[float, float]
    """[m], [rad]: of a target, the largest over the last half second; of a posture, 0 and the
    farthest joint when the server said that it is reached: from then on other sources may act."""
    reached: bool
    tick_us_p50: float
    tick_us_p99: float
    tick_us_max: float
    command_hash: str

    @property
    def name(self) -> str:
        """Cell and seed."""
        return f"{self.cell} seed {self.seed}"

    @property
    def counts(self) -> bool:
        """True when the goal was feasible and nothing was hit."""
        return not self.infeasible and not self.touched and not self.failure

    @property
    def reasons(self) -> list[str]:
        """Broken promises of the run."""
        reasons = list(self.unexpected)
        if self.failure:
            reasons.append(f"not played: {self.failure}")
        if self.limit_violations:
            reasons.append(f"{self.limit_violations} limit violations: {self.violations[0]}")
        if self.counts and not self.reached:
            metres, radians = self.error
            apart = f"missed by {1e3 * metres:.2f} mm, {1e3 * radians:.2f} mrad"
            never = math.isinf(radians)
            reasons.append(f"{self.goal} {'never reached' if never else apart}")
        return reasons


def play(plan: HostilePlan) -> Verdict:
    """Run a plan in virtual time and judge it."""
    simulation = Simulation(plan.cell, plan.script, cameras=lambda s: ComputedSights(s, plan.seed))
    touches = Touches(simulation)
    settled_s = JUDGED_S if plan.goal.kind == "posture" else math.inf
    result = simulation.run(
        lambda: simulation.clock.time_s >= _posture_s(plan.goal, simulation) + settled_s
    )
    summary = result.summary
    touched = touches.most_n > TOUCHING[0] or _folded(OracleArm.of(plan.cell), result.truths)
    error = _error(plan.goal, simulation, result.truths)
    bound = REACHED if plan.goal.kind == "target" else (math.inf, POSTURE_REACHED)
    names = Counter(name.partition(":")[0] for s in result.states for name in set(s.limits))
    tick_us: Any = summary["tick_us"]
    return Verdict(
        cell=plan.cell.config.name,
        seed=plan.seed,
        scene=plan.scene,
        goal=plan.goal.kind,
        infeasible=plan.goal.infeasible,
        failure=str(summary["failure"] or ""),
        ticks=len(result.states),
        limited_ticks=sum(bool(s.limits) for s in result.states),
        limits=dict(sorted(names.items())),
        limit_violations=len(simulation.observer.violations),
        violations=tuple(
            f"{v.joint} {v.kind} {v.value:.6g} over {v.bound:.6g} at {v.time_s:.3f} s"
            for v in simulation.observer.violations[:5]
        ),
        unexpected=tuple(touches.unexplained()),
        touched=touched,
        max_speed_ratio=simulation.observer.max_speed_ratio,
        max_acceleration_ratio=simulation.observer.max_acceleration_ratio,
        error=error,
        reached=error[0] <= bound[0] and error[1] <= bound[1],
        tick_us_p50=tick_us["p50"],
        tick_us_p99=tick_us["p99"],
        tick_us_max=tick_us["max"],
        command_hash=str(summary["command_hash"]),
    )


def _folded(arm: OracleArm, truths: tuple[RigTruth, ...]) -> bool:
    """Return whether own links came to each other by the campaign's own model."""
    return any(arm.clearance(np.array(t.q))[1] < TOUCHING[1] for t in truths[::LOOK_EVERY])


def _error(goal: Goal, simulation: Simulation, truths: tuple[RigTruth, ...]) -> tuple[float, float]:
    if goal.kind == "posture":
        when_s = _posture_s(goal, simulation)
        truth = next((t for t in truths if t.time_s >= when_s), None)
        if truth is None:
            return 0.0, math.inf
        return 0.0, float(np.abs(np.array(truth.q) - goal.q).max())
    last = truths[-round(JUDGED_S / simulation.cell.config.timing.period_s) :]
    errors = [difference(goal.T_target, _pose(t)) for t in last]
    return (
        max((float(np.linalg.norm(e[:3])) for e in errors), default=math.inf),
        max((float(np.linalg.norm(e[3:])) for e in errors), default=math.inf),
    )


def _posture_s(goal: Goal, simulation: Simulation) -> float:
    """Return when the server said that the posture of the goal is reached, inf if not yet [s]."""
    since_s = simulation.player.start_s + goal.at_s
    said = (e.time_s for e in simulation.events if e.name == "posture_reached")
    return next((t for t in said if t >= since_s), math.inf)


def _pose(truth: RigTruth) -> Array:
    return matrix(PoseSection(xyz=truth.pose_mrf[:3], rpy=truth.pose_mrf[3:]))


def verdict(cell: str, seed: int) -> Verdict:
    """Return the verdict on the run of a seed in a shipped cell, or one of a path."""
    return play(generate(load_cell(cell), seed))
