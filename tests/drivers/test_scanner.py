"""A scanner over TCP, and the simulated one on the other side, which answers as it steps."""

import socket
import threading
from collections.abc import Iterator

import pytest
from telerobot.config.load import altered, load_cell
from telerobot.drivers.rig.nodes.sensors import SimulatedScanner
from telerobot.drivers.rig.physics.world import World
from telerobot.drivers.rig.session import ScannerServer
from telerobot.drivers.scanner import ScannerClient
from telerobot.protocols.messages.rig import RigFault
from telerobot.protocols.sick import Scan, TelegramError


class Line:
    """The simulated scanner in a thread of its own, and a client."""

    def __init__(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as probe:
            port = probe.getsockname()[1]
        cell = load_cell("rover_bridge")
        cell = altered(cell, {"scanner.address": f"tcp/127.0.0.1:{port}"})
        scanner = cell.config.scanner
        self.node = SimulatedScanner(cell, World(cell))
        self.server = ScannerServer(scanner, self.node)
        self.said: list[str] = []
        self.client = ScannerClient(scanner, self.said.append)
        self.over = threading.Event()
        self.thread = threading.Thread(target=self._run)
        self.thread.start()

    def _run(self) -> None:
        time_s = 0.0
        while not self.over.wait(0.001):
            time_s += 0.005
            self.server.poll()
            self.node.step(time_s)

    def first(self) -> Scan | TelegramError:
        while True:
            for found in self.client.scans():
                return found

    def close(self) -> None:
        self.over.set()
        self.thread.join()
        self.client.close()
        self.server.close()


@pytest.fixture
def line() -> Iterator[Line]:
    line = Line()
    yield line
    line.close()


def test_a_scanner_is_started_and_sends_scans(line: Line) -> None:
    scan = line.first()
    assert isinstance(scan, Scan)
    assert len(scan.distances) == 541
    assert line.said == [f"scanner at 127.0.0.1:{line.server.port}: started"]


def test_a_spoilt_telegram_is_told_and_the_next_one_is_read(line: Line) -> None:
    assert isinstance(line.first(), Scan)
    line.node.inject(RigFault(kind="corrupt", target="scanner"))
    while not isinstance(line.first(), TelegramError):
        pass
    line.node.inject(RigFault(kind="corrupt", target="scanner", on=False))
    while not isinstance(line.first(), Scan):
        pass


def test_a_scanner_that_falls_silent_is_dialled_again(line: Line) -> None:
    assert isinstance(line.first(), Scan)
    line.node.inject(RigFault(kind="silence", target="scanner"))
    while not any("silent: dialling again" in words for words in line.said):
        list(line.client.scans())
    line.node.inject(RigFault(kind="silence", target="scanner", on=False))
    while line.client.connections < 2:
        list(line.client.scans())
    assert isinstance(line.first(), Scan | TelegramError)
