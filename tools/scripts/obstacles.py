"""Obstacles of scripts: where they are over time, in the physics and in what the daemon is told."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...protocols.messages.obstacles import ObstacleNews
from ...protocols.messages.rig import RigFault
from .incidents import ObstacleStep

NEWS_EVERY_S = 0.05
"""Time between two news of an obstacle that moves [s]."""

_TOLD_ONCE = (
    "shape", "to", "rpy", "half_size", "radius", "max_speed", "max_acceleration", "timeout_s",
    "stale", "clearance", "hard",
)  # fmt: skip


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


class MovingObstacles:
    """Moves obstacles and tells of them; `run` does what is due."""

    def __init__(
        self, tell: Callable[[ObstacleNews], None], inject: Callable[[RigFault], None]
    ) -> None:
        self._tell, self._inject = tell, inject
        self._moving: dict[str, _Moving] = {}
        self._waiting: list[tuple[ObstacleStep, float]] = []

    def take(self, step: ObstacleStep, now_s: float) -> None:
        """Do what a step says, at the next `run`."""
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

    def _begin(self, step: ObstacleStep, since_s: float, tick: int) -> None:
        moving = self._moving.pop(step.name, None)
        if step.silent and moving is not None:
            moving.tell = False
            self._moving[step.name] = moving
            return
        place = step.xyz
        if place is None and moving is not None:
            place = moving.at(since_s)
        if step.tell and step.remove:  # where it is, or goes, is no news of one that is gone
            self._tell(ObstacleNews(name=step.name, tick=tick, remove=True))
        elif step.tell:
            told: dict[str, Any] = {
                key: value for key in _TOLD_ONCE if (value := getattr(step, key)) is not None
            }
            if place is not None:
                told["xyz"] = place
            if step.velocity is not None:
                told["velocity"] = step.velocity
            self._tell(ObstacleNews(name=step.name, tick=tick, **told))
        if place is not None and step.physical:
            self._place(step.name, place)
        if place is not None and step.velocity is not None and any(step.velocity):
            self._moving[step.name] = _Moving(
                np.array(place), np.array(step.velocity), since_s, step.physical, step.tell, since_s
            )

    def _place(self, name: str, place: tuple[float, float, float]) -> None:
        self._inject(RigFault(kind="place", target=name, vector=place))
