"""Obstacle map: obstacles of the cell and of messages, the age of their news, and their events.

News says where an obstacle was in a telemetry tick; from there its age counts, whatever the way
took. Between news an obstacle is somewhere within its bounds, which `scene.py` states.

An obstacle belongs to its first sender until that one removes it. News of it by anybody else is
refused, and makes it stale until its own sender tells of it again. So does news that is refused for
another reason, except for coming out of order: then newer news is in force.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from ...config.load import Cell
from ...config.schema.surroundings import CameraSection, ObstacleSection, Shape, Stale
from ...protocols.messages.perception import ObstacleNews
from ..control.compiled import evolve
from ..control.scene import UNBOUNDED, Boxes, Rounds, Scene
from ..control.spatial import Array, rotation_rpy
from ..events import Events
from ..refusals import Refused, Why

MOST = 64
"""Most obstacles that are known at a time [1]."""

JUMP_SLACK = 0.01
"""News may contradict the bound of speed by so much: the noise of whoever saw it [m]."""

MOVES = (0.02, 0.01)
"""What was seen to stand moves from this speed on, and stands again below the other [m/s]."""

FADE_S = 0.2
"""An arm makes way for what begins to move, and stops to for what stops, within this [s]."""

SMOOTH_S = (0.2, 0.5)
"""Time constants of an observed velocity that rises: told by the news, or by two places [s]."""

FALL_S = (0.1, 0.2)
"""The same of one that falls [s]."""

_ZERO = (0.0, 0.0, 0.0)
Vector = tuple[float, float, float]


@dataclass(frozen=True)
class TrackedObstacle:
    """State of an obstacle according to its newest news."""

    name: str
    shape: Shape
    xyz: Vector
    to: Vector
    radius: float
    rpy: Vector
    half_size: Vector
    velocity: Vector
    max_speed: float
    max_acceleration: float | None
    timeout_s: float
    stale: Stale
    clearance: float
    hard: bool
    carrier: int
    """Place of the arm on whose Wrist a sight line's camera is; -1: it starts in World."""
    fixed: bool
    """True for one of the cell file that stands still."""
    owner: str | None
    """Who tells of it, by the name in the key; None for the cell's that nobody has told of yet."""
    tick: int
    """Telemetry tick of the newest news."""
    observed: Vector = _ZERO
    """Velocity that its news shows, smoothed [m/s]."""
    observed_moving: bool = False
    """It is seen to move, with a hysteresis."""
    observed_part: float = 0.0
    """Part of that motion that counted in the tick of the newest news, 0 to 1."""

    @property
    def moves(self) -> bool:
        """True for one that may move between two news."""
        return self.max_speed > 0.0


