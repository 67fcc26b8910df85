"""The rig's own topics over Zenoh, and its scanner's TCP side: faults in, truth and scans out."""

import socket
from collections.abc import Iterator
from contextlib import suppress
from typing import Final, TypeVar

import zenoh

from ...config.load import Cell
from ...config.schema.surroundings import ScannerSection
from ...protocols import codec, topics
from ...protocols.messages.perception import FrameNews, RigMotion
from ...protocols.messages.rig import RigFault, RigTruth
from ...protocols.messages.telemetry import State
from ...protocols.sick import SUBSCRIBE, TelegramCutter, TelegramError, framed
from ..device import DeviceError
from ..network.identity import Identity
from ..network.sessions import Hearing, dialling_config
from ..scanner import host_and_port
from .nodes.sensors import SimulatedScanner
from .rig import Rig

# --- The rig's own topics over Zenoh: faults in, truth out, for judges; and its sensors of frames
#
# What a sensor of a frame tells is the one thing that reaches the daemon, as any sensor's
# would. The rig dials the daemon's router, which may not be there yet, or no longer: the
# session looks for it for ever, and the rig runs on without it.

_Kind = TypeVar("_Kind", RigFault, RigMotion, State)

_MAILBOX = 64
"""Unread faults kept; older ones are dropped for newer ones."""
_AT_ONCE = 4
"""Messages of one kind that are looked at in a physics step: a flood shall not slow it down."""


class RigSession:
    """A Zenoh session for the rig of one cell. Nothing here blocks, and nothing calls back.

    With `frames` it hears the daemon's telemetry, too, to tell which tick it is. Raises
    `DeviceError` for an endpoint of a kind that Zenoh does not know.
    """

    def __init__(
        self, cell: str, endpoint: str, identity: Identity | None = None, *, frames: bool = False
    ) -> None:
        try:
            self._session = zenoh.open(dialling_config(endpoint, cell, identity))
        except zenoh.ZError:
            raise DeviceError(f"zenoh.listen: value {endpoint!r}: cannot be dialled") from None
        self._faults = self._session.declare_subscriber(
            topics.RIG_FAULT.full_key(cell), zenoh.handlers.RingChannel(_MAILBOX)
        )
        self._motions = self._session.declare_subscriber(
            topics.RIG_MOTION.full_key(cell), zenoh.handlers.RingChannel(_MAILBOX)
        )
        self._truth = self._session.declare_publisher(
            topics.RIG_TRUTH.full_key(cell),
            congestion_control=zenoh.CongestionControl.DROP,
        )
        self._truth_heard = Hearing(self._truth)
        self._states = (
            self._session.declare_subscriber(
                topics.STATE.full_key(cell), zenoh.handlers.RingChannel(1)
            )
            if frames
            else None
        )
        self._news = self._session.declare_publisher(
            topics.FRAME_NEWS.full_key(cell),
            priority=zenoh.Priority.REAL_TIME,
            congestion_control=zenoh.CongestionControl.DROP,
        )
        self.refused = 0
        """Payloads that were no `RigFault`, no `RigMotion` and no `State`."""

    def faults(self) -> Iterator[RigFault | RigMotion]:
        """Yield the faults that came in, oldest first, then the motions."""
        yield from self._read(self._faults, RigFault)
        yield from self._read(self._motions, RigMotion)

    def newest_tick(self) -> int | None:
        """Return the newest telemetry tick that came since this was asked last, if one did."""
        if self._states is None:
            return None
        ticks = [state.tick for state in self._read(self._states, State, topics.STATE.max_bytes)]
        return max(ticks, default=None)

    def tell(self, news: FrameNews) -> None:
        """Send what a sensor of a frame says; dropped where nobody can take it."""
        self._news.put(codec.encode(news))

    def _read(
        self,
        box: "zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]",
        kind: type[_Kind],
        max_bytes: int = 4096,
    ) -> Iterator[_Kind]:
        for _ in range(_AT_ONCE):
            sample = box.try_recv()
            if sample is None:
                return
            if len(sample.payload) > max_bytes:  # before it is copied
                self.refused += 1
                continue
            try:
                yield codec.decode_as(kind, sample.payload.to_bytes(), max_bytes)
            except codec.CodecError:
                self.refused += 1

    @property
    def heard(self) -> bool:
        """Whether anybody listens to the truth."""
        return bool(self._truth_heard)

    def publish(self, truth: RigTruth) -> None:
        """Send the truth; dropped where nobody can take it."""
        self._truth.put(codec.encode(truth))

    def close(self) -> None:
        """Close the session."""
        self._session.close()  # type: ignore[no-untyped-call]  # its stubs


