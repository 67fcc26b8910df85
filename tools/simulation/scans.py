"""The laser scanner of a simulation: telegrams in virtual time, looked at as real ones are.

A search takes time on a real machine: so what a scan led to is told a little later.
"""

from collections import deque
from collections.abc import Callable
from typing import Final

from ...config.load import Cell
from ...drivers.rig.cameras import Put
from ...drivers.rig.rig import Rig
from ...drivers.scanner import decoded
from ...protocols.codec import encode
from ...protocols.messages.perception import ContourNews
from ...protocols.messages.telemetry import State
from ...protocols.sick import TelegramCutter
from ...protocols.topics import CONTOUR, OBSTACLE, Topic
from ...server.perception.scanning.scanning import SCAN, Looked, Scanning
from ..client.protocol_client import ignore
from ..recording.recorder import Recorder

LATE_S: Final = 0.03  # from the telemetry that lets place a scan to the arrival of its news [s]


class SimulatedScans:
    """Hears the simulated scanner and the telemetry, and tells the daemon."""

    def __init__(self, cell: Cell, rig: Rig, put: Put, recorder: Recorder | None = None) -> None:
        """Listen; what was looked at is recorded with its contour.

        Raises `ConfigError` for a cell whose arm has no critical points.
        """
        self._rig, self._put, self._recorder = rig, put, recorder
        self.scanning = Scanning(cell)
        self.newest: Looked | None = None  # the newest scan with its contour
        self.on_look: Callable[[Looked], None] = ignore
        """Called with every scan that was looked at."""
        self._frames = TelegramCutter()
        self._underway: deque[tuple[float, Topic, bytes]] = deque()
        if rig.scanner is not None:
            rig.scanner.on_telegram.append(self._on_telegram)

    def on_state(self, state: State) -> None:
        now_s = self._rig.time_s
        for looked in self.scanning.listen([state], now_s):
            if looked.contour is not None:
                self.newest = looked
                self._record(looked)
            self.on_look(looked)
            for news in looked.messages:
                topic = CONTOUR if isinstance(news, ContourNews) else OBSTACLE.by(SCAN)
                self._underway.append((now_s + LATE_S, topic, encode(news)))

    def run(self, now_s: float) -> None:
        """Hand over what has arrived by `now_s`."""
        while self._underway and self._underway[0][0] <= now_s + 1e-9:
            _, topic, payload = self._underway.popleft()
            self._put(topic, payload)

    def _record(self, looked: Looked) -> None:
        if self._recorder is None:
            return
        self._recorder.scan(self._rig.time_s, looked.points_mm)
        for news in looked.messages:
            if isinstance(news, ContourNews):
                self._recorder.message("contour", self._rig.time_s, news)

    def _on_telegram(self, received: bytes) -> None:
        for found in self._frames.feed(received):
            scan = decoded(found)
            if scan is not None and (refusal := self.scanning.receive(scan, self._rig.time_s)):
                self.scanning.events.append(refusal)
