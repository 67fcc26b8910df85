"""A SICK LMS1xx over TCP: logs in, starts it, takes its telegrams, dials a silent one again.

Nothing here blocks for longer than `WAIT_S`. A scanner may be silent for 30 s after power-up; one
that was heard and then is silent for `SILENT_S` is dialled anew.
"""

import socket
import time
from collections.abc import Callable, Iterator
from typing import Final

from ...config.schema.sensors.scanner import ScannerSection
from ...protocols.sick import scan_data
from ...protocols.sick.cola import TelegramCutter, TelegramError, fault_in, framed
from .address import host_and_port

WAIT_S: Final = 0.05
"""Telegrams are waited for so long at a time [s]."""
DIAL_S: Final = 2.0
"""A connection is waited for so long [s]."""
ANSWER_S: Final = 1.0
"""An answer likewise [s]."""
SILENT_S: Final = 1.0
"""A scanner that sent scans, and sends none for so long, is dialled anew [s]."""
STARTING_S: Final = 35.0
"""One that was just started may take so long [s]."""
AGAIN_S: Final = 1.0
"""From one try to the next [s]."""
_STEPS: Final = (scan_data.LOGIN, scan_data.CONFIGURE, scan_data.START, scan_data.STATE)


class ScannerClient:
    """One scanner. `told` gets a line for everything that goes wrong, or right again."""

    def __init__(
        self,
        scanner: ScannerSection,
        told: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._host, self._port = host_and_port(scanner)
        self._told, self._clock = told, clock
        self._socket: socket.socket | None = None
        self._frames = TelegramCutter()
        self._again_s = self._heard_s = 0.0
        self._complaint = ""
        self.connections = 0
        """How often a scanner was reached and started [1]."""

    def scans(self) -> Iterator[scan_data.Scan | TelegramError]:
        """Yield what came in by now: scans, and why telegrams were refused. Waits a little."""
        if self._socket is None and not self._dial():
            return
        try:
            received = self._receive()
        except OSError as error:
            self._lose(f"lost: {error.strerror or error}")
            return
        for found in self._frames.feed(received):
            if isinstance(found, TelegramError):
                yield found
            elif scan_data.is_scan(found):
                self._heard_s = self._clock()
                try:
                    yield scan_data.decode_scan(found)
                except TelegramError as error:
                    yield error
            elif (fault := fault_in(found)) is not None:
                yield TelegramError(f"the scanner refuses: {fault}")
        if self._clock() - self._heard_s > SILENT_S:
            self._lose("silent")

    def close(self) -> None:
        """Log out of nothing, just hang up: the scanner goes on for others."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    @property
    def _line(self) -> socket.socket:
        """The open connection. Raises `OSError` where there is none."""
        if self._socket is None:
            raise ConnectionResetError("not connected")
        return self._socket

    def _receive(self) -> bytes:
        try:
            received = self._line.recv(1 << 16)
        except TimeoutError:
            return b""
        if not received:
            raise ConnectionResetError("closed by the scanner")
        return received

    def _dial(self) -> bool:
        """Reach the scanner and start it; return whether that was so."""
        wait_s = self._again_s - self._clock()
        if wait_s > 0.0:
            time.sleep(min(wait_s, WAIT_S))
            return False
        self._again_s = self._clock() + AGAIN_S
        try:
            self._socket = socket.create_connection((self._host, self._port), DIAL_S)
            self._frames = TelegramCutter()
            for request in _STEPS:
                answer = self._ask(request)
                fault = fault_in(answer)
                if fault is not None:
                    raise OSError(f"{request.split()[1]}: {fault}")
            self._line.sendall(framed(scan_data.SUBSCRIBE))
            self._line.settimeout(WAIT_S)
        except OSError as error:
            self._lose(f"cannot be started: {error.strerror or error}")
            return False
        self._heard_s = self._clock() + STARTING_S
        self.connections += 1
        self._complaint = ""
        self._told(f"scanner at {self._host}:{self._port}: started")
        return True

    def _ask(self, request: str) -> str:
        """Return the answer to a request. Raises `OSError` where there is none."""
        line = self._line
        line.settimeout(ANSWER_S)
        line.sendall(framed(request))
        name, until_s = request.split(" ")[1], self._clock() + ANSWER_S
        while self._clock() < until_s:
            for found in self._frames.feed(line.recv(1 << 16)):
                if isinstance(found, str) and (name in found.split(" ")[:2] or fault_in(found)):
                    return found
        raise TimeoutError(f"{name}: no answer")

    def _lose(self, why: str) -> None:
        self.close()
        self._again_s = self._clock() + AGAIN_S
        if why != self._complaint:
            self._complaint = why
            self._told(f"scanner at {self._host}:{self._port}: {why}: dialling again")
