"""Makes a run from a cell and a seed: scene, hostile script, and a goal to be judged at its end.

A run is a hostile part (`telerobot soak` plays such ones), then order is restored and the arm is
sent to a posture, or from a known posture to a target pose, sometimes with a stick that nudges it.
Some arms have a gripper, some cells cameras; some stand on a platform that sways, or work beside a
conveyor.
Most scenes are open: nothing but the arm. Some are the cell's own, with its wall and table, which
the arm mostly hits: this server does not avoid obstacles.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from laboratory.oracle.feasible import GoalJudge
from laboratory.oracle.poses import Array, difference, rotation
from telerobot.config.load import Cell, altered
from telerobot.config.schema.sources import ScheduleSection
from telerobot.tools.scripts.script import Script, Step
from telerobot.tools.soak.segments import (
    HOSTILE_S,
    OPENING_S,
    RESTORE_S,
    Draw,
    hostile,
    restored,
    step,
)

from .cells import opened, with_gripper, with_moving

POSTURE_S = 7.0
"""A posture is reached within this time from wherever the hostile part ends, also where the tool
has to go half around the arm at its greatest speed [s]."""
SETTLE_S = 2.6
"""After a path, and after a nudge, the error feedback has this long to settle [s]."""
FURNISHED = 0.12
"""Part of the scenes with the cell's wall and table [1]."""
SCHEDULED = 0.25
"""Part of the cells whose gains follow schedules [1]."""
GRIPPING = 0.3
"""Part of the cells that have a gripper, and something to pick up [1]."""
MOVING = 0.25
"""Part of the cells whose Base or Carrier moves [1]."""
INFEASIBLE = 0.2
"""Part of the target poses that are drawn without regard to feasibility [1]."""
FRUITLESS_S = 3.0
"""An infeasible target is striven for during this time [s]."""
TRIES = 30
"""Draws of a feasible goal before one that is known is taken [1]."""


@dataclass(frozen=True)
class Goal:
    """Goal that a run ends with."""

    kind: Literal["posture", "target"]
    q: Array
    """The posture (n,) [rad]; for a target, the known one that it is approached from."""
    T_target: Array
    """The pose (4, 4) of the MRF in World."""
    infeasible: str
    """Reason why it does not count, or empty."""
    at_s: float
    """Time of its command, in the script's time [s]."""


@dataclass(frozen=True)
class HostilePlan:
    """One run of a campaign."""

    cell: Cell
    seed: int
    scene: Literal["open", "furnished"]
    script: Script
    goal: Goal


def generate(cell: Cell, seed: int) -> HostilePlan:
    """Return the run of a seed; equal seeds give equal runs."""
    draw = np.random.default_rng([seed, *cell.config.name.encode()])
    furnished = bool(draw.random() < FURNISHED)
    if not furnished:
        cell = opened(cell)
    if draw.random() < SCHEDULED:
        cell = altered(cell, {"schedules": _schedules(draw)})
    if draw.random() < GRIPPING:
        cell = with_gripper(draw, cell)
    if draw.random() < MOVING:
        cell = with_moving(draw, cell)
    judge = GoalJudge.of(cell)
    end_s = float(draw.uniform(*HOSTILE_S)) + (OPENING_S if cell.config.cameras else 0.0)
    steps = hostile(draw, cell, end_s) + restored(cell, end_s)
    go_s = end_s + RESTORE_S
    posture = _posture(draw, cell, judge)
    steps.append(step(go_s, {"cmd/posture": {"q": tuple(posture.tolist())}}))
    duration_s = go_s + POSTURE_S
    if draw.random() < 0.4:
        goal = _target(draw, judge, posture, duration_s)
        path_s = FRUITLESS_S if goal.infeasible else _path_s(judge, posture, goal.T_target)
        nudged = not goal.infeasible and bool(draw.random() < 0.5)
        steps += _approach(draw, goal, nudged)
        duration_s += path_s + SETTLE_S + (1.0 if nudged else 0.0)
    else:
        goal = Goal("posture", posture, judge.arm.tool(posture), judge.posture(posture), go_s)
    script = Script(description=f"campaign seed {seed}", duration_s=duration_s, step=tuple(steps))
    return HostilePlan(cell, seed, "furnished" if furnished else "open", script, goal)


