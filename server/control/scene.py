"""Obstacles at one instant, as arrays, and the frames of a cell as a small tree."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from .compiled import INDEX, MATRIX, NUMBER, ROW, TABLE, VECTOR, compiled, evolve
from .spatial import Array, Pose, cross

# --- Obstacles at one instant, as arrays: what the daemon knows to be around the arm --------------
#
# Two kinds are enough. A *round* is all points within a radius of a segment: a point, a sphere,
# a capsule, a sight line. A *box* has sides. Rounds come first wherever all obstacles are
# counted.
#
# What may move is known to be, `ahead` seconds from now, within `reach(ahead)` of where its
# velocity takes it.

Flags = NDArray[np.bool_]
Index = NDArray[np.int64]

UNBOUNDED = 1e9
"""Acceleration of what may have any [m/s²]: finite, so that no time at all leads nowhere."""


@dataclass(frozen=True)
class Rounds:
    """m segments with a radius each, in World [m]."""

    start: Array
    """(m, 3)."""
    end: Array
    """(m, 3)."""
    radius: Array
    """(m,)."""
    line: Flags
    """Which are sight lines (m,)."""
    carrier: Index
    """The place of the arm on whose Wrist a line's camera is (m,): its `start` is in that Wrist
    until placed; -1: in World."""


@dataclass(frozen=True)
class Boxes:
    """b boxes, in World [m]."""

    R: Array
    """Attitudes (b, 3, 3)."""
    centre: Array
    """(b, 3)."""
    half: Array
    """Half the sides (b, 3)."""


@dataclass(frozen=True)
class Scene:
    """All obstacles of one instant: k = m + b of them, rounds first."""

    names: tuple[str, ...]
    rounds: Rounds
    boxes: Boxes
    hard: Flags
    """Which keep a barrier (k,)."""
    clearance: Array
    """Promised distance of links from each (k,) [m]."""
    velocity: Array
    """Where each goes (k, 3) [m/s]; zero where that is not believed."""
    speed: Array
    """Bound of its speed away from there (k,) [m/s]; zero for what stands still."""
    acceleration: Array
    """Bound of the same (k,) [m/s²]; `UNBOUNDED` where there is none."""
    age: Array
    """Age of its news (k,) [s]; zero for what stands still."""
    still_after: Array
    """Age from which on it is taken to stand (k,) [s]; infinite for most."""
    observed: Array
    """Velocity that fresh news shows (k, 3) [m/s], smoothed; zero for what stands. No bound: it
    says from whom to make way, not who may come."""
    stop: str | None = None
    """Name of the obstacle whose stale news calls for the verified stop, if any."""

    @property
    def segments(self) -> tuple[Array, Array, Array, Array, Array]:
        """Shapes without radii, for kernels: `start`, `end`, then `R`, `centre`, `half`."""
        rounds, boxes = self.rounds, self.boxes
        return rounds.start, rounds.end, boxes.R, boxes.centre, boxes.half

    @property
    def solids(self) -> tuple[tuple[Array, Array, Array, Array, Array], Array, Flags]:
        """Shapes for kernels: `segments`, the radii of rounds, and which of them are lines."""
        return self.segments, self.rounds.radius, self.rounds.line

    @property
    def moves(self) -> bool:
        """True if anything may move."""
        return bool(np.count_nonzero(self.speed))

    @property
    def comes(self) -> bool:
        """True if fresh news shows anything in motion."""
        return bool(np.count_nonzero(self.observed))

    def reach(self, ahead: float) -> Array:
        """Return how far each may be from where it is predicted (k,) [m], `ahead` [s] from now."""
        return _reach(self.speed, self.acceleration, self.age, self.still_after, ahead)

    def kept_clear(self, ahead: float) -> Array:
        """Return how near to each nothing may come (k,) [m], `ahead` [s] from now too."""
        clear = np.empty(len(self.speed))
        _keep_clear(
            self.clearance, self.speed, self.acceleration, self.age, self.still_after,
            self.velocity, ahead, clear,
        )  # fmt: skip
        return clear

    def growth(self, which: Index, ahead: Array) -> Array:
        """Return how much nearer obstacles `which` (p,) may be (s, p) [m], `ahead` (s,) from now.

        Nearer than where they are now, that is; zero for a negative index.
        """
        found = np.zeros((len(ahead), len(which)))
        _grow(
            self.speed, self.acceleration, self.age, self.still_after, self.velocity, which, ahead,
            found,
        )  # fmt: skip
        return found

    @property
    def carried(self) -> bool:
        """True if an arm carries the start of a sight line."""
        return bool((self.rounds.carrier >= 0).any())

    def placed(self, T_world_wrists: Sequence[Pose]) -> Self:
        """Return the scene with every sight line in World, by where the Wrists of all arms are."""
        start = self.rounds.start.copy()
        for arm, T in enumerate(T_world_wrists):
            own = self.rounds.carrier == arm
            start[own] = start[own] @ T.R.T + T.p
        return evolve(self, rounds=evolve(self.rounds, start=start))


def empty() -> Scene:
    """Return a scene with nothing in it."""
    none, no = np.zeros(0), np.zeros(0, dtype=bool)
    return Scene(
        names=(),
        rounds=Rounds(np.zeros((0, 3)), np.zeros((0, 3)), none, no, np.zeros(0, dtype=np.int64)),
        boxes=Boxes(np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3))),
        hard=no,
        clearance=none,
        velocity=np.zeros((0, 3)),
        speed=none,
        acceleration=none,
        age=none,
        still_after=none,
        observed=np.zeros((0, 3)),
    )


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, NUMBER)
def _reach(
    speed: Array, acceleration: Array, age: Array, still_after: Array, ahead: float
) -> Array:
    found = np.empty(len(speed))
    for k in range(len(speed)):
        since = min(age[k] + ahead, still_after[k])
        found[k] = min(speed[k], 0.5 * acceleration[k] * since) * since
    return found


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, MATRIX, NUMBER, ROW)
def _keep_clear(
    clearance: Array, speed: Array, acceleration: Array, age: Array, still_after: Array,
    velocity: Array, ahead: float, clear: Array,
) -> None:  # fmt: skip
    reach = _reach(speed, acceleration, age, still_after, ahead)
    for k in range(len(speed)):
        predicted2 = 0.0
        for axis in range(3):
            predicted2 += velocity[k, axis] * velocity[k, axis]
        clear[k] = clearance[k] + (reach[k] + math.sqrt(predicted2) * ahead)


@compiled(VECTOR, VECTOR, VECTOR, VECTOR, MATRIX, INDEX, VECTOR, TABLE)
def _grow(
    speed: Array, acceleration: Array, age: Array, still_after: Array, velocity: Array,
    which: Index, ahead: Array, found: Array,
) -> None:  # fmt: skip
    for s in range(len(ahead)):
        reach = _reach(speed, acceleration, age, still_after, ahead[s])
        for i in range(len(which)):
            k = which[i]
            if k >= 0:
                predicted2 = 0.0
                for axis in range(3):
                    predicted2 += velocity[k, axis] * velocity[k, axis]
                found[s, i] = reach[k] + math.sqrt(predicted2) * ahead[s]


# --- The frames of a cell as a small tree: where each is, and how it moves, seen from any other ---
#
# World ─┬─ Base ── Wrist ─┬─ MRF
#            │                 ├─ Sensor
#            │                 └─ Lens, of a carried camera
#            ├─ Carrier
#            └─ Lens, of a camera that stands in World (or on Base)
#
# The CRF is fixed to its *ground*: World, Base or Carrier. Base and Carrier may move; what
# their news says is in `Moved`. The one place that resolves a frame's name.

GROUNDS: Final = ("world", "base", "carrier")
"""Frames that the CRF may be fixed to, and that a goal may be measured against for good."""

FRAMES: Final = (*GROUNDS, "crf", "wrist", "mrf", "sensor", "lens")


class UnknownFrame(Exception):
    """A cell lacks the frame of that name; the text says which there are."""


class Body(NamedTuple):
    """Where a rigid thing is in World, and its twist (6,) at its origin in World axes."""

    T: Pose
    twist: Array

    @staticmethod
    def standing(T: Pose) -> "Body":
        """Return a thing that stands at T."""
        return Body(T, np.zeros(6))

    def twist_at(self, p: Array) -> Array:
        """Return its twist (6,) at a point p (3,) of World, in World axes."""
        twist = self.twist.copy()
        twist[:3] += cross(twist[3:], p - self.T.p)
        return twist


class Moved(NamedTuple):
    """The grounds that may move, at the instant that this tick's command is for."""

    base: Body
    carrier: Body
    T_world_base_measured: Pose
    """Base when the joints were measured: a little earlier than `base`."""
    acceleration_base: Array | None = None
    """(6,) of its origin, World axes, where it is known."""

    def body(self, ground: str) -> Body | None:
        """Return a ground that may move, None for World."""
        if ground == "world":
            return None
        return self.base if ground == "base" else self.carrier

    def acceleration_at(self, p: Array) -> Array:
        """Return how a point p (3,) of World that is fixed to Base accelerates (3,) [m/s²]."""
        if self.acceleration_base is None:
            return np.zeros(3)
        a, r, w = self.acceleration_base, p - self.base.T.p, self.base.twist[3:]
        return np.asarray(a[:3] + cross(a[3:], r) + cross(w, cross(w, r)))

    def carries(self, ground: str, p: Array) -> Array:
        """Return a ground's twist (6,) seen from Base, at a point p (3,) of World, World axes.

        It is what an arm on Base has to do so that a tool at p stands still on that ground.
        """
        body = self.body(ground)
        seen = -self.base.twist_at(p)
        return seen if body is None else body.twist_at(p) + seen


