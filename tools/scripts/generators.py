"""Generators of commands: masters, obstacles, targets, insertions."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...protocols import topics as t
from ...protocols.codec import encode
from ...protocols.messages.messages import Frame
from ...protocols.messages.perception import ObstacleNews
from ...protocols.messages.rig import RigFault
from ...protocols.messages.telemetry import State, TaskState
from ...server.control.spatial import Pose, rotation_exp, rotation_rpy
from .script import SCRIPT, DrivenInsertion, MovingObstacle, MovingTarget

# --- A tool or payload that is driven in by stick, and that searches for its hole where it jams ---
#
# A stick and force control alone find a hole that is no farther off than its chamfer catches.
# Beside that the edge stands on the rim, and is pressed on for ever. So where force is felt
# without progress, the stick presses more gently and leads the tool round in a spiral about
# where it jammed, as blind search in assembly does; while it goes round, it may swing about the
# axis that it is driven along, for a payload with several pegs, and lean to and fro. Once it
# gets further, it is driven on straight. A search that came to its end begins anew: nothing but
# the script's end ends the attempt, and the daemon says `jammed`.
Array = NDArray[np.float64]

JAMMED_S = 2.2
"""Force without progress for so long begins the search [s]: the daemon has named it by then."""
HELD_UP = 0.1  # less of what was asked for than this part is no progress [1]
PRESSED_N = 5.0  # below this something else holds it up [N]
GENTLE = 0.5  # part of the speed that the edges are pressed together with while it is searched [1]
CAUGHT = 1.5e-3  # so much further, and it is in [m]
FALLS_S = 0.3  # what it gets on by is seen over this time [s]
DEEPER = 5e-4  # so much further, and the spiral begins anew about there [m]
FALLS = 0.5  # while it gets on by this part of what is asked for, it goes round no further [1]
PITCH = 2e-3  # between two turns of the spiral [m]: less than what chamfers catch
ROUND = 4e-3  # speed along the spiral [m/s]
BACK = 2.0  # what is off the spiral, or the swing, is taken back with [1/s]
TURNING = 0.02  # greatest rate of the swing [rad/s]
SWINGS = 2.0  # swings of the tilt for each turn of the spiral [1]


class InsertionMotion:
    """The stick of one insertion; told the newest state, it tells what to ask for."""

    def __init__(self, step: DrivenInsertion) -> None:
        self._step = step
        velocity = np.array(step.velocity)
        self._speed = float(np.linalg.norm(velocity))
        self._along = velocity / self._speed
        # Two axes across: any that are square to it, and to each other.
        least = np.eye(3)[int(np.argmin(np.abs(self._along)))]
        self._first = np.cross(self._along, least)
        self._first /= np.linalg.norm(self._first)
        self._second = np.cross(self._along, self._first)
        self._began: Array | None = None
        self._R = np.eye(3)
        self._past: deque[tuple[float, float, float]] = deque()
        """Times [s], ways [m] and forces [N] along."""
        self._centre, self._attitude = np.zeros(3), np.eye(3)
        self._from_m = self._best_m = self._since_s = self._angle = 0.0
        self._searching = self.arrived = False

    def fields(self, now_s: float, state: State | None) -> dict[str, Any] | None:
        """Return what the stick says now; None before anything is known of the arm."""
        if state is None:
            return None
        twist = self._twist(now_s, state.of(self._step.task))
        axes = self._step.expressed_in
        said = {"twist": tuple(twist.tolist()), "expressed_in": axes, "relative_to": axes}
        if axes == "world":
            del said["relative_to"]
        return said | ({} if self._step.task is None else {"task": self._step.task})

    def _twist(self, now_s: float, task: TaskState) -> Array:
        T = np.array(task.pose_mrf_measured)
        R = rotation_rpy(*T[3:].tolist())
        if self._began is None:
            self._began, self._R = T[:3], R
        place = T[:3] - self._began
        force = np.zeros(3) if task.wrench_mrf is None else np.array(task.wrench_mrf[:3])
        if self._step.expressed_in == "mrf":
            # The axes of when it began: a tool that leans must not lead the search away.
            place = self._R.T @ place
        else:
            force = R @ force
        way = float(place @ self._along)
        self.arrived = self.arrived or way >= self._step.way
        if self.arrived:
            return np.zeros(6)
        self._past.append((now_s, way, float(force @ self._along)))
        while now_s - self._past[0][0] > JAMMED_S + 1e-9:
            self._past.popleft()
        if self._searching and way > self._from_m + CAUGHT:
            self._searching = False
            self._past.clear()
        elif not self._searching and self._jammed(now_s):
            self._searching = True
            self._centre, self._attitude = place, R
            self._from_m, self._best_m, self._since_s, self._angle = way, way, now_s, 0.0
        if not self._searching:
            return np.concatenate([self._speed * self._along, self._upright(R)])
        if way > self._best_m + DEEPER:
            self._best_m, self._centre, self._angle = way, place, 0.0
        return self._search(now_s, place, R)

    def _falls(self) -> bool:
        """Return whether it gets further right now."""
        newest_s, way, _ = self._past[-1]
        before = next(w for at_s, w, _ in self._past if at_s >= newest_s - FALLS_S)
        return way - before > FALLS * GENTLE * self._speed * FALLS_S

    def _jammed(self, now_s: float) -> bool:
        if not self._step.search or now_s - self._past[0][0] < JAMMED_S - 0.05:
            return False
        way = self._past[-1][1] - self._past[0][1]
        force = sum(f for _, _, f in self._past) / len(self._past)
        return force > PRESSED_N and way < HELD_UP * self._speed * JAMMED_S

    def _search(self, now_s: float, place: Array, R: Array) -> Array:
        """Return the twist (6,) of the spiral, and of the swing beside it."""
        step_s, self._since_s = now_s - self._since_s, now_s
        feed = GENTLE * self._speed * self._along
        if self._falls():
            return np.concatenate([feed, self._upright(R)])
        radius = PITCH * self._angle / math.tau
        self._angle += step_s * ROUND / math.hypot(max(radius, 0.5 * PITCH), PITCH / math.tau)
        if radius > self._step.search:
            # From the middle again, the other way round.
            self._angle, self._second = 0.0, -self._second
        c, s = math.cos(self._angle), math.sin(self._angle)
        out, around = c * self._first + s * self._second, c * self._second - s * self._first
        off = self._centre + radius * out - place
        off -= self._along * float(off @ self._along)
        across = ROUND * around + _at_most(BACK * off, 0.5 * ROUND)
        turn = self._upright(R)
        if self._step.tilt:
            about = self._along if self._step.swing else out
            wanted = self._step.tilt * math.sin(SWINGS * self._angle) * about
            off = wanted - self._turned(R, self._attitude)
            if self._step.swing:
                off = self._along * float(off @ self._along)
            turn += _at_most(BACK * off, TURNING)
        return np.concatenate([feed + across, turn])

    def _upright(self, R: Array) -> Array:
        """Return the rate (3,) [rad/s] that keeps pegs side by side, in the step's axes.

        Where one peg stands on its rim, all that is pressed turns the payload about it, and the
        other one goes in askew until it wedges: millimetres apart are 0.1 kN in its hole.
        """
        if not self._step.swing:
            return np.zeros(3)
        off = self._turned(R, self._R)
        return _at_most(BACK * (self._along * float(off @ self._along) - off), TURNING)

    def _turned(self, R: Array, since: Array) -> Array:
        """Return how far the tool has turned from an attitude (3,) [rad], in the step's axes."""
        # Small angles: half of what is skew.
        D = R @ since.T
        turned = 0.5 * np.array([D[2, 1] - D[1, 2], D[0, 2] - D[2, 0], D[1, 0] - D[0, 1]])
        return turned if self._step.expressed_in == "world" else R.T @ turned


