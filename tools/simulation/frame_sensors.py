"""Simulated sensors of moving frames: noisy news at a rate and latency, in physics time.

In virtual time a SYNC's number is the tick that it begins. Between processes it is not: there the
rig listens to the telemetry, and learns how far the two numbers are apart.
"""

import statistics
from collections import deque
from collections.abc import Callable

import numpy as np

from ...config.load import Cell
from ...drivers.rig.rig import Rig
from ...protocols.messages.perception import FrameNews
from ...server.control.spatial import Pose, rotation_exp

PutNews = Callable[[FrameNews], None]  # takes what a sensor says, when that has arrived
HEARD = 25  # newest ticks that are held against the SYNCs beside which they were heard [1]
GAP_S = 0.1  # after a silence of the bus for this long, another daemon may be at work [s]


class SimulatedFrameSensors:
    """Tells where a simulated cell's Base and Carrier are, where these may move."""

    def __init__(self, cell: Cell, rig: Rig, put: PutNews) -> None:
        config = cell.config.rig
        if config is None:
            raise ValueError(f"cell {cell.config.name} has no [rig]: nothing to simulate")
        self._config = config.frames
        rolls = ("base",) if config.frames.gyroscope else ()
        self._names = tuple(dict.fromkeys((*cell.config.frames.moving, *rolls)))
        self._rig, self._put = rig, put
        self._rng = np.random.default_rng([config.seed, 1])
        self._due_s = 0.0
        self._underway: deque[tuple[float, FrameNews]] = deque()

    def run(self, now_s: float, tick: int) -> None:
        """Hand over what has arrived by `now_s`, and measure what is due at SYNC `tick`."""
        if not self._names:
            return
        while self._underway and self._underway[0][0] <= now_s + 1e-9:
            self._put(self._underway.popleft()[1])
        if now_s < self._due_s - 1e-9:
            return
        self._due_s = now_s + 1.0 / self._config.rate_hz
        for name in self._names:
            news = self._news(name, tick)  # the noise does not depend on who hears it
            if name not in self._rig.unseen:
                self._underway.append((now_s + self._config.latency_s, news))

    def forget(self) -> None:
        """Drop what has not arrived yet."""
        self._underway.clear()

    def _news(self, name: str, tick: int) -> FrameNews:
        pose = self._rig.frames[name]
        linear, angular = self._config.noise
        noise = self._rng.normal(size=6) * np.repeat([linear, angular], 3)
        true = Pose.from_xyz_rpy(pose[:3], pose[3:])
        x, y, z, *rpy = Pose(rotation_exp(noise[3:]) @ true.R, true.p + noise[:3]).to_xyz_rpy()
        twist = tuple(self._rig.frame_twist(name)) if self._config.twists else None
        if name == "base" and self._config.gyroscope:
            rpy = [0.0, 0.0, rpy[2] + self._config.gyroscope_bias * self._rig.time_s]
            return FrameNews.model_validate(
                {"name": name, "tick": tick, "xyz": (0.0,) * 3, "rpy": rpy, "heading": True}
            )
        return FrameNews.model_validate(
            {"name": name, "tick": tick, "xyz": (x, y, z), "rpy": tuple(rpy), "twist": twist}
        )


class SyncTicks:
    """Which telemetry tick a SYNC began, from the ticks that are heard.

    A tick is mostly heard before the next SYNC. One that is heard late, or whose SYNC was handled
    late, is put right by the others: the median counts.
    """

    def __init__(self) -> None:
        self._apart: deque[int] = deque(maxlen=HEARD)

    def heard(self, tick: int, sync: int) -> None:
        """Note that tick `tick` was the newest one heard when SYNC `sync` was the newest one."""
        self._apart.append(sync - tick)

    def tick(self, sync: int) -> int | None:
        """Return the tick that a SYNC began, None while that is not known."""
        if not self._apart:
            return None
        return sync - statistics.median_low(self._apart)

    def forget(self) -> None:
        """Know nothing."""
        self._apart.clear()


class FrameSensors:
    """The sensors of a rig's frames in a process of its own; `newest_tick` is the telemetry's."""

    def __init__(
        self, cell: Cell, rig: Rig, newest_tick: Callable[[], int | None], put: PutNews
    ) -> None:
        self._sensors = SimulatedFrameSensors(cell, rig, self._tell)
        self._ticks = SyncTicks()
        self._rig, self._newest_tick, self._put = rig, newest_tick, put
        self._last_s = -GAP_S
        rig.on_sync = self._on_sync

    def _on_sync(self) -> None:
        now_s, sync = self._rig.time_s, self._rig.sync_count
        newest = self._newest_tick()
        if now_s - self._last_s >= GAP_S:
            self._ticks.forget()
            self._sensors.forget()
        elif newest is not None:
            self._ticks.heard(newest, sync - 1)
        self._last_s = now_s
        self._sensors.run(now_s, sync)

    def _tell(self, news: FrameNews) -> None:
        tick = self._ticks.tick(news.tick)
        if tick is not None and tick >= 0:
            self._put(news.model_copy(update={"tick": tick}))
