"""Part `crossings`: joint rates do not jump where an arm crosses a singularity.

Straight ways of the joints through postures that are singular or nearly so, with a fixed twist. The
steps between samples that are largest are halved again and again: a jump is what stays. One kind is
allowed, where the way home from a singularity is gone to the other side.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from laboratory.oracle.poses import Array
from telerobot.config.load import HERE, Cell, load_cell, read_toml, shipped
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.mechanism.resolution import Resolved, resolve
from telerobot.server.control.spatial import Pose
from telerobot.tools.soak.segments import Draw

from ..part import Part, Selection

LINES = 20
"""Ways of one seed on one arm [1]."""
REACH = 0.15
"""Each goes so far to either side [rad]."""
SAMPLES = 60
SUSPECTS = 5
"""Number of the largest steps that are halved [1] …"""
FINEST = 1e-10
"""… down to this [rad]."""
JUMP = 1e-3
"""Rates that differ by more there have jumped [rad/s]."""
SPEED, ANGULAR_SPEED = 0.1, 0.3
"""Size of the twists [m/s], [rad/s]."""


class Line:
    """Rates along a straight way of an arm's joints, with a fixed twist."""

    def __init__(self, arm: "Singular", q: Array, way: Array, twist: Array) -> None:
        """`q` and `way`, a unit direction, are (n,) [rad]; `twist` (6,) is in World axes."""
        self._arm, self._q, self._way, self._twist = arm, q, way, twist

    def at(self, far: float) -> Resolved:
        """Return the rates so far along the way [rad]."""
        J = self._arm.jacobian(self._q + far * self._way)
        return resolve(J, self._twist, self._arm.p, rank=self._arm.mechanism.rank)

    def jumps(self) -> tuple[list[float], int]:
        """Return by how much rates jump, sides apart, and how often the floor is crossed."""
        places = np.linspace(-REACH, REACH, SAMPLES)
        found = [self.at(place) for place in places]
        rates = np.array([r.dq for r in found])
        steps = np.linalg.norm(np.diff(rates, axis=0), axis=1)
        jumps = []
        for i in np.argsort(steps)[-SUSPECTS:]:
            before, after = self._narrowed(places[i], places[i + 1])
            size = float(np.linalg.norm(after.dq - before.dq))
            if size > JUMP and not _other_side(before, after):
                jumps.append(size)
        below = np.array([r.sigma_min < self._arm.p.floor for r in found])
        return jumps, int(np.count_nonzero(np.diff(below)))

    def _narrowed(self, first: float, last: float) -> tuple[Resolved, Resolved]:
        """Return rates on both sides of the largest step within a stretch of the way."""
        before, after = self.at(first), self.at(last)
        while last - first > FINEST:
            middle = 0.5 * (first + last)
            there = self.at(middle)
            if np.linalg.norm(there.dq - before.dq) > np.linalg.norm(after.dq - there.dq):
                last, after = middle, there
            else:
                first, before = middle, there
        return before, after


def _other_side(before: Resolved, after: Resolved) -> bool:
    """Return whether all that has jumped is the side to which the arm leaves a singularity."""
    if before.way_home is None or after.way_home is None:
        return False
    rest = (after.dq - after.way_home) - (before.dq - before.way_home)
    return float(before.way_home @ after.way_home) < 0.0 and float(np.linalg.norm(rest)) < JUMP