def _at_most(vector: Array, size: float) -> Array:
    return vector * min(1.0, size / max(float(np.linalg.norm(vector)), 1e-12))


# --- Handle of a script's master device: moves at given twists, its pose is streamed --------------
class MasterHandle:
    """A handle at a pose of its own, moving at a twist since some time."""

    def __init__(self) -> None:
        self._p = np.zeros(3)
        self._R = np.eye(3)
        self._twist = np.zeros(6)
        self._since_s = 0.0
        self._axes = Frame.CRF

    def move(self, twist: Sequence[float], axes: Frame, now_s: float) -> None:
        """Move on at a twist (6,) [m/s, rad/s] in the axes of the device's base."""
        self._p, self._R = self._at(now_s)
        self._twist, self._since_s, self._axes = np.array(twist, dtype=float), now_s, axes

    def fields(self, now_s: float) -> dict[str, Any]:
        """Return what a `MasterPose` says now."""
        p, R = self._at(now_s)
        six = Pose(R, p).to_xyz_rpy()
        return {"xyz": six[:3], "rpy": six[3:], "expressed_in": self._axes}

    def _at(self, now_s: float) -> tuple[Array, Array]:
        passed_s = now_s - self._since_s
        turn = rotation_exp(passed_s * self._twist[3:])
        return self._p + passed_s * self._twist[:3], turn @ self._R