class ObstacleMap:
    """The obstacles that are known in a cell."""

    def __init__(
        self,
        obstacles: tuple[ObstacleSection, ...],
        cameras: Sequence[Sequence[CameraSection]],
        clearance: float,
        period_s: float,
        events: Events,
        certified: bool = False,
    ) -> None:
        """Begin with the obstacles of a cell; `clearance` [m] is promised where none is told.

        `cameras` are those of each arm.

        Where senders are certified, each has to tell under its own name.
        """
        self._events = events
        self._certified = certified
        self._period_s = period_s
        self._clearance = clearance
        self._cameras = {c.name: (arm, c) for arm, own in enumerate(cameras) for c in own}
        self._known = {o.name: self._of_cell(o) for o in obstacles}
        self._gone: dict[str, int] = {}
        self._stale: set[str] = set()
        self._doubts: dict[str, tuple[int, str]] = {}
        """By name: the tick since when an obstacle is doubted, and why in words."""
        self._still: Scene | None = None
        self._table: _Table | None = None
        """None where news came since it was made."""
        self._changed: dict[str, None] = {}
        """Names of those whose news was taken since `told` was last asked, the oldest first."""

    @classmethod
    def from_cell(cls, cell: Cell, events: Events) -> Self:
        """Return the map of a loaded cell."""
        c = cell.config
        certified = c.zenoh.security.directory is not None
        clearance, period_s = c.avoidance.clearance, c.timing.period_s
        cameras = [part.config.cameras for part in cell.parts]
        return cls(c.obstacles, cameras, clearance, period_s, events, certified)

    @property
    def known(self) -> tuple[TrackedObstacle, ...]:
        """The obstacles, in no particular order."""
        return tuple(self._known.values())

    @property
    def lines(self) -> bool:
        """True if any of them is a sight line."""
        return any(known.shape == "sight_line" for known in self._known.values())

    @property
    def stale(self) -> tuple[str, ...]:
        """Names of those whose news is stale."""
        return tuple(sorted(self._stale))

    @property
    def stop(self) -> str | None:
        """Name of an obstacle whose stale news calls for the verified stop, None without one."""
        return next((name for name in self.stale if self._known[name].stale == "stop"), None)

    # --- news --------------------------------------------------------------------------------

    def take(self, news: ObstacleNews, tick: int, sender: str = "") -> None:
        """Take in what a sender told of an obstacle. Raises `Refused` where it does not fit."""
        before = self._known.get(news.name)
        if self._certified and not sender:
            self.doubt(news.name, tick, "told of by nobody by name")
            raise Refused(Why.UNNAMED_SENDER, f"{news.name}: put on sensor/obstacle/YOUR_NAME")
        if before is not None and before.fixed:
            raise Refused(Why.FIXED_OBSTACLE, f"{news.name} stands in the cell file")
        if before is not None and before.owner not in (None, sender):
            what = "removed" if news.remove else "told of"
            self.doubt(news.name, tick, f"{what} by {_named(sender)} too")
            whose = f"{_named(before.owner)} tells of {news.name}, not {_named(sender)}"
            raise Refused(Why.ANOTHERS_OBSTACLE, whose)
        newest = self._gone.get(news.name, -1) if before is None else before.tick
        if news.tick > tick:
            self.doubt(news.name, tick, f"told of for tick {news.tick}, this is tick {tick}")
            raise Refused(Why.FUTURE_PICTURE, f"tick {news.tick}, this is tick {tick}")
        if news.tick < newest:
            raise Refused(Why.OUT_OF_ORDER, f"{news.name}: tick {news.tick} after {newest}")
        if news.remove:
            self._remove(news, before)
            return
        if news.shape is not None:
            after = self._created(news, sender)
        else:
            after = self._moved(news, before, sender)
        if before is not None:
            after = self._observed(before, after, news.velocity is not None)
        if before is None:
            self._events.info("obstacle_set", news.name, shape=after.shape)
        elif news.shape is None:
            self._check_speed(before, after)
        self._known[news.name] = after
        self._note(news.name)
        if news.name in self._doubts and news.tick > self._doubts[news.name][0]:
            del self._doubts[news.name]
        self._still = self._table = None

    def doubt(self, name: str, tick: int, why: str) -> None:
        """Count an obstacle as stale until its own sender tells of it again.

        `why` news of it was not taken in words. What stands in the cell file is beyond doubt.
        """
        known = self._known.get(name)
        if known is not None and not known.fixed:
            self._doubts[name] = tick, why

    def update(self, tick: int) -> None:
        """Update which news is stale, and report each change as an event."""
        for known in self._known.values():
            age = self._age(known, tick)
            doubt = self._doubts.get(known.name)
            is_stale = doubt is not None or (known.moves and age > known.timeout_s)
            if is_stale and known.name not in self._stale:
                self._stale.add(known.name)
                self._still = None
                why = f"no news for {age:.2f} s" if doubt is None else doubt[1]
                self._events.warning(
                    "obstacle_stale",
                    f"{known.name}: {why}: {known.stale}",
                    obstacle=known.name,
                    policy=known.stale,
                )
            elif not is_stale and known.name in self._stale:
                self._stale.discard(known.name)
                self._still = None
                self._events.info("obstacle_fresh", known.name)

    def told(self, tick: int) -> Iterator[ObstacleNews]:
        """Yield, as they are held, obstacles that were taken news of since the last call.

        And in each tick one of all that any sender told of, in turn, for who began to listen later.
        """
        every = [known.name for known in self._known.values() if known.owner is not None]
        every += [name for name in self._gone if name not in self._known]
        changed, self._changed = self._changed, {}
        if every:
            changed[every[tick % len(every)]] = None
        for name in changed:
            known = self._known.get(name)
            if known is not None:
                yield _whole(known)
            elif name in self._gone:
                yield ObstacleNews(name=name, tick=self._gone[name], remove=True)

    def _note(self, name: str) -> None:
        """Let it be told soon; more than there may be are told in turn."""
        if len(self._changed) < MOST:
            self._changed[name] = None

    def _created(self, news: ObstacleNews, sender: str) -> TrackedObstacle:
        if len(self._known) >= MOST and news.name not in self._known:
            raise Refused(Why.TOO_MANY_OBSTACLES, f"{MOST} are known already")
        shape = news.shape or "point"
        xyz = news.xyz or _ZERO
        return TrackedObstacle(
            name=news.name,
            shape=shape,
            xyz=xyz,
            to=news.to or xyz,
            radius=news.radius or 0.0,
            rpy=news.rpy or _ZERO,
            half_size=news.half_size or _ZERO,
            velocity=news.velocity or _ZERO,
            max_speed=news.max_speed or 0.0,
            max_acceleration=news.max_acceleration,
            timeout_s=0.25 if news.timeout_s is None else news.timeout_s,
            stale=news.stale or "stop",
            clearance=self._clearance if news.clearance is None else news.clearance,
            hard=shape != "sight_line" if news.hard is None else news.hard,
            carrier=-1,
            fixed=False,
            owner=sender,
            tick=news.tick,
        )

    def _moved(
        self, news: ObstacleNews, before: TrackedObstacle | None, sender: str
    ) -> TrackedObstacle:
        if before is None:
            raise Refused(Why.UNKNOWN_OBSTACLE, f"{news.name} is not known: give its shape")
        told = {key: value for key in _CHANGEABLE if (value := getattr(news, key)) is not None}
        if news.xyz is not None:
            # What is moved as a whole keeps its length; a velocity that is not told is unknown.
            told.setdefault("velocity", _ZERO)
            if news.to is None and before.shape == "capsule":
                way = np.subtract(news.xyz, before.xyz) + np.array(before.to)
                told["to"] = tuple(way.tolist())
            elif before.shape in ("point", "sphere"):
                told["to"] = news.xyz
            told["carrier"] = -1
        return replace(before, tick=news.tick, owner=sender, **told)

    def _remove(self, news: ObstacleNews, before: TrackedObstacle | None) -> None:
        if before is None:
            raise Refused(Why.UNKNOWN_OBSTACLE, f"{news.name} is not known")
        del self._known[news.name]
        self._stale.discard(news.name)
        self._doubts.pop(news.name, None)
        if len(self._gone) >= 4 * MOST:
            del self._gone[next(iter(self._gone))]
        self._gone[news.name] = news.tick
        self._still = self._table = None
        self._note(news.name)
        self._events.info("obstacle_removed", news.name)

    def _check_speed(self, before: TrackedObstacle, after: TrackedObstacle) -> None:
        """Warn of one that moved further than its own bound lets it: no promise holds for it."""
        way = float(np.linalg.norm(np.subtract(after.xyz, before.xyz)))
        way = max(way, float(np.linalg.norm(np.subtract(after.to, before.to))))
        since = (after.tick - before.tick) * self._period_s
        if way > max(before.max_speed, after.max_speed) * since + JUMP_SLACK:
            self._events.warning(
                "obstacle_jumped",
                f"{after.name}: {way:.3f} m in {since:.2f} s, faster than {after.max_speed:g} m/s",
                obstacle=after.name,
                distance_m=way,
            )

    def _observed(
        self, before: TrackedObstacle, after: TrackedObstacle, is_told: bool
    ) -> TrackedObstacle:
        """Return an obstacle with the velocity that its news shows: told, or by two places.

        Sensors are noisy: it is smoothed, counts from a least speed on, and fades in and out.
        """
        was, since = np.array(before.observed), (after.tick - before.tick) * self._period_s
        moving, part = before.observed_moving, self._part(before, after.tick)
        if since <= 0.0 or not after.moves:
            return replace(
                after, observed=before.observed, observed_moving=moving, observed_part=part
            )
        if is_told:
            newest = np.array(after.velocity)
        else:
            ways = np.subtract(after.xyz, before.xyz), np.subtract(after.to, before.to)
            newest = max(ways, key=lambda way: float(way @ way)) / since
        most = max(after.max_speed, float(np.linalg.norm(after.velocity)))
        newest = newest * min(1.0, most / max(float(np.linalg.norm(newest)), 1e-12))
        rises = float(newest @ newest) > float(was @ was)
        smooth_s = (SMOOTH_S if rises else FALL_S)[0 if is_told else 1]
        now = was + since / (smooth_s + since) * (newest - was)
        speed = float(np.linalg.norm(now))
        moving = speed > (MOVES[1] if moving else MOVES[0])
        if is_told and float(np.linalg.norm(newest)) < MOVES[1]:
            moving = False
        x, y, z = now.tolist()
        return replace(after, observed=(x, y, z), observed_moving=moving, observed_part=part)

    def _part(self, known: TrackedObstacle, tick: int) -> float:
        """Return what part of its observed motion counts in a tick (0 to 1)."""
        age = self._age(known, tick)
        way = age / FADE_S if known.observed_moving else -age / FADE_S
        fresh = 1.0 - max(0.0, age - known.timeout_s) / FADE_S
        return min(1.0, max(0.0, min(known.observed_part + way, fresh)))

    # --- the scene ---------------------------------------------------------------------------

    def scene(self, tick: int) -> Scene:
        """Return what is known now, each obstacle where it is predicted to be."""
        if self._still is not None:
            return self._still
        if self._table is None:
            self._table = _Table(self._known.values(), self._period_s)
        scene = self._table.scene(tick, self.stop)
        if not scene.moves:
            self._still = scene
        return scene

    def _age(self, known: TrackedObstacle, tick: int) -> float:
        return max(0, tick - known.tick) * self._period_s

    def _of_cell(self, obstacle: ObstacleSection) -> TrackedObstacle:
        xyz = obstacle.xyz or _ZERO
        carrier = -1
        if obstacle.camera is not None:
            arm, camera = self._cameras[obstacle.camera]
            carrier, xyz = arm if camera.on == "wrist" else -1, camera.place.xyz
        return TrackedObstacle(
            name=obstacle.name,
            shape=obstacle.shape,
            xyz=xyz,
            to=obstacle.to or xyz,
            radius=obstacle.radius or 0.0,
            rpy=obstacle.rpy,
            half_size=obstacle.half_size or _ZERO,
            velocity=_ZERO,
            max_speed=obstacle.max_speed,
            max_acceleration=obstacle.max_acceleration,
            timeout_s=obstacle.timeout_s,
            stale=obstacle.stale,
            clearance=self._clearance if obstacle.clearance is None else obstacle.clearance,
            hard=obstacle.shape != "sight_line" if obstacle.hard is None else obstacle.hard,
            carrier=carrier,
            fixed=obstacle.max_speed == 0.0,
            owner=None,
            tick=0,
        )