class Singular:
    """An arm, and ways through its singular postures."""

    def __init__(self, mechanism: Mechanism, cell: Cell) -> None:
        """Take the damping and the tool of a cell, which need not be the mechanism's own."""
        m = cell.config.mechanism
        self.mechanism, self.p = mechanism, cell.config.resolve
        self._T_wrist_mrf = Pose.from_xyz_rpy(m.T_wrist_mrf.xyz, m.T_wrist_mrf.rpy)
        length = self.p.characteristic_length
        self._weight = np.array([1.0, 1.0, 1.0, length, length, length])[:, None]

    def jacobian(self, q: Array) -> Array:
        """Return the tool's Jacobian (6, n) at q (n,) [rad]."""
        return self.mechanism.kinematics(q, self._T_wrist_mrf).J

    def sigma(self, q: Array) -> Array:
        """Return the singular values (r,) of axes that the arm reaches, largest first."""
        s = np.linalg.svd(self._weight * self.jacobian(q), compute_uv=False)
        return np.asarray(s[: self.mechanism.rank])

    def line(self, draw: Draw) -> Line:
        """Draw a way through a posture that is singular."""
        n = self.mechanism.n
        q = draw.uniform(-np.pi, np.pi, n)
        if draw.random() < 0.5:  # aligned axes: singular to the last digit, often doubly
            which = draw.random(n) < 0.4
            q[which] = draw.choice([0.0, 0.5 * np.pi, -0.5 * np.pi, np.pi], n)[which]
        q = self._sunk(q, self.p.floor * float(draw.uniform(0.05, 1.0)))
        way = draw.normal(size=n)
        linear, angular = draw.normal(size=3), draw.normal(size=3)
        linear *= SPEED / np.linalg.norm(linear)
        angular *= float(draw.choice([0.0, ANGULAR_SPEED])) / np.linalg.norm(angular)
        return Line(self, q, way / np.linalg.norm(way), np.concatenate([linear, angular]))

    def _sunk(self, q: Array, target: float) -> Array:
        """Return a posture (n,) near q whose least singular value is below the target [m]."""
        for _ in range(60):
            least = float(self.sigma(q)[-1])
            if least < target:
                break
            slope = np.zeros(len(q))
            for j, aside in enumerate(1e-6 * np.eye(len(q))):
                slope[j] = (self.sigma(q + aside)[-1] - self.sigma(q - aside)[-1]) / 2e-6
            step = -(least - 0.3 * target) * slope / max(float(slope @ slope), 1e-4)
            q = q + step * min(1.0, 0.3 / float(np.linalg.norm(step)))
        return q


@dataclass(frozen=True)
class Crossed:
    """The ways of one seed on one arm."""

    name: str
    crossings: int
    reasons: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Crossings:
    """Summary of all paths."""

    ways: Sequence[Crossed]

    @property
    def kept(self) -> bool:
        """True when no rate jumped."""
        return not any(way.reasons for way in self.ways)

    def figures(self) -> dict[str, object]:
        """Return everything as plain values."""
        arms = sorted({way.name.split()[0] for way in self.ways})
        return {
            "ways": LINES * len(self.ways),
            "crossings": {
                arm: sum(w.crossings for w in self.ways if w.name.split()[0] == arm) for arm in arms
            },
            "failing": [reason for way in self.ways for reason in way.reasons],
        }

    def lines(self) -> list[str]:
        """Return the report."""
        f = self.figures()
        return [
            f"{f['ways']} ways through singular postures, the floor crossed: {f['crossings']}",
            *(f"{way.name}: {reason}" for way in self.ways for reason in way.reasons),
        ]


def arms() -> list[str]:
    """Return the name of a shipped cell for every shipped arm, by what their files say.

    Tests ask while they are collected: no cell is loaded for it.
    """
    of: dict[str, str] = {}
    for name in sorted(shipped("cells"), key=len):
        told = read_toml(HERE / "cells" / f"{name}.toml").get("mechanism", {})
        if "urdf" in told:
            of.setdefault(Path(told["urdf"]).stem, name)
    return sorted(of.values())


def jobs(selection: Selection) -> list[tuple[str, int]]:
    """Return every seed on every shipped arm."""
    return [(name, seed) for seed in selection.seeds for name in arms()]


def play(job: tuple[str, int]) -> Crossed:
    """Go the ways of a seed."""
    name, seed = job
    cell = load_cell(name)
    arm, draw = Singular(Mechanism.from_cell(cell), cell), np.random.default_rng(seed)
    crossings, reasons = 0, []
    for i in range(LINES):
        jumps, crossed = arm.line(draw).jumps()
        crossings += crossed
        reasons += [f"way {i}: rates jump by {jump:.3g} rad/s" for jump in jumps]
    return Crossed(f"{name} seed {seed}", crossings, reasons)


CROSSINGS = Part(jobs, play, Crossings)
