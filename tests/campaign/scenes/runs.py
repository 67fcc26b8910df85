"""Part `scenes`: clearances among random obstacles, judged by the physics every millisecond."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np
from laboratory.oracle.way_out import AWAY, WIDER, closed_in
from telerobot.config.load import load_cell
from telerobot.drivers.rig.physics.clearance import TrueNearest
from telerobot.protocols import topics as t
from telerobot.tools.simulation.simulation import Simulation

from ..part import Part, Selection
from .clutter import HOSTILE_S, Clutter, make_clutter
from .movers import PROMISE, Chase, Reach

CELL = "pa10"
DEEPER = 0.001
"""A start inside the promise gets no deeper than by this: what joints give way by [m]."""
CLOSING = 0.006
"""Below the promise, own motion closes a gap to what moves by no more than this [m]: what has come
into the capsules around links, which are more than the links, is kept from these."""
SLOW = 0.2
"""A mover that is told of, and no faster, is given way to: it does not hit the arm [m/s]. An arm
steps aside for no more where it stands; none is asked to where its joints are slower there."""
PAUSE_S = 0.3
"""Between the hostile part and the retreat [s]."""
RETREAT = 0.15
"""Speed of the retreat [m/s]."""
RETREAT_S = 4.0
"""And for how long at most: between two things the way out is slow [s]."""
ASIDE = np.vstack([np.eye(3), -np.eye(3)])
"""Straight ways that an operator tries next, where away from what is nearest is towards another."""
ONWARD_S = 0.3
"""It goes on for so long when it has left [s]."""
RESUME_S = 0.2
"""An operator whose arm holds asks so often to resume [s]."""
FREE = 0.002
"""Distance by which an obstacle in contact backs off before the arm is to leave [m]."""
STOPPED_SHARE = 0.01
"""The stored stop takes over in less than this part of all ticks [1]."""


class Hit(NamedTuple):
    """A mover that came to the arm."""

    mover: str
    at_s: float
    speed: float
    """Its greatest speed [m/s]."""
    told_s: float
    """It had been told of, to an arm that was to move, for so long; 0: nobody did [s]."""
    escape: float
    """Greatest speed at which the joints take what was hit from it, towards no other [m/s]."""
    reach: Reach
    """What the arm could do about it since it was told."""
    held: bool = False
    """Another one had touched the arm, which was in HOLD by that: there this cell's stands
    (`standing_in_hold`)."""

    @property
    def why_not(self) -> str:
        """Reason why no law is asked to avoid it; empty where the arm was to step aside."""
        if not self.told_s:
            return "nobody tells of it"
        if self.held:
            return "another had touched the arm: in HOLD by that it steps aside for nobody"
        if self.reach.away_m < self.reach.deep_m:
            return (
                f"in the {self.told_s:.2f} s that it was told of to an arm that was to move, the "
                f"joints get out of its way by {1e3 * self.reach.away_m:.1f} mm at most, of "
                f"{1e3 * self.reach.deep_m:.1f} mm"
            )
        if self.escape <= self.speed:
            return (
                f"the joints take that place away, towards no other mover, at {self.escape:.2f} "
                "m/s at most"
            )
        return f"it is quicker than {SLOW:g} m/s" * (self.speed > SLOW)

    @property
    def words(self) -> str:
        """When it came, and how fast."""
        return (
            f"hit at {self.at_s:.2f} s by {self.mover}, which comes at up to {self.speed:.2f} m/s"
        )


@dataclass(frozen=True)
class SceneRun:
    """The figures of one run; all plain values."""

    seed: int
    kind: str
    keepable: bool
    start_m: float
    held_m: float
    """Clearance once the drives hold the arm, which sags a little, or as the daemon sees it at the
    start, whichever is less [m]."""
    least_m: float
    """Least clearance of the physics, after the drives hold [m]."""
    closed_m: float
    """Most that own motion closed a gap below the promise to something that moves [m]."""
    hits: tuple[Hit, ...]
    """Movers that came to the arm."""
    ways: int
    """Straight retreats that were tried; 1: away from what was nearest was a way out."""
    left: bool
    """The tool has gone by `AWAY` along a way, or the least gap is wider by `WIDER`."""
    closed: bool
    """It did not leave, and a search of its own finds no way out (`way_out.py`)."""
    ticks: int
    stopped_ticks: int
    """The stored stop took over, unasked: the arm was not told to stop or hold [1]."""
    limited_ticks: int
    limit_violations: int
    failure: str

    @property
    def name(self) -> str:
        """Kind and seed, and whether the arm is closed in."""
        hit = any(hit.why_not for hit in self.hits)
        return f"scene {self.kind} seed {self.seed}" + ", closed in" * self.closed + ", hit" * hit

    @property
    def reasons(self) -> list[str]:
        """Broken promises of the run."""
        found = []
        if self.failure:
            found.append(self.failure)
        if self.limit_violations:
            found.append(f"{self.limit_violations} limit violations")
        if self.keepable and self.least_m < PROMISE:
            found.append(f"clearance {1e3 * self.least_m:.2f} mm, promised {1e3 * PROMISE:.0f}")
        if self.kind == "inside" and self.least_m < self.held_m - DEEPER:
            found.append(f"deeper inside: {1e3 * self.least_m:.2f} mm from {1e3 * self.held_m:.2f}")
        if self.closed_m > CLOSING:
            found.append(f"own motion closed a gap by {1e3 * self.closed_m:.2f} mm")
        found += [f"{hit.words} and was told of" for hit in self.hits if not hit.why_not]
        if not (self.left or self.closed):
            found.append("did not leave on a retreat")
        return found


class _Judge:
    """Watches the physics of one run, and plays its retreat."""

    def __init__(self, scene: Clutter, simulation: Simulation) -> None:
        self.simulation = simulation
        self.first = self.least = self.closed = 0.0
        self.left = self.stuck = False
        self.ways = 0
        self.postures: list[np.ndarray] = []
        """Postures (n,) [rad] at the beginning and end of a retreat that failed."""
        self._movers = {f"obstacle_{m.obstacle.name}": m.obstacle.max_speed for m in scene.movers}
        self.hits: dict[str, Hit] = {}
        self._before = simulation.rig.world.q.copy()
        self._closing = 0.0
        stands = scene.cell.config.avoidance.standing == "stand"
        led_s = scene.script.step[0].at_s if stands else 0.0
        self._chase = Chase(scene.cell, scene.movers, simulation, led_s)
        self._retreat: tuple[np.ndarray, np.ndarray, float] | None = None
        self._until_s = math.inf
        self.over = False
        """True when the retreat is."""
        self._asked_s = 0.0
        self._judging = False
        simulation.on_physics = self._on_physics
        simulation.on_tick = self._on_tick

    def _on_physics(self, simulation: Simulation) -> None:
        world = simulation.rig.world
        if simulation.player.phase.name != "PLAYING":
            self._before[:] = world.q
            return
        near = world.distances.nearest()
        if near is None:
            return
        if not self._judging:
            self._judging, self.first, self.least = True, near.distance, near.distance
        self.least = min(self.least, near.distance)
        if 0.0 < near.distance < PROMISE and near.other in self._movers:
            now = world.q.copy()
            world.q[:] = self._before
            before = world.distances.nearest()
            world.q[:] = now
            self._closing += 0.0 if before is None else before.distance - near.distance
            self._closing = max(0.0, self._closing)
            self.closed = max(self.closed, self._closing)
        else:
            self._closing = 0.0
        self._before[:] = world.q
        self._chase.step()
        if (at_s := self._at_s) < HOSTILE_S:
            for name, touch in self._chase.touching.items():
                if name in self.hits:
                    continue
                speed, told_s = self._movers[f"obstacle_{name}"], self._chase.told_for(name, at_s)
                reach = self._chase.reach(name, at_s)
                held = bool(self.hits) and simulation.states[-1].mode == "hold"
                self.hits[name] = Hit(name, at_s, speed, told_s, touch.escape, reach, held)

    @property
    def _at_s(self) -> float:
        """Time of the script [s]."""
        return self.simulation.clock.time_s - self.simulation.player.start_s

    def _on_tick(self, simulation: Simulation) -> None:
        if simulation.player.phase.name != "PLAYING":
            return
        holds = bool(simulation.states) and simulation.states[-1].mode == "hold"
        if holds and self._at_s > self._asked_s + RESUME_S:
            self._asked_s = self._at_s
            simulation.player.client.request(t.MODE, lambda _: None, action="resume")
        near = simulation.rig.world.distances.nearest()
        if near is None:
            raise ValueError("a scene has something in it")
        touches = near.distance < FREE and near.other in self._movers
        touching = near.other.removeprefix("obstacle_") if touches else ""
        if self._at_s < HOSTILE_S:
            self._chase.run(self._at_s)
            return
        if self._retreat is not None:
            self._watch(near)
            if self.left or self._at_s < self._until_s:
                self._chase.tell()
                return
        way = _away(near)
        self._chase.end(touching, -way)
        moves = simulation.states[-1].mode == "enabled"
        if self._at_s > HOSTILE_S + PAUSE_S and moves and not touches:
            self._try(way, near)

    def _try(self, away: np.ndarray, near: TrueNearest) -> None:
        """Ask for the next straight retreat, if there is one."""
        # The rest by how much they lead away, too; straight into what is nearest is no retreat.
        ways = [away, *sorted(ASIDE, key=lambda way: -float(way @ away))[:-1]]
        simulation = self.simulation
        if self.ways in (0, len(ways)):
            self.postures.append(simulation.rig.world.q.copy())
        if self.ways == len(ways):
            self.over = self.stuck = True
            return
        way = ways[self.ways]
        self.ways += 1
        self._retreat = (simulation.rig.world.mrf_pose()[0], way, near.distance)
        self._until_s = self._at_s + RETREAT_S
        twist = (*(RETREAT * way).tolist(), 0.0, 0.0, 0.0)
        simulation.player.client.stream(t.JOYSTICK, twist=twist, expressed_in="world")

    def _watch(self, near: TrueNearest) -> None:
        """Look whether the arm has left what it was nearest to."""
        if self.left:
            self.over = self._at_s >= self._until_s
        elif self._retreat is not None:
            start, way, gap = self._retreat
            gone = float(way @ (self.simulation.rig.world.mrf_pose()[0] - start))
            if gone > AWAY or near.distance > gap + WIDER:
                self.left, self._until_s = True, self._at_s + ONWARD_S


def _away(near: TrueNearest) -> np.ndarray:
    """Return the direction (3,) that leads away from what is nearest."""
    way = near.on_arm - near.on_other
    return np.asarray(way * np.sign(near.distance) / max(float(np.linalg.norm(way)), 1e-9))


def play(seed: int) -> SceneRun:
    """Run the scene of a seed in virtual time and judge it."""
    scene = make_clutter(load_cell(CELL), seed)
    simulation = Simulation(scene.cell, scene.script)
    judge = _Judge(scene, simulation)
    result = simulation.run(lambda: judge.over)
    errors = [e for e in simulation.events if e.severity == "error"]
    failure = str(result.summary["failure"] or "")
    if errors and not failure:
        failure = f"{errors[0].name}: {errors[0].detail}"
    return SceneRun(
        seed=seed,
        kind=scene.kind,
        keepable=scene.keepable,
        start_m=scene.start_m,
        held_m=min(judge.first, scene.modelled_m),
        least_m=judge.least,
        closed_m=judge.closed,
        hits=tuple(judge.hits.values()),
        ways=judge.ways,
        left=judge.left,
        closed=judge.stuck and closed_in(scene.cell, simulation.rig.world, judge.postures, PROMISE),
        ticks=len(result.states),
        stopped_ticks=sum(
            "verified_stop" in s.limits and s.mode == "enabled" for s in result.states
        ),
        limited_ticks=sum(any("clearance" in name for name in s.limits) for s in result.states),
        limit_violations=len(simulation.observer.violations),
        failure=failure,
    )


class SceneSummary:
    """Summary of all scenes."""

    def __init__(self, scenes: Sequence[SceneRun]) -> None:
        self.scenes = scenes
        self.ticks = sum(s.ticks for s in scenes)
        self.stopped_share = sum(s.stopped_ticks for s in scenes) / max(1, self.ticks)

    @property
    def kept(self) -> bool:
        """True when every scene kept what it promised, and the stored stop stayed the exception."""
        return not any(s.reasons for s in self.scenes) and self.stopped_share < STOPPED_SHARE

    def figures(self) -> dict[str, object]:
        """Return everything as plain values, for JSON."""
        keepable = [s.least_m for s in self.scenes if s.keepable]
        return {
            "scenes": len(self.scenes),
            "kept": self.kept,
            "keepable": len(keepable),
            "least_clearance_m": min(keepable, default=None),
            "promise_m": PROMISE,
            "did_not_leave": sum(not (s.left or s.closed) for s in self.scenes),
            "closed_in": sum(s.closed for s in self.scenes),
            "left_aside": sum(s.left and s.ways > 1 for s in self.scenes),
            "hits": sum(len(s.hits) for s in self.scenes),
            "hits_avoidable": sum(not hit.why_not for s in self.scenes for hit in s.hits),
            "scenes_hit": sum(bool(s.hits) for s in self.scenes),
            "most_closed_m": max((s.closed_m for s in self.scenes), default=0.0),
            "limit_violations": sum(s.limit_violations for s in self.scenes),
            "stopped_share": self.stopped_share,
            "limited_share": sum(s.limited_ticks for s in self.scenes) / max(1, self.ticks),
            "by_scene": [asdict(s) for s in self.scenes],
        }

    def lines(self) -> list[str]:
        """Return the report for people."""
        f = self.figures()
        kinds = {k: sum(s.kind == k for s in self.scenes) for k in ("free", "near", "inside")}
        least = f["least_clearance_m"]
        shown = {
            "scenes": f"{len(self.scenes)}, {self.ticks} ticks ("
            + ", ".join(f"{n} {k}" for k, n in kinds.items())
            + f", {len(self.scenes) - sum(kinds.values())} with things that move)",
            "keepable": f"{f['keepable']}, least clearance "
            + ("none" if least is None else f"{1e3 * float(str(least)):.2f} mm")
            + f", promised {1e3 * PROMISE:.0f} mm",
            "left on a retreat": f"all but {f['did_not_leave']}, must be all; "
            f"{f['left_aside']} not straight away from what was nearest, but aside",
            "closed in": f"{f['closed_in']} besides, from where a search finds no way out either",
            "hit by movers": f"{f['hits_avoidable']} times by what was told of, in time, and is no "
            f"quicker than {SLOW:g} m/s or the joints; must be 0",
            "hit all the same": f"{int(str(f['hits'])) - int(str(f['hits_avoidable']))} times, in "
            f"{f['scenes_hit']} scenes, which do not count as passed",
            "limit violations": f"{f['limit_violations']}, must be 0",
            "stored stop": f"{self.stopped_share:.3%} of ticks, below {STOPPED_SHARE:.0%}",
            "barriers active": f"{f['limited_share']:.1%} of ticks",
        }
        lines = [f"{name:20} {text}" for name, text in shown.items()]
        for s in self.scenes:
            again = f"python -m laboratory.campaign --only=scenes --seeds {s.seed}:{s.seed + 1}"
            told = [f"{hit.words}: {hit.why_not}" for hit in s.hits if hit.why_not]
            lines += [f"{again}  # {why}" for why in s.reasons + told + ["closed in"] * s.closed]
        lines.append("all promises kept" if self.kept else "a promise is broken")
        return lines


def _jobs(selection: Selection) -> list[int]:
    load_cell(CELL)
    return list(selection.seeds)


SCENES = Part(_jobs, play, SceneSummary)
