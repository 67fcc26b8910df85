"""Process of the scanner: takes its scans, and tells the daemon what stands around.

A process of its own, so that neither a scan nor the search of a way delays the control loop or the
physics. Where there is no scanner it goes on dialling; without news the daemon lets no base drive
ahead.
"""

import time
from collections.abc import Callable
from contextlib import suppress

from ....drivers.network.sensor_session import Over
from ....drivers.network.session import Session
from ....drivers.scanner import ScannerClient
from ....protocols import topics as t
from ....protocols.codec import CodecError, decode_as, encode
from ....protocols.messages.perception import ContourNews, ScanPoints
from ....protocols.messages.telemetry import State
from .scanning import SCAN, Looked, Scanning

STATES = 64  # unread telemetry that is kept [1]: a search takes some tenths of a second


class ScanWork:
    """The process's loop: hear the daemon and the scanner, look, tell."""

    def __init__(
        self,
        session: Session,
        scanning: Scanning,
        say: Callable[[str], None],
        complain: Callable[[str], None],
    ) -> None:
        """`say` gets a line for what goes wrong or right, `complain` why telegrams are refused."""
        self._session, self._scanning, self._say, self._complain = session, scanning, say, complain
        self._client = ScannerClient(scanning.scanner, say)
        self._states = session.subscribe(t.STATE, STATES)
        self._connections = 0

    def run(self, over: Over) -> None:
        """Look at every scan as it comes."""
        while not over():
            for found in self._client.scans():
                if refusal := self._scanning.receive(found, time.monotonic()):
                    self._complain(refusal)
            if self._client.connections != self._connections:
                self._connections = self._client.connections
                self._scanning.forget()
            self._hear()
            while self._scanning.events:
                self._say(self._scanning.events.popleft())

    def close(self) -> None:
        """Hang up on the scanner; the session is whose it was."""
        self._client.close()

    def _hear(self) -> None:
        states: list[State] = []
        for payload in self._states.take():
            with suppress(CodecError):
                states.append(decode_as(State, payload, t.STATE.max_bytes))
        for looked in self._scanning.listen(states, time.monotonic()):
            self._tell(looked)
            if self._session.heard(t.SCAN):
                points = ScanPoints(tick=looked.tick, points_mm=looked.points_mm)
                self._session.put(t.SCAN, encode(points))

    def _tell(self, looked: Looked) -> None:
        for news in looked.messages:
            topic = t.CONTOUR if isinstance(news, ContourNews) else t.OBSTACLE.by(SCAN)
            self._session.put(topic, encode(news))
