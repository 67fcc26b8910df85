"""Motions of a script's obstacles, in the physics and in the daemon's news."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....protocols.messages.perception import ObstacleNews
from ....protocols.messages.rig import RigFault
from .tables import MovingObstacle

NEWS_EVERY_S = 0.05
"""Time between two news of an obstacle that moves [s]."""


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
