"""Sensor news that the daemon believes, or nearly: near the arm, in time, and wild."""

from typing import Any

from telerobot.config.load import Cell
from telerobot.protocols import topics as t
from telerobot.protocols.messages.messages import Message
from telerobot.protocols.messages.perception import NEEDED, ObstacleNews
from telerobot.protocols.topics import Topic

from .values import Values

NEAR = 1.2
"""Obstacles come within this of World's origin along each axis [m]."""
THINGS = ("a", "b", "c", "d", "e", "f")
"""Names of obstacles that nobody put into the cell."""


class News:
    """Draws news of obstacles, frames and views for one cell."""

    def __init__(self, cell: Cell, values: Values) -> None:
        self._values, self._dice = values, values.dice
        self._cameras = [c.name for c in cell.config.cameras] or ["none"]
        self._known = [o.name for o in cell.config.obstacles]
        frames, cameras = bool(cell.config.frames.moving), bool(cell.config.cameras)
        self.topics = (
            *((t.FRAME_NEWS,) * frames + (t.SIGHTING,) * cameras),
            *((t.OBSTACLE,) * (3 if cell.config.keeps_clear else 1)),
        )
        """Topics of the sensors that the cell listens to."""

    def of(self, topic: Topic, tick: int) -> Message | None:
        """Return news for a sensor's topic, seen about `tick`; None where nothing fits."""
        dice = self._dice
        seen = max(0, tick - dice.choice((0, 0, 0, 1, 5, 100, -5)))
        if topic is t.OBSTACLE:
            return self._obstacle(seen)
        given: dict[str, Any] = {"tick": seen}
        if topic is t.SIGHTING:
            poses = tuple((*self._place(0.3), *self._place(0.5)) for _ in range(dice.randrange(3)))
            errors = tuple(dice.choice((0.0, 0.2, 9e3)) for _ in poses)
            given |= {"camera": dice.choice(self._cameras), "poses": poses, "errors_px": errors}
            given["quality"] = dice.random()
        elif dice.random() < 0.7:
            given |= {"xyz": self._place(0.2), "rpy": self._place(0.2), "quality": 1.0}
        return self._values.message(topic.message, **given)

    def _obstacle(self, tick: int) -> Message | None:
        dice, values = self._dice, self._values
        if dice.random() < 0.1:
            return values.message(ObstacleNews, tick=tick)
        name = dice.choice((*THINGS, *self._known))
        if dice.random() < 0.1:
            return ObstacleNews(name=name, tick=tick, remove=True)
        given: dict[str, Any] = {"name": name, "tick": tick, "remove": False, "shape": None}
        needed: tuple[str, ...] = ("xyz",)
        if dice.random() < 0.6:
            given["shape"] = dice.choice(tuple(NEEDED))
            needed = NEEDED[given["shape"]]
        size = dice.choice((0.0, 0.02, 0.1, 0.4))
        parts: dict[str, Any] = {
            "xyz": self._place(NEAR),
            "to": self._place(NEAR),
            "stale": dice.choice(("keep", "keep", "grow", "stop")),
            "radius": size,
            "half_size": (size + 1e-3, 0.3, dice.choice((1e-3, 0.5, 20.0))),
        }
        return values.message(
            ObstacleNews, **given, **{key: parts[key] for key in (*needed, "stale")}
        )

    def _place(self, far: float) -> tuple[float, float, float]:
        draw = self._dice.uniform
        return draw(-far, far), draw(-far, far), draw(-far, far)
