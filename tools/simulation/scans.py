"""The laser scanner of a simulation: telegrams in virtual time, looked at as real ones are.

A search takes time on a real machine, in which the daemon goes on: so what a scan led to is told
a little later.
"""

from collections import deque
from collections.abc import Callable
from typing import Final

from ...config.load import Cell
from ...drivers.rig.rig import Rig
from ...drivers.scanner import Clocks
from ...protocols.codec import encode
from ...protocols.messages.perception import ContourNews
from ...protocols.messages.telemetry import State
from ...protocols.sick import TelegramCutter, TelegramError, decode_scan, is_scan
from ...protocols.topics import CONTOUR, OBSTACLE, Topic
from ...server.perception.scanning.placing import instant_of
from ...server.perception.scanning.scanning import SCAN, Looked, Scanning
from ..recording.recorder import Recorder

Put = Callable[[Topic, bytes], None]

LATE_S: Final = 0.03
"""From the telemetry that lets place a scan to the arrival of its news [s]."""


class SimulatedScans:
    """Hears the simulated scanner and the telemetry, and tells the daemon."""

    def __init__(self, cell: Cell, rig: Rig, put: Put, recorder: Recorder | None = None) -> None:
        """Listen; what was looked at is recorded with its contour.

        Raises `ConfigError` for a cell whose arm has no critical points.
        """
        self._rig, self._put, self._recorder = rig, put, recorder
        self.scanning = Scanning(cell)
        self.newest: Looked | None = None
        """The newest scan with its contour."""
        self.on_look: Callable[[Looked], None] = _ignore
        """Called with every scan that was looked at."""
        self._clocks, self._frames = Clocks(), TelegramCutter()
        self._underway: deque[tuple[float, Topic, bytes]] = deque()
        if rig.scanner is not None:
            rig.scanner.on_telegram.append(self._on_telegram)

    def on_state(self, state: State) -> None:
        """Hear telemetry, and look at what it lets place."""
        now_s = self._rig.time_s
        self._clocks.hear_daemon(now_s, state.time_s)
        for looked in self.scanning.hear(instant_of(state)):
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
            try:
                if isinstance(found, TelegramError):
                    raise found
                if not is_scan(found):
                    continue
                scan = decode_scan(found)
                start_s = self._clocks.hear_scanner(self._rig.time_s, scan.start_us, scan.sent_us)
                if start_s is not None:
                    self.scanning.take(scan, start_s)
            except TelegramError as error:
                self.scanning.refused += 1
                self.scanning.events.append(f"telegram refused: {error}")


def _ignore(_looked: Looked) -> None:
    """Stand in for who draws."""
