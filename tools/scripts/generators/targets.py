"""Motions of a camera's target: the tag in the virtual world, and the daemon's news of it."""

import math
from collections.abc import Callable

from ....protocols import topics as t
from ....protocols.codec import encode
from ....protocols.messages.perception import ObstacleNews
from ....protocols.messages.rig import RigFault
from .tables import SCRIPT, MovingTarget

NEWS_EVERY_S = 0.05
"""The daemon hears of the target, and the world sees it move, so often [s]."""

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
        whole = math.dist(start, end)
        gone = self._step.speed * (now_s - self._start_s)
        if gone >= whole:
            return end, True
        part = gone / whole
        x, y, z = (a + part * (b - a) for a, b in zip(start, end, strict=True))
        return (x, y, z), False
