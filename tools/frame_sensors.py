"""Sensors of frames that move, simulated in virtual time: noisy news, at its rate and latency."""

from collections import deque
from collections.abc import Callable

import numpy as np

from ..config.load import Cell
from ..drivers.rig.rig import Rig
from ..protocols.codec import encode
from ..protocols.moving import FrameNews
from ..protocols.topics import FRAME_NEWS, Topic
from ..server.control.frames import Pose, rotation_exp

Put = Callable[[Topic, bytes], None]


class SimulatedFrameSensors:
    """Tells where a simulated cell's Base and Carrier are, where these may move."""

    def __init__(self, cell: Cell, rig: Rig, put: Put) -> None:
        config = cell.config.rig
        if config is None:
            raise ValueError(f"cell {cell.config.name} has no [rig]: nothing to simulate")
        self._config = config.frames
        self._names = tuple(cell.config.frames.moving)
        self._rig, self._put = rig, put
        self._rng = np.random.default_rng([config.seed, 1])
        self._due_s = 0.0
        self.silent: set[str] = set()
        """Frames of which no news is told."""
        self._underway: deque[tuple[float, bytes]] = deque()

    def run(self, now_s: float, tick: int) -> None:
        """Hand over what has arrived by `now_s`, and measure what is due at SYNC `tick`."""
        if not self._names:
            return
        while self._underway and self._underway[0][0] <= now_s + 1e-9:
            self._put(FRAME_NEWS, self._underway.popleft()[1])
        if now_s < self._due_s - 1e-9:
            return
        self._due_s = now_s + 1.0 / self._config.rate_hz
        for name in self._names:
            news = self._news(name, tick)  # the noise does not depend on who hears it
            if name not in self.silent:
                self._underway.append((now_s + self._config.latency_s, encode(news)))

    def _news(self, name: str, tick: int) -> FrameNews:
        pose = self._rig.frames[name]
        linear, angular = self._config.noise
        noise = self._rng.normal(size=6) * np.repeat([linear, angular], 3)
        true = Pose.from_xyz_rpy(pose[:3], pose[3:])
        x, y, z, *rpy = Pose(rotation_exp(noise[3:]) @ true.R, true.p + noise[:3]).to_xyz_rpy()
        twist = tuple(self._rig.frame_twist(name)) if self._config.twists else None
        return FrameNews.model_validate(
            {"name": name, "tick": tick, "xyz": (x, y, z), "rpy": tuple(rpy), "twist": twist}
        )