# --- The simulated scanner's TCP side: it listens where the cell says that the scanner is ---------
#
# Polled by the rig, once a physics step: it never blocks, and a listener that does not take its
# telegrams is hung up on.

MOST_CLIENTS: Final = 4
"""Who connects beyond is hung up on [1]."""
MOST_UNSENT: Final = 1 << 18
"""A client that lets more wait is hung up on [B]."""


class _Client:
    """One connection."""

    def __init__(self, connection: socket.socket) -> None:
        self.connection, self.frames = connection, TelegramCutter()
        self.subscribed, self.unsent = False, b""
        connection.setblocking(False)

    def send(self, telegram: bytes) -> None:
        """Send, now or later. Raises `OSError` where nobody takes it."""
        self.unsent += telegram
        if len(self.unsent) > MOST_UNSENT:
            raise BrokenPipeError("takes nothing")
        with suppress(BlockingIOError):
            self.unsent = self.unsent[self.connection.send(self.unsent) :]

    def receive(self) -> list[str | TelegramError]:
        """Return the telegrams that came. Raises `OSError` when it hung up."""
        try:
            received = self.connection.recv(4096)
        except BlockingIOError:
            return []
        if not received:
            raise ConnectionResetError
        return self.frames.feed(received)


class ScannerServer:
    """Serves one simulated scanner. Raises `DeviceError` where its place is taken."""

    def __init__(self, scanner: ScannerSection, node: SimulatedScanner) -> None:
        self._node = node
        host, port = host_and_port(scanner)
        try:
            self._socket = socket.create_server((host, port))
        except OSError as error:
            raise DeviceError(
                f"scanner.address: value {scanner.address!r}: {error.strerror or error}"
            ) from None
        self._socket.setblocking(False)
        self.port = int(self._socket.getsockname()[1])
        self._clients: list[_Client] = []
        node.on_telegram.append(self._send)

    def poll(self) -> None:
        """Take in who dials, and answer."""
        with suppress(BlockingIOError):
            connection, _ = self._socket.accept()
            if len(self._clients) < MOST_CLIENTS:
                self._clients.append(_Client(connection))
            else:
                connection.close()
        for client in tuple(self._clients):
            try:
                for words in client.receive():
                    answer = None if isinstance(words, TelegramError) else self._node.answer(words)
                    if answer is not None:
                        client.subscribed |= words == SUBSCRIBE
                        client.send(framed(answer))
            except OSError:
                self._drop(client)

    def close(self) -> None:
        """Hang up on everybody."""
        for client in tuple(self._clients):
            self._drop(client)
        self._socket.close()

    def _send(self, telegram: bytes) -> None:
        for client in tuple(self._clients):
            if client.subscribed:
                try:
                    client.send(telegram)
                except OSError:
                    self._drop(client)

    def _drop(self, client: _Client) -> None:
        client.connection.close()
        self._clients.remove(client)


def serve_scanner(cell: Cell, rig: Rig) -> ScannerServer | None:
    """Let a rig's scanner listen, where the cell has one; it answers as the rig steps.

    Raises `DeviceError` where its place is taken.
    """
    if cell.config.scanner is None or rig.scanner is None:
        return None
    server = ScannerServer(cell.config.scanner, rig.scanner)
    rig.scanner.on_step = server.poll
    return server