class _Table:
    """All obstacles as arrays: what of a scene their news alone changes, and how the rest ages."""

    def __init__(self, known: Iterable[TrackedObstacle], period_s: float) -> None:
        every = sorted(known, key=lambda known: known.shape == "box")
        rounds = [k for k in every if k.shape != "box"]
        boxes = every[len(rounds) :]
        velocity = _rows(k.velocity for k in every)
        moves = np.array([k.moves for k in every], dtype=bool)
        believed = np.array([k.max_acceleration is not None for k in every], dtype=bool) & moves
        # Off its prediction an obstacle is at most as fast as both together.
        speed = np.array([k.max_speed for k in every], dtype=float)
        speed = speed + believed * np.sqrt((velocity**2).sum(axis=1))
        self._told = Scene(
            names=tuple(k.name for k in every),
            rounds=Rounds(
                start=_rows(k.xyz for k in rounds),
                end=_rows(k.to for k in rounds),
                radius=np.array([k.radius for k in rounds], dtype=float),
                line=np.array([k.shape == "sight_line" for k in rounds], dtype=bool),
                carrier=np.array([k.carrier for k in rounds], dtype=np.int64),
            ),
            boxes=Boxes(
                R=np.array([rotation_rpy(*k.rpy) for k in boxes]).reshape(-1, 3, 3),
                centre=_rows(k.xyz for k in boxes),
                half=_rows(k.half_size for k in boxes),
            ),
            hard=np.array([k.hard for k in every], dtype=bool),
            clearance=np.array([k.clearance for k in every], dtype=float),
            velocity=velocity * believed[:, None],
            speed=speed,
            acceleration=np.array(
                [UNBOUNDED if k.max_acceleration is None else k.max_acceleration for k in every],
                dtype=float,
            ),
            age=np.zeros(len(every)),
            still_after=np.array([k.timeout_s if k.stale == "keep" else np.inf for k in every]),
            observed=_rows(k.observed for k in every),
        )
        """At the instant of each one's news."""
        self._period_s, self._moves = period_s, moves
        self._tick = np.array([k.tick for k in every], dtype=np.int64)
        self._timeout_s = np.array([k.timeout_s for k in every], dtype=float)
        self._part = np.array([k.observed_part for k in every], dtype=float)
        self._fading = np.array([1.0 if k.observed_moving else -1.0 for k in every])

    def scene(self, tick: int, stop: str | None) -> Scene:
        """Return the scene of a tick."""
        told = self._told
        age = np.maximum(0, tick - self._tick) * self._period_s * self._moves
        way = told.velocity * np.minimum(age, told.still_after)[:, None]
        velocity = np.where((age > told.still_after)[:, None], 0.0, told.velocity)
        fresh = 1.0 - np.maximum(0.0, age - self._timeout_s) / FADE_S
        part = np.clip(np.minimum(self._part + self._fading * age / FADE_S, fresh), 0.0, 1.0)
        rounds, boxes, count = told.rounds, told.boxes, len(told.rounds.radius)
        shift = way[:count]
        return evolve(
            told,
            rounds=evolve(rounds, start=rounds.start + shift, end=rounds.end + shift),
            boxes=evolve(boxes, centre=boxes.centre + way[count:]),
            velocity=velocity,
            age=age,
            observed=told.observed * (part * self._moves)[:, None],
            stop=stop,
        )


