"""A SICK LMS1xx over TCP: logs in, starts it, takes its telegrams, tells the time of its scans."""

import math
import socket
import time
from collections.abc import Callable, Iterator
from typing import Final

from ..config.schema.surroundings import ScannerSection
from ..protocols import sick as scan_data
from ..protocols.sick import TelegramCutter, TelegramError, fault_in, framed

# --- Where a scanner listens ----------------------------------------------------------------------


def host_and_port(scanner: ScannerSection) -> tuple[str, int]:
    """Return host and port of a scanner's address, `tcp/HOST:PORT`."""
    host, _, port = scanner.address.removeprefix("tcp/").rpartition(":")
    return host, int(port)


# --- A SICK LMS1xx over TCP: logs in, starts it, takes its telegrams, dials a silent one again ----
#
# Nothing here blocks for longer than `WAIT_S`. A scanner may be silent for 30 s after power-up;
# one that was heard and then is silent for `SILENT_S` is dialled anew.

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


def decoded(found: str | TelegramError) -> scan_data.Scan | TelegramError | None:
    """Return the scan in a telegram, or why it is refused; None for a telegram of another kind."""
    if isinstance(found, TelegramError):
        return found
    try:
        return scan_data.decode_scan(found) if scan_data.is_scan(found) else None
    except TelegramError as error:
        return error


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
            if (scan := decoded(found)) is not None:
                if not isinstance(found, TelegramError):
                    self._heard_s = self._clock()
                yield scan
            elif (fault := fault_in(str(found))) is not None:
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


# --- The scanner's clock beside the daemon's: neither is the other's, and messages of both come
# late
#
# Of either the message that came soonest tells most: how its stamp differs from the clock of
# who listens is then the least. The clocks may drift apart.

DRIFT: Final = 1e-4
"""Clocks drift apart by at most [s/s]."""
WRAPS: Final = 1 << 32
"""The scanner's clock counts up to that [µs]."""
FORGET_S: Final = 2.0
"""A stamp that is off by more is another clock's: one of the two started again [s]."""


class _Least:
    """The least difference of arrival and stamp."""

    def __init__(self) -> None:
        self.least, self._last_s = math.inf, 0.0

    def hear(self, arrived_s: float, stamp_s: float) -> None:
        late_s = arrived_s - stamp_s
        if abs(late_s - self.least) > FORGET_S:
            self.least = late_s
        self.least = min(self.least + DRIFT * (arrived_s - self._last_s), late_s)
        self._last_s = arrived_s


class Clocks:
    """Tells when a scan began, on the daemon's clock, by what was heard of both."""

    def __init__(self) -> None:
        self._daemon, self._scanner = _Least(), _Least()
        self._sent_us: int | None = None

    def hear_daemon(self, arrived_s: float, time_s: float) -> None:
        """Note when a message of a tick at `time_s` arrived, on the clock of who listens."""
        self._daemon.hear(arrived_s, time_s)

    def hear_scanner(self, arrived_s: float, start_us: int, sent_us: int) -> float | None:
        """Return when a scan began on the daemon's clock [s]; None before a tick was heard."""
        last = self._sent_us
        turns = 0 if last is None else round((last - sent_us) / WRAPS)
        self._sent_us = sent_us + turns * WRAPS
        self._scanner.hear(arrived_s, self._sent_us * 1e-6)
        if math.isinf(self._daemon.least):
            return None
        began_s = (self._sent_us - (sent_us - start_us) % WRAPS) * 1e-6
        return began_s + self._scanner.least - self._daemon.least
