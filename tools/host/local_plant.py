"""Processes of a cell on this machine: rig, daemon, page, recorder."""

import ctypes
import math
import os
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType
from typing import Any, Self

from ...config.errors import printable
from ...config.load import Cell
from .address import moved, options
from .machine import free_port

# --- Private plant on this machine: rig and daemon as processes, apart from any other -------------
CLI = f"{__package__.removesuffix('.host')}.cli"
POLL_S = 0.02
TERMINATE_S = 8.0  # a child that was asked to end is killed after [s]

AT_ONCE_S = 20.0  # a child that ends within this time of its second start is not started again [s]

_PR_SET_PDEATHSIG = 1  # linux/prctl.h
_libc = ctypes.CDLL(None)


class ChildDied(Exception):
    """Rig or daemon ended by itself, or did not do its part in time."""


class LocalPlant:
    """Rig and daemon of a cell, on a private multicast group and endpoint; a context manager.

    With an `endpoint` the daemon listens there instead. A cell with cameras or a laser scanner has
    the process that looks through it, too. All are ended on the way out, by their own process ids,
    and by the kernel should this process vanish. What they wrote to stderr is kept for
    `complaints`.
    """

    def __init__(
        self,
        cell: Cell,
        statistics: Path | None = None,
        boxes: Path | None = None,
        endpoint: str | None = None,
    ) -> None:
        """Build it; the daemon's black boxes go to `boxes`, None: they are not kept."""
        self._boxes = boxes
        self.cell = private(cell, endpoint)
        self.rig_endpoint = self.cell.config.zenoh.endpoint
        """Endpoint of the rig's faults and truth: the daemon's router by default."""
        self.rig: subprocess.Popen[bytes] | None = None
        self.daemon: subprocess.Popen[bytes] | None = None
        self.vision: subprocess.Popen[bytes] | None = None
        self.scan: subprocess.Popen[bytes] | None = None
        self.console: subprocess.Popen[bytes] | None = None
        self._statistics = statistics
        self._page: tuple[list[str], dict[str, str]] = ([], {})
        self._started_s: dict[str, float] = {}
        self._folder = tempfile.TemporaryDirectory()
        self._errors: list[tuple[str, Path]] = []

    def __enter__(self) -> Self:
        self.start_rig()
        self.start_daemon()
        if self.cell.cameras:
            self.start_vision()
        if self.cell.config.scanner is not None and self.cell.config.contour is not None:
            self.start_scan()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self._folder.cleanup()

    def start_rig(self) -> None:
        """Start the virtual hardware."""
        self.rig = self._start("rig", moved(self.cell, endpoint=self.rig_endpoint), [])

    def start_daemon(self) -> None:
        statistics = [] if self._statistics is None else [f"--statistics={self._statistics}"]
        boxes = f"--blackbox={self._boxes or self._folder.name}"
        self.daemon = self._start("serve", self.cell, [*statistics, boxes, "--log=off"])

    def start_vision(self) -> None:
        """Start looking through the cell's cameras. A machine that can't goes on without."""
        self.vision = self._start("vision", self.cell, [])

    def start_scan(self) -> None:
        """Start looking through the cell's laser scanner."""
        self.scan = self._start("scan", self.cell, [])

    def start_console(self, arguments: list[str], environment: dict[str, str]) -> None:
        """Start the operators' page, by further arguments and environment variables."""
        self._page = (arguments, environment)
        self.console = self._start("console", self.cell, arguments, environment)

    def revive(self, say: Callable[[str], None]) -> None:
        """Start again what has ended, and say so. Raises `ChildDied` for what ends at once."""
        starts = (
            ("rig", self.rig, self.start_rig),
            ("daemon", self.daemon, self.start_daemon),
            ("console", self.console, lambda: self.start_console(*self._page)),
        )
        for name, child, start in starts:
            code = None if child is None else child.poll()
            if code is None:
                continue
            now_s = time.monotonic()
            if now_s - self._started_s.get(name, -math.inf) < AT_ONCE_S:
                raise ChildDied(f"the {name} ended with code {code}, again")
            self._started_s[name] = now_s
            say(f"the {name} ended with code {code}: it is started again")
            start()

    def answers(self) -> bool:
        """Return whether somebody listens on the daemon's endpoint."""
        host, _, port = self.cell.config.zenoh.endpoint.partition("/")[2].rpartition(":")
        return listens(int(port), host)

    def raise_if_dead(self) -> None:
        """Raise `ChildDied` when the rig or the daemon has ended."""
        for name, child in (("rig", self.rig), ("daemon", self.daemon)):
            code = None if child is None else child.poll()
            if code is not None:
                raise ChildDied(f"the {name} ended with code {code}")

    def wait(self, done: Callable[[], bool], within_s: float, otherwise: str) -> None:
        """Wait until something holds. Raises `ChildDied`, with `otherwise` when time is up."""
        deadline_s = time.monotonic() + within_s
        while not done():
            self.raise_if_dead()
            if time.monotonic() > deadline_s:
                raise ChildDied(f"{otherwise} after {within_s:g} s")
            time.sleep(POLL_S)

    def stop(self) -> bool:
        """End all, the daemon first so that it stops the arm.

        Return whether rig and daemon ended well; pictures are something to do without.
        """
        for child in (self.console, self.vision, self.scan):
            if child is not None:
                end(child)
        codes = [end(child) for child in (self.daemon, self.rig) if child is not None]
        return all(code == 0 for code in codes)

    def complaints(self) -> str:
        """Return what the children wrote to stderr, each line with the name of its writer."""
        lines = []
        for name, path in self._errors:
            text = path.read_text(encoding="utf-8", errors="replace")
            lines += [printable(f"{name}: {line}") + "\n" for line in text.splitlines()]
        return "".join(lines)

    def _start(
        self, command: str, cell: Cell, extra: list[str], environment: dict[str, str] | None = None
    ) -> "subprocess.Popen[bytes]":
        arguments = options(cell, bus=command != "console")
        path = Path(self._folder.name) / f"{len(self._errors)}-{command}"
        self._errors.append((command, path))
        with path.open("wb") as errors:
            variables = {**os.environ, **(environment or {})}
            return _child(command, *arguments, *extra, env=variables, stdout=errors, stderr=errors)