def _posture(draw: Draw, cell: Cell, judge: GoalJudge) -> Array:
    """Return a feasible posture near one of the cell's."""
    known = cell.config.mechanism.postures
    for _ in range(TRIES):
        q = np.array(known[str(draw.choice(sorted(known)))])
        q = q + draw.uniform(-0.15, 0.15, len(q))
        if not judge.posture(q):
            return q
    return np.array(known["ready"])


def _target(draw: Draw, judge: GoalJudge, posture: Array, at_s: float) -> Goal:
    """Return a target pose from a known posture: as it comes, or a feasible one."""
    as_it_comes = bool(draw.random() < INFEASIBLE)
    reach, turn = (1.0, 1.2) if as_it_comes else (0.18, 0.45)
    start = judge.arm.tool(posture)
    for _ in range(TRIES):
        T = start.copy()
        T[:3, 3] += draw.uniform(-reach, reach, 3)
        T[:3, :3] = rotation(draw.uniform(-turn, turn, 3)) @ T[:3, :3]
        why = judge.target(posture, T)
        if as_it_comes or not why:
            return Goal("target", posture, T, why, at_s)
    return Goal("target", posture, start, judge.target(posture, start), at_s)


def _path_s(judge: GoalJudge, posture: Array, T: Array) -> float:
    """Return a time that is enough for the path [s]: its speed and its ramps."""
    way = difference(T, judge.arm.tool(posture))
    return 0.6 + max(
        float(np.linalg.norm(part)) / speed
        for part, speed in zip((way[:3], way[3:]), judge.speed, strict=True)
    )


def _approach(draw: Draw, goal: Goal, nudged: bool) -> list[Step]:
    at_s = goal.at_s
    R = goal.T_target[:3, :3]
    pitch = math.atan2(-R[2, 0], math.hypot(R[0, 0], R[1, 0]))
    rpy = (math.atan2(R[2, 1], R[2, 2]), pitch, math.atan2(R[1, 0], R[0, 0]))
    position = {"xyz": goal.T_target[:3, 3].tolist(), "rpy": rpy, "relative_to": "world"}
    steps = [step(at_s, {"cmd/position": position})]
    if nudged:
        twist = [*draw.uniform(-0.05, 0.05, 3).tolist(), *draw.uniform(-0.15, 0.15, 3).tolist()]
        stick = {"twist": twist, "expressed_in": "world"}
        steps.append(step(at_s + 0.3, {"cmd/joystick": stick}))
        steps.append(step(at_s + 1.3, {"cmd/joystick": {"twist": (0.0,) * 6}}))
    return steps


def _schedules(draw: Draw) -> tuple[ScheduleSection, ...]:
    """Return gain schedules, some of them steep; those of the position source let it settle."""
    found = []
    for source in ("joystick", "position", "force"):
        by = str(draw.choice(["distance", "time", "contact_force"][: 2 + (source != "position")]))
        end = {"contact_force": 30.0, "distance": 0.2, "time": 6.0}[by]
        at = np.sort(draw.uniform(0.0, end, 3)) + np.array([0.0, 1e-3, 2e-3])
        factor = np.sort(draw.uniform(0.2, 1.0, 3))
        if source == "position":
            factor[-1] = 1.0
        if by == "distance":
            factor = factor[::-1]
        table = {"at": tuple(at.tolist()), "factor": tuple(factor.tolist())}
        found.append(ScheduleSection.model_validate({"source": source, "by": by, **table}))
    return tuple(found)
