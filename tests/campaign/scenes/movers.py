"""Hostile movers of a scene: they chase the arm within their stated bounds.

A mover goes for a link of the true arm at nearly its greatest speed, turns away, stops, or falls
silent and goes on; when what, is drawn beforehand. One whose acceleration is bounded changes its
velocity accordingly, tick by tick; of any other the velocity may jump. One that comes to the arm
has hit it, which is counted, and stands there. It is a ghost: distances to it are true, but it does
not push, so that how the arm moves can be judged on after a hit.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from telerobot.config.load import Cell
from telerobot.config.schema.surroundings import ObstacleSection
from telerobot.tools.scripts.script import MovingObstacle
from telerobot.tools.simulation.simulation import Simulation

Vector = NDArray[np.float64]
Does = Literal["chase", "turn", "stop", "silent"]

FASTEST = 0.95
"""Part of its stated bounds that a mover uses [1]."""
EVERY_S = 0.05
"""A mover that can turn at once takes aim so often [s]."""
STANDS = (1e-6, 0.0, 0.0)
"""Velocity of one that stands and is still told of [m/s]."""


@dataclass(frozen=True)
class Act:
    """Act of a mover from a time on."""

    at_s: float
    does: Does
    way: tuple[float, float, float]
    """Direction to turn to; length 1."""
    part: float
    """Point of aim along the arm: 0 at the Base, 1 at the last link [1]."""


@dataclass(frozen=True)
class RandomMover:
    """One obstacle that moves, and what it is going to do."""

    obstacle: ObstacleSection
    acts: tuple[Act, ...]


def mover(draw: np.random.Generator, obstacle: ObstacleSection, until_s: float) -> RandomMover:
    """Draw what an obstacle does until a time [s]."""
    acts: list[Act] = []
    at_s = 0.0
    while at_s < until_s:
        way = draw.normal(size=3)
        x, y, z = (way / np.linalg.norm(way)).tolist()
        does: tuple[Does, ...] = ("chase", "chase", "chase", "turn", "stop", "silent")
        chosen = "chase" if not acts else does[int(draw.integers(len(does)))]
        acts.append(Act(at_s, chosen, (x, y, z), float(draw.uniform(0.3, 1.0))))
        at_s += float(draw.uniform(0.2, 1.0))
    return RandomMover(obstacle, tuple(acts))


class Chase:
    """Moves what moves in a run, tick by tick."""

    def __init__(self, cell: Cell, movers: tuple[RandomMover, ...], simulation: Simulation) -> None:
        self._movers, self._simulation = movers, simulation
        self._period_s = cell.config.timing.period_s
        model = simulation.rig.world.model
        self._links = [int(model.joint(j.name).bodyid[0]) for j in cell.robot.joints]
        self._body = {
            m.obstacle.name: int(model.body(f"obstacle_{m.obstacle.name}").id) for m in movers
        }
        for body in self._body.values():
            first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
            model.geom_contype[first : first + count] = 0
            model.geom_conaffinity[first : first + count] = 0
        self._velocity: dict[str, Vector] = {}
        self._silent: set[str] = set()
        self._aimed_s: dict[str, float] = {}

    def run(self, at_s: float, touching: str = "") -> None:
        """Move on to a time of the script [s]; `touching` names a mover that has hit the arm."""
        for m in self._movers:
            name, act = m.obstacle.name, [a for a in m.acts if a.at_s <= at_s][-1]
            if name == touching and act.does != "turn":
                self._go(m.obstacle, np.zeros(3), hit=True)
            elif act.does == "silent" and name in self._velocity:
                if name not in self._silent:
                    self._silent.add(name)
                    self._simulation.player.move(
                        MovingObstacle.model_validate({"name": name, "silent": True})
                    )
            elif m.obstacle.max_acceleration is not None or self._due(name, at_s):
                self._go(m.obstacle, self._wanted(m.obstacle, act))

    def tells(self, name: str) -> bool:
        """Return whether a mover is told of now."""
        return name not in self._silent

    def end(self, touching: str = "", away: Vector | None = None) -> None:
        """Let all movers stand, but for one that backs `away` (3,), length 1."""
        for m in self._movers:
            speed = FASTEST * m.obstacle.max_speed if m.obstacle.name == touching else 0.0
            self._go(m.obstacle, np.zeros(3) if away is None else speed * away)

    def _due(self, name: str, at_s: float) -> bool:
        """Return whether one that turns at once takes aim again."""
        due = at_s >= self._aimed_s.get(name, -1.0) + EVERY_S
        if due:
            self._aimed_s[name] = at_s
        return due

    def _wanted(self, obstacle: ObstacleSection, act: Act) -> Vector:
        speed = FASTEST * obstacle.max_speed
        if act.does == "stop":
            return np.zeros(3)
        if act.does == "turn":
            return speed * np.array(act.way)
        place = self._simulation.rig.world.data.xpos
        link = self._links[round(act.part * (len(self._links) - 1))]
        way = place[link] - place[self._body[obstacle.name]]
        return np.asarray(speed * way / max(float(np.linalg.norm(way)), 1e-9))

    def _go(self, obstacle: ObstacleSection, wanted: Vector, hit: bool = False) -> None:
        """Bring one nearer to a velocity (3,), and tell where it is and goes if that changes."""
        name = obstacle.name
        before = self._velocity.get(name, np.zeros(3))
        change = wanted - before
        if obstacle.max_acceleration is not None and not hit:
            most = FASTEST * obstacle.max_acceleration * self._period_s
            change = change * min(1.0, most / max(float(np.linalg.norm(change)), 1e-12))
        if name in self._velocity and name not in self._silent and not change.any():
            return
        fresh = {} if name in self._velocity else {"xyz": obstacle.xyz}
        self._silent.discard(name)
        after = self._velocity[name] = before + change
        x, y, z = after.tolist() if after.any() else STANDS
        step = MovingObstacle.model_validate({"name": name, "velocity": (x, y, z), **fresh})
        self._simulation.player.move(step)