def _child(*arguments: str, **how: Any) -> "subprocess.Popen[bytes]":
    """Start a command as a process of its own, which ends with this one."""
    return subprocess.Popen(
        [sys.executable, "-m", CLI, *arguments],
        stdin=subprocess.DEVNULL,
        start_new_session=True,  # a ^C at the terminal is ours to pass on, in order
        preexec_fn=end_with_parent,  # noqa: PLW1509  one system call, takes no lock
        **how,
    )


def private(cell: Cell, endpoint: str | None = None) -> Cell:
    """Return a cell on a multicast group, ports and an endpoint that nobody else uses.

    With an `endpoint`, the daemon listens there.
    """
    zenoh = cell.config.zenoh.model_copy(update={"router": None})
    cell = replace(cell, config=cell.config.model_copy(update={"zenoh": zenoh}))
    protocol = "tcp" if zenoh.security.directory is None else "tls"
    group = f"239.{74 + secrets.randbelow(100)}.{secrets.randbelow(256)}.{secrets.randbelow(256)}"
    names = [bus.name for bus in cell.config.fieldbuses]
    return moved(
        cell,
        endpoint=endpoint or f"{protocol}/127.0.0.1:{free_port(socket.SOCK_STREAM)}",
        channels=[f"{name}={group}" for name in names],
        ports=[f"{name}={free_port(socket.SOCK_DGRAM)}" for name in names],
        scanner=None
        if cell.config.scanner is None
        else f"tcp/127.0.0.1:{free_port(socket.SOCK_STREAM)}",
    )


def end(child: "subprocess.Popen[bytes]") -> int:
    """Ask a process to end, kill it if it does not; return its exit code."""
    if child.poll() is None:
        child.terminate()
        try:
            child.wait(TERMINATE_S)
        except subprocess.TimeoutExpired:
            child.kill()
    return child.wait()


def end_with_parent() -> None:
    """Ask the kernel to end this process with its parent; for a child before it begins."""
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def listens(port: int, host: str = "127.0.0.1") -> bool:
    """Return whether somebody listens on a TCP port."""
    try:
        socket.create_connection((host, port), timeout=1.0).close()
    except OSError:
        return False
    return True


# --- A recorder beside a cell's daemon, as a process of its own -----------------------------------
@contextmanager
def recording(cell: Cell, folder: Path | None) -> Iterator[None]:
    """Record a cell into a folder meanwhile; for None, do not."""
    if folder is None:
        yield
        return
    child = _child("record", *options(cell), f"--out={folder}")
    try:
        yield
    finally:
        end(child)


# --- End of a process that runs until it is told to, or for a while -------------------------------
def until_told(seconds: float | None) -> Callable[[], bool]:
    """Return a function that is True once SIGTERM or SIGINT came, or `seconds` have passed.

    From here on the two signals end nothing by themselves; None: only they count.
    """
    asked: list[int] = []

    def on_signal(number: int, _frame: FrameType | None) -> None:
        asked.append(number)

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, on_signal)
    end_s = None if seconds is None else time.monotonic() + seconds

    def over() -> bool:
        return bool(asked) or (end_s is not None and time.monotonic() > end_s)

    return over
