"""Obstacles at one instant, as arrays: what the daemon knows to be around the arm.

Two kinds are enough. A *round* is all points within a radius of a segment: a point, a sphere, a
capsule, a sight line. A *box* has sides. Rounds come first wherever all obstacles are counted.

What may move is known to be, `ahead` seconds from now, within `reach(ahead)` of where its
velocity takes it.
"""

import math
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from .compiled import INDEX, MATRIX, NUMBER, ROW, TABLE, VECTOR, compiled
from .evolve import evolve
from .spatial import Array, Pose

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
    carried: Flags
    """Which start at a camera on the Wrist (m,): their `start` is in the Wrist until placed."""


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

    def placed(self, T_world_wrist: Pose) -> Self:
        """Return the scene with every sight line in World that starts at a carried camera."""
        carried = self.rounds.carried
        if not np.count_nonzero(carried):
            return self
        start = self.rounds.start.copy()
        start[carried] = start[carried] @ T_world_wrist.R.T + T_world_wrist.p
        return evolve(self, rounds=evolve(self.rounds, start=start))


def empty() -> Scene:
    """Return a scene with nothing in it."""
    none, no = np.zeros(0), np.zeros(0, dtype=bool)
    return Scene(
        names=(),
        rounds=Rounds(np.zeros((0, 3)), np.zeros((0, 3)), none, no, no),
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