class Mount(NamedTuple):
    """A frame's place on another one."""

    on: str
    T: Pose


@dataclass(frozen=True)
class FrameTree:
    """Every frame at one instant."""

    moved: Moved
    T_world_mrf: Pose
    T_wrist_mrf: Pose
    crf: Mount
    T_wrist_sensor: Pose | None = None
    lens: Mount | None = None
    twist_wrist: Array | None = None
    """Of the Wrist at its origin, World axes (6,); None: as far as Base carries it."""

    def pose(self, frame: str, seen_from: str = "world") -> Pose:
        """Return T_seen_from_frame. Raises `UnknownFrame`."""
        T = self._in_world(frame)
        return T if seen_from == "world" else self._in_world(seen_from).inverse() @ T

    def twist(self, frame: str, seen_from: str = "world", at: Array | None = None) -> Array:
        """Return the twist (6,) of a frame seen from another, in World axes.

        Taken at the point `at` (3,) of World, by default the frame's origin. Raises `UnknownFrame`.
        """
        p = self._in_world(frame).p if at is None else at
        return self._carrier_of(frame).twist_at(p) - self._carrier_of(seen_from).twist_at(p)

    def ground(self, frame: str) -> str:
        """Return what stands still for a motion relative to a frame: one of `GROUNDS`.

        What the arm itself carries, and a Lens, are measured against once: what follows is relative
        to the CRF's ground.
        """
        return frame if frame in GROUNDS else self.crf.on

    def _in_world(self, frame: str) -> Pose:
        match frame:
            case "world":
                return Pose.identity()
            case "base":
                return self.moved.base.T
            case "carrier":
                return self.moved.carrier.T
            case "mrf":
                return self.T_world_mrf
            case "wrist":
                return self.T_world_mrf @ self.T_wrist_mrf.inverse()
            case "crf":
                return self._mounted(self.crf)
            case "sensor" if self.T_wrist_sensor is not None:
                return self._mounted(Mount("wrist", self.T_wrist_sensor))
            case "lens" if self.lens is not None:
                return self._mounted(self.lens)
        raise UnknownFrame(f"{frame!r}: the frames of this cell are {', '.join(self.names)}")

    def _mounted(self, mount: Mount) -> Pose:
        return mount.T if mount.on == "world" else self._in_world(mount.on) @ mount.T

    @property
    def names(self) -> tuple[str, ...]:
        """The frames that this cell has."""
        lacking = {"sensor": self.T_wrist_sensor, "lens": self.lens}
        return tuple(name for name in FRAMES if lacking.get(name, True) is not None)

    def _carrier_of(self, frame: str) -> Body:
        """Return the rigid thing that a frame is fixed to."""
        self._in_world(frame)
        if frame in ("crf", "lens"):
            mount = self.crf if frame == "crf" else self.lens
            frame = "world" if mount is None else mount.on
        if frame == "world":
            return Body.standing(Pose.identity())
        body = self.moved.body(frame) if frame in GROUNDS else None
        if body is not None:
            return body
        T = self._in_world("wrist")
        carried = self.moved.base.twist_at(T.p) if self.twist_wrist is None else self.twist_wrist
        return Body(T, carried)
