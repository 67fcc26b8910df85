"""`telerobot scan CELL`: takes the scans of the laser scanner, and tells the daemon of obstacles.

A process of its own, so that neither a scan nor the search of a way delays the control loop or the
physics. Where there is no scanner it goes on dialling; without news the daemon lets no base drive
ahead.
"""

import argparse
import time
from concurrent.futures import ThreadPoolExecutor

from ...drivers.network.identity import identity_of
from ...drivers.network.sensor_session import Over, dial
from ...drivers.network.session import Session
from ...drivers.scanner import Clocks, ScannerClient
from ...protocols import topics as t
from ...protocols.codec import CodecError, decode_as, encode
from ...protocols.messages.perception import ContourNews, ScanPoints
from ...protocols.messages.telemetry import State
from ...protocols.sick import Scan, TelegramError
from ...protocols.topics import Role
from ...server.perception.scanning.placing import instant_of
from ...server.perception.scanning.scanning import SCAN, Looked, Scanning
from ..host.address import cell_from
from ..host.local_plant import until_told
from ..host.progress import Sparing, say

STATES = 64  # unread telemetry that is kept [1]: a search takes some tenths of a second
TOLD_EVERY_S = 5.0  # refused telegrams are told at most so often [s]


def run(args: argparse.Namespace) -> int:
    """Scan until told to end. Raises `ConfigError`."""
    cell = cell_from(args)
    scanning = Scanning(cell)
    # Silence for as long as a search takes would stop the base.
    scanning.reflex.elsewhere = ThreadPoolExecutor(1)
    for topic in (t.OBSTACLE, t.CONTOUR):  # it puts on both
        identity = identity_of(cell, Role.SENSOR, SCAN, topic.key)
    over = until_told(args.seconds)
    session = dial(cell, identity, over, f"the scanner of {cell.config.name} is looked through")
    work = None
    if session is not None:
        work = _ScanWork(session, scanning)
        try:
            work.run(over)
        finally:
            work.close()
    told = 0 if work is None else work.told
    print(f"{scanning.scans} scans, {scanning.refused} telegrams refused, {told} contours")
    return 0


class _ScanWork:
    """The process's loop: hear the daemon and the scanner, look, tell."""

    def __init__(self, session: Session, scanning: Scanning) -> None:
        self._session, self._scanning = session, scanning
        self._client = ScannerClient(scanning.scanner, lambda line: say(f"telerobot: {line}"))
        self._states = session.subscribe(t.STATE, STATES)
        self._clocks = Clocks()
        self._connections = 0
        self._complain = Sparing(TOLD_EVERY_S)
        self.told = 0  # contours that the daemon was told [1]

    def run(self, over: Over) -> None:
        """Look at every scan as it comes."""
        while not over():
            for found in self._client.scans():
                self._take(found)
            if self._client.connections != self._connections:
                self._connections = self._client.connections
                self._scanning.forget()
                self._clocks = Clocks()
            self._hear()
            while self._scanning.events:
                say(f"telerobot: {self._scanning.events.popleft()}")

    def close(self) -> None:
        self._client.close()
        self._session.close()

    def _take(self, found: Scan | TelegramError) -> None:
        try:
            if isinstance(found, TelegramError):
                raise found
            start_s = self._clocks.hear_scanner(time.monotonic(), found.start_us, found.sent_us)
            if start_s is not None:
                self._scanning.take(found, start_s)
        except TelegramError as error:
            self._scanning.refused += 1
            self._complain(f"telegram refused: {error}")

    def _hear(self) -> None:
        for payload in self._states.take():
            try:
                state = decode_as(State, payload, t.STATE.max_bytes)
            except CodecError:
                continue
            self._clocks.hear_daemon(time.monotonic(), state.time_s)
            for looked in self._scanning.hear(instant_of(state)):
                self._tell(looked)
                if self._session.heard(t.SCAN):
                    points = ScanPoints(tick=state.tick, points_mm=looked.points_mm)
                    self._session.put(t.SCAN, encode(points))

    def _tell(self, looked: Looked) -> None:
        for news in looked.messages:
            contour = isinstance(news, ContourNews)
            self.told += contour
            topic = t.CONTOUR if contour else t.OBSTACLE.by(SCAN)
            self._session.put(topic, encode(news))