_CHANGEABLE = (
    "xyz", "to", "rpy", "half_size", "radius", "velocity", "max_speed", "max_acceleration",
    "timeout_s", "stale", "clearance", "hard",
)  # fmt: skip


def _whole(known: TrackedObstacle) -> ObstacleNews:
    """Return news by which whoever knows the cell file knows an obstacle as it is held.

    The start of a sight line that an arm carries is its Lens, for which the message has no frame:
    it is told as one that only moves.
    """
    told: dict[str, Any] = dict.fromkeys(ObstacleNews.model_fields) | {"remove": False}
    told |= {key: getattr(known, key) for key in _TOLD}
    if known.carrier < 0:
        told |= {"shape": known.shape, "xyz": known.xyz}
    if known.shape in ("capsule", "sight_line"):
        told["to"] = known.to
    if known.shape == "box":
        told |= {"rpy": known.rpy, "half_size": known.half_size}
    return ObstacleNews.of_valid(**told)


_TOLD = (
    "name", "tick", "radius", "velocity", "max_speed", "max_acceleration", "timeout_s", "stale",
    "clearance", "hard",
)  # fmt: skip


def _named(sender: str | None) -> str:
    return sender or "a sender without a name"


def _rows(vectors: Iterable[Vector]) -> Array:
    """Return vectors as an array (k, 3), also when there are none."""
    return np.array(list(vectors), dtype=float).reshape(-1, 3)
