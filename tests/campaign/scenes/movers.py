"""Hostile movers of a scene: they chase the arm within their stated bounds.

A mover goes for a link of the true arm at nearly its greatest speed, turns away, stops, or falls
silent and goes on; when what, is drawn beforehand. One whose acceleration is bounded changes its
velocity accordingly, tick by tick; of any other the velocity may jump. It is a solid body that the
arm cannot push aside. One that would come into the arm in a physics step has hit it, which is
counted: it comes no further, so that it presses with nothing but what the arm does.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray
from telerobot.config.load import Cell
from telerobot.config.schema.surroundings import ObstacleSection
from telerobot.protocols import topics as t
from telerobot.protocols.codec import encode
from telerobot.protocols.messages.perception import ObstacleNews
from telerobot.tools.scripts.generators import NEWS_EVERY_S
from telerobot.tools.simulation.simulation import Simulation

Vector = NDArray[np.float64]
Does = Literal["chase", "turn", "stop", "silent"]

FASTEST = 0.95
"""Part of its stated bounds that a mover uses [1]."""
ACTS_AFTER = 3
"""News is heard in the next period, and what is commanded then acts two later [1]."""
PROMISE = 0.02
"""Clearance that the daemon promises in these scenes [m]."""
DESCENTS = 20
"""Rounds over all other gaps in the search for what a retreat beside them is bounded by [1]."""
EVERY_S = 0.05
"""A mover that can turn at once takes aim so often [s]."""


def greatest_beside(row: Vector, beside: Vector, most: Vector) -> float:
    """Return max row · x over |x| ≤ `most` (n,) with beside (m, n) · x ≥ 0, or a bound above it.

    By duality it is the least of Σ |row + λ · beside| · most over λ ≥ 0, so that any λ bounds it
    from above: one λ after the other is brought to where that is least, a weighted median of the
    breakpoints.
    """
    share = np.zeros(len(beside))
    for _ in range(DESCENTS):
        for i, each in enumerate(beside):
            turns = np.flatnonzero(np.abs(each) > 1e-9)
            if not len(turns):
                continue
            rest = row + share @ beside - share[i] * each
            at = -rest[turns] / each[turns]
            order = np.argsort(at)
            weight = np.cumsum((np.abs(each[turns]) * most[turns])[order])
            share[i] = max(0.0, at[order][np.searchsorted(weight, 0.5 * weight[-1])])
    return float(np.abs(row + share @ beside) @ most)


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


class Touch(NamedTuple):
    """Where a mover meets the arm."""

    away: Vector
    """Direction (3,) from the arm to the mover."""
    escape: float
    """Greatest speed at which all joints together take the place that is touched from the mover
    [m/s], closing none of the gaps to other movers that these could bring below the promise before
    the arm does anything about it. 0 for a link that turns about its own axis, or does not move at
    all, or that two movers have between them."""


class Reach(NamedTuple):
    """What an arm could do about a mover since it was told of it."""

    deep_m: float
    """How deep the mover would be in the arm if that stood where it was then [m]."""
    away_m: float
    """By how much, from there, all joints take what is deepest away from it at most [m]."""


class Chase:
    """Moves what moves in a run: `run` once a tick, `step` in every physics step."""

    def __init__(
        self,
        cell: Cell,
        movers: tuple[RandomMover, ...],
        simulation: Simulation,
        stands_s: float = 0.0,
    ) -> None:
        """Build it; until `stands_s` the arm stands, whatever comes (`avoidance.standing`) [s]."""
        self._movers, self._simulation, self._stands_s = movers, simulation, stands_s
        self._period_s, self._step_s = cell.config.timing.period_s, simulation.rig.dt
        world = simulation.rig.world
        model, self._data, self._model = world.model, world.data, world.model
        joints = [model.joint(j.name) for j in cell.robot.joints]
        self._links = [int(joint.bodyid[0]) for joint in joints]
        self._dofs = [int(joint.dofadr[0]) for joint in joints]
        self._world, drives = world, cell.config.mechanism.drives
        self._fastest = np.array([d.max_velocity for d in drives])
        self._quickest = np.array([d.max_acceleration for d in drives])
        root = model.body_rootid[self._links[0]]
        own = (model.body_rootid[model.geom_bodyid] == root) & (model.geom_contype > 0)
        self._arm = np.flatnonzero(own)
        bodies = {m.obstacle.name: model.body(f"obstacle_{m.obstacle.name}") for m in movers}
        self._geom = {name: int(body.geomadr[0]) for name, body in bodies.items()}
        self._place = {
            name: self._data.mocap_pos[int(body.mocapid[0])] for name, body in bodies.items()
        }
        self._velocity: dict[str, Vector] = {}
        self._told_s: dict[str, float] = {}
        self._since_s: dict[str, float] = {}
        self._since: dict[str, tuple[Vector, Vector]] = {}
        """Joint angles and rates (n,) [rad, rad/s] when a mover was first told of to an arm that
        was to move."""
        self._silent: set[str] = set()
        self._aimed_s: dict[str, float] = {}
        self.touching: dict[str, Touch] = {}
        """The movers that are at the arm."""

    def step(self) -> None:
        """Move on by a physics step, as far as the arm leaves room."""
        mujoco.mj_kinematics(self._model, self._data)
        self.touching = {}
        for name, place in self._place.items():
            way = self._velocity.get(name, np.zeros(3)) * self._step_s
            touch = self._met(name, way)
            if touch is not None:
                self.touching[name] = touch
            if touch is None or float(way @ touch.away) > 0.0:
                place[:] += way

    def run(self, at_s: float) -> None:
        """Take aim and tell, at a time of the script [s]."""
        for m in self._movers:
            name, act = m.obstacle.name, [a for a in m.acts if a.at_s <= at_s][-1]
            if act.does == "silent" and name in self._velocity:
                self._silent.add(name)
                continue
            if name in self._silent or name not in self._since_s:
                self._told_s.pop(name, None)
            if name in self._silent or name not in self._since_s or at_s < self._stands_s:
                self._since_s[name] = at_s
                self._since[name] = self._world.q.copy(), self._world.dq.copy()
            wanted = self._velocity.get(name, np.zeros(3))
            if m.obstacle.max_acceleration is not None or self._due(name, at_s):
                wanted = self._wanted(m.obstacle, act)
            self._go(m.obstacle, wanted)
        self.tell()

    def told_for(self, name: str, at_s: float) -> float:
        """Return how long a mover has been told of to an arm that was to move [s]; 0: is not."""
        return 0.0 if name in self._silent else at_s - self._since_s.get(name, at_s)

    def reach(self, name: str, at_s: float) -> Reach:
        """Return what the arm could do about a mover since it was told of it and was to move.

        Each joint turns at most as it may be accelerated from the rate that it had, and no faster
        than it may go. News acts `ACTS_AFTER` periods later. The mover goes on as it does now
        until it takes aim again, or acts otherwise; the moment that leaves the least counts.
        """
        told_s, velocity = self.told_for(name, at_s), self._velocity[name]
        now, place, (q, dq) = self._world.q.copy(), self._place[name].copy(), self._since[name]
        acts = [a.at_s for m in self._movers if m.obstacle.name == name for a in m.acts]
        goes_on_s = min([EVERY_S, *(act_s - at_s for act_s in acts if act_s > at_s)])
        found = []
        for ahead_s in np.arange(0.0, goes_on_s, self._period_s):
            t = max(0.0, told_s + ahead_s - ACTS_AFTER * self._period_s)
            turned = np.minimum(self._fastest * t, np.abs(dq) * t + 0.5 * self._quickest * t * t)
            self._place[name][:] = place + ahead_s * velocity
            self._stand(q)
            found.append(self._away(name, turned))
        self._place[name][:] = place
        self._stand(now)
        return min(found, key=lambda reach: reach.away_m - reach.deep_m)

    def _away(self, name: str, turned: Vector) -> Reach:
        """Return how deep a mover is in the arm, and how far joints that turn lead that away.

        By `turned` (n,) [rad] at most, the place that is deepest moves along the way to the
        mover's middle, and across, by its Jacobian and that one's change; what is nearest to the
        middle then is no farther than that place.
        """
        found = min(self._gaps(name, 0.0), key=lambda each: each[0], default=None)
        if found is None:
            return Reach(0.0, 0.0)
        gap, geom, at = found
        way = self._place[name] - at
        far = max(float(np.linalg.norm(way)), 1e-9)
        J = self._jacobian(int(self._model.geom_bodyid[geom]), at)
        levers = np.linalg.norm(J, axis=0) * turned
        change = float(levers @ (np.cumsum(turned) - 0.5 * turned))
        along, moved = float(np.abs(way / far @ J) @ turned) + change, float(levers.sum())
        return Reach(-gap, min(moved, math.hypot(far + along, moved) - far))

    def _stand(self, q: Vector) -> None:
        self._world.q[:] = q
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)

    def end(self, touching: str = "", away: Vector | None = None) -> None:
        """Let all movers stand, but for one that backs `away` (3,), length 1."""
        for m in self._movers:
            speed = FASTEST * m.obstacle.max_speed if m.obstacle.name == touching else 0.0
            self._go(m.obstacle, np.zeros(3) if away is None else speed * away)
        self.tell()

    def _met(self, mover: str, way: Vector) -> Touch | None:
        """Return where a mover meets the arm, if it does on a way (3,) [m]."""
        far, found = float(np.linalg.norm(way)), None
        for gap, geom, at in self._gaps(mover, far):
            away = self._towards(mover, at)
            if gap <= max(0.0, -float(way @ away)):
                found = Touch(away, self._escape(mover, self._retreat(geom, at, away)))
        return found

    def _gaps(self, mover: str, within: float) -> Iterator[tuple[float, int, Vector]]:
        """Yield gap [m], geom, and nearest place on it (3,) of what of the arm is near a mover."""
        ball, place = self._geom[mover], self._place[mover]
        reach = within + self._model.geom_rbound[ball] + self._model.geom_rbound[self._arm]
        apart = np.linalg.norm(self._data.geom_xpos[self._arm] - place, axis=1)
        for geom in self._arm[apart <= reach].tolist():
            fromto = np.zeros(6)
            gap = mujoco.mj_geomDistance(self._model, self._data, geom, ball, 0.1, fromto)
            if gap <= within:
                yield gap, geom, fromto[:3]

    def _towards(self, mover: str, at: Vector) -> Vector:
        """Return the direction (3,) from a place on the arm to a mover."""
        way = self._place[mover] - at
        return np.asarray(way / max(float(np.linalg.norm(way)), 1e-9))

    def _retreat(self, geom: int, at: Vector, away: Vector) -> Vector:
        """Return how a place (3,) on the arm leaves what is `away` (3,) with the joints (n,)."""
        return -away @ self._jacobian(int(self._model.geom_bodyid[geom]), at)

    def _escape(self, mover: str, retreat: Vector) -> float:
        """Return the greatest speed of a retreat (n,) that closes in on no other mover [m/s]."""
        beside = []
        for m in self._movers:
            if (other := m.obstacle.name) == mover:
                continue
            within = PROMISE + m.obstacle.max_speed * (NEWS_EVERY_S + ACTS_AFTER * self._period_s)
            for _, geom, at in self._gaps(other, within):
                beside.append(self._retreat(geom, at, self._towards(other, at)))
        return greatest_beside(retreat, np.array(beside).reshape(-1, len(retreat)), self._fastest)

    def _jacobian(self, body: int, at: Vector) -> Vector:
        """Return how a place (3,) on a body moves with the joints (3, n)."""
        J = np.zeros((3, self._model.nv))
        mujoco.mj_jac(self._model, self._data, J, None, at, body)
        return J[:, self._dofs]

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
        link = self._links[round(act.part * (len(self._links) - 1))]
        way = self._data.xpos[link] - self._place[obstacle.name]
        return np.asarray(speed * way / max(float(np.linalg.norm(way)), 1e-9))

    def _go(self, obstacle: ObstacleSection, wanted: Vector) -> None:
        """Bring one nearer to a velocity (3,); one that was silent is told of again."""
        name = obstacle.name
        before = self._velocity.get(name, np.zeros(3))
        touch = self.touching.get(name)
        if touch is not None and float(wanted @ touch.away) <= 0.0:
            after = np.zeros(3)
        else:
            after = wanted
            if obstacle.max_acceleration is not None:
                most = FASTEST * obstacle.max_acceleration * self._period_s
                size = max(float(np.linalg.norm(wanted - before)), 1e-12)
                after = before + (wanted - before) * min(1.0, most / size)
        self._silent.discard(name)
        if not np.array_equal(after, before):
            self._told_s.pop(name, None)
        self._velocity[name] = after

    def tell(self) -> None:
        """Tell of all that are told of and go another way, or were not told of for a while."""
        now_s, tick = self._simulation.clock.time_s, self._simulation.cycle.tick
        for name, velocity in self._velocity.items():
            due_s = self._told_s.get(name, -1.0) + NEWS_EVERY_S
            if name in self._silent or now_s < due_s - 1e-9:
                continue
            self._told_s[name] = now_s
            (x, y, z), (vx, vy, vz) = self._place[name].tolist(), velocity.tolist()
            news = ObstacleNews(name=name, tick=tick, xyz=(x, y, z), velocity=(vx, vy, vz))
            self._simulation.link.put(t.OBSTACLE, encode(news))
