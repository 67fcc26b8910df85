"""The simulated scanner's TCP side: it listens where the cell says that the scanner is.

Polled by the rig, once a physics step: it never blocks, and a listener that does not take its
telegrams is hung up on.
"""

import socket
from contextlib import suppress
from typing import Final

from ...config.schema.sensors.scanner import ScannerSection
from ...protocols.sick.cola import TelegramCutter, TelegramError, framed
from ...protocols.sick.scan_data import SUBSCRIBE
from ..device import DeviceError
from ..scanner.address import host_and_port
from .nodes.sensors.scanner_node import SimulatedScanner

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