# --- Motions of a script's obstacles, in the physics and in the daemon's news ---------------------
NEWS_EVERY_S = 0.05  # time between two news of an obstacle that moves [s]


@dataclass
class _Moving:
    """An obstacle that moves at a velocity since some time."""

    xyz: NDArray[np.float64]
    velocity: NDArray[np.float64]
    since_s: float
    physical: bool
    tell: bool
    told_s: float

    def at(self, now_s: float) -> tuple[float, float, float]:
        x, y, z = (self.xyz + (now_s - self.since_s) * self.velocity).tolist()
        return (x, y, z)


class ObstacleMotions:
    """Moves obstacles and tells of them; `run` does what is due."""

    def __init__(
        self, tell: Callable[[ObstacleNews], None], inject: Callable[[RigFault], None]
    ) -> None:
        self._tell, self._inject = tell, inject
        self._moving: dict[str, _Moving] = {}
        self._waiting: list[tuple[MovingObstacle, float]] = []

    def take(self, step: MovingObstacle, now_s: float) -> None:
        """Take in a step; it begins at the next `run`."""
        self._waiting.append((step, now_s))

    def run(self, now_s: float, tick: int) -> None:
        """Move what moves, and tell of it; `tick` is the newest telemetry tick that was seen.

        Raises `ValueError` for an obstacle that the physics does not have.
        """
        for step, since_s in self._waiting:
            self._begin(step, since_s, tick)
        self._waiting.clear()
        for name, moving in self._moving.items():
            place = moving.at(now_s)
            if moving.physical:
                self._place(name, place)
            if moving.tell and now_s >= moving.told_s + NEWS_EVERY_S - 1e-9:
                moving.told_s = now_s
                vx, vy, vz = moving.velocity.tolist()
                news = ObstacleNews(name=name, tick=tick, xyz=place, velocity=(vx, vy, vz))
                self._tell(news)

    def _begin(self, step: MovingObstacle, since_s: float, tick: int) -> None:
        news = step.news
        moving = self._moving.pop(news.name, None)
        if step.silent and moving is not None:
            moving.tell = False
            self._moving[news.name] = moving
            return
        place = news.xyz
        if place is None and moving is not None:
            place = moving.at(since_s)
        if step.tell:
            known = {} if place is None or news.remove else {"xyz": place}
            self._tell(news.model_copy(update={"tick": tick, **known}))
        if place is not None and step.physical:
            self._place(news.name, place)
        if place is not None and news.velocity is not None and any(news.velocity):
            self._moving[news.name] = _Moving(
                np.array(place), np.array(news.velocity), since_s, step.physical, step.tell, since_s
            )

    def _place(self, name: str, place: tuple[float, float, float]) -> None:
        self._inject(RigFault(kind="place", target=name, vector=place))


# --- Motions of a camera's target: the tag in the virtual world, and the daemon's news of it ------
Place = tuple[float, float, float]


class TargetMotion:
    """Goes straight from one place to another, at one speed, from `start_s` on."""

    def __init__(self, step: MovingTarget, start_s: float) -> None:
        self._step = step
        self._start_s = start_s
        self._due_s = start_s
        self.arrived = False

    def run(
        self,
        now_s: float,
        tick: int,
        put: Callable[[t.Topic, bytes, bytes], None],
        inject: Callable[[RigFault], None],
    ) -> None:
        """Move the tag and tell the daemon, when that is due; news is of telemetry tick `tick`."""
        if self.arrived or now_s < self._due_s - 1e-9:
            return
        self._due_s = now_s + NEWS_EVERY_S
        place, self.arrived = self.place(now_s)
        inject(RigFault(kind="move", target=self._step.tag, vector=place))
        if self._step.sight_line is not None:
            news = ObstacleNews(name=self._step.sight_line, tick=tick, to=place)
            put(t.OBSTACLE.by(SCRIPT), encode(news), b"")

    def place(self, now_s: float) -> tuple[Place, bool]:
        """Return where the target is at `now_s` [m], and whether it has arrived."""
        start, end = self._step.start, self._step.to
        whole, gone = math.dist(start, end), self._step.speed * (now_s - self._start_s)
        if gone >= whole:
            return end, True
        part = gone / whole
        x, y, z = (a + part * (b - a) for a, b in zip(start, end, strict=True))
        return (x, y, z), False
