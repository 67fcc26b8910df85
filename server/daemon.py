"""The daemon: builds a cell from its config and runs it. The one file that knows every class."""

import os
import platform
import signal
import sys
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from threading import Thread
from types import FrameType

from ..config.bundle import to_text
from ..config.load import Cell
from ..config.schema.network import refuse_exposure
from ..drivers.device import DeviceError
from ..drivers.fieldbus import Fieldbuses, open_buses
from ..drivers.kinds import make_drivers
from ..drivers.network.identity import Identity, identity_of
from ..protocols.proof import random_key
from ..protocols.topics import Role
from .control import compilation
from .control.tick import Control
from .cycle import Cycle
from .events import Level, LogLines, is_journals
from .loop import LoopStatistics, run
from .mode import Mode
from .operators.link import Link, ZenohLink, doubts, exposure
from .plant import Plant
from .process import Clock, MonotonicClock, notify, prepare, release, settle
from .recorder import BlackBox

RETRY_S = 0.5
"""While devices are missing at start, they are looked for again after [s]."""

LISTEN_S = 0.02
"""Meanwhile, what comes in is sorted every [s]."""

RETIRE_S = 3.0
"""A daemon that is asked to end takes at most this long to stop the arm [s]."""


def build(
    cell: Cell,
    buses: Fieldbuses,
    link: Link,
    clock: Clock,
    new_key: Callable[[], bytes],
    box: BlackBox | None = None,
) -> Cycle:
    """Return the cycle of a cell over its buses and an operators' link; no device is open yet."""
    plant = Plant(buses, make_drivers(cell, buses))
    for bus in buses:
        bus.hear_only_known()
    return Cycle(cell, Control.of(cell), plant, link, clock, new_key, box)


class Shutdown:
    """Turns signals and a time limit into an orderly end: stop, switch off, go."""

    def __init__(self, seconds: float | None) -> None:
        self._seconds = seconds
        self._asked = False
        self._since_s: float | None = None
        self._start_s = time.monotonic()
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._on_signal)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self._asked = True

    @property
    def asked(self) -> bool:
        """True once a signal came or time is up."""
        up = self._seconds is not None and time.monotonic() - self._start_s > self._seconds
        return self._asked or up

    def go_on(self, cycle: Cycle) -> bool:
        """Return False once the arm is at rest with its drives off, or takes too long."""
        if not self.asked:
            return True
        if self._since_s is None:
            self._since_s = time.monotonic()
            cycle.retire()
        over = time.monotonic() - self._since_s > RETIRE_S
        off = cycle.mode in (Mode.BOOT, Mode.READY, Mode.FAULT)
        return not (off or over)


def serve(
    cell: Cell, seconds: float | None = None, folder: Path | None = None, level: Level = "off"
) -> LoopStatistics:
    """Run a cell's daemon until it is told to end; return what the loop was like.

    Black boxes go to `folder`; None: none are written. Events of `level` and above go to stderr.

    Raises `ConfigError` for a daemon that anybody could command, `DeviceError` when the bus or
    the endpoint cannot be opened. Devices that are missing are looked for again and again, and so
    is a common router.
    """
    refuse_exposure(cell.config.zenoh, cell.path)
    identity = identity_of(cell, Role.DAEMON, cell.config.name)
    log = LogLines(sys.stderr, level, journal=is_journals(sys.stderr, os.environ))
    try:
        for notice in (*exposure(cell.config.zenoh), *doubts(identity)):
            log.notice(notice)
        compilation.make_all()
        clock, ending = MonotonicClock(), Shutdown(seconds)
        link = _join(cell, identity, clock, ending, log)
        if link is None:
            return LoopStatistics()
        return _run(cell, link, folder, clock, ending, log)
    finally:
        log.close()


def _run(
    cell: Cell,
    link: Link,
    folder: Path | None,
    clock: MonotonicClock,
    ending: Shutdown,
    log: LogLines,
) -> LoopStatistics:
    """Boot the cell's devices and run its loop until it is told to end."""
    box = None
    if folder is not None:
        facts = {"version": metadata.version("telerobot"), "machine": platform.platform()}
        box = BlackBox(folder, cell.config.name, to_text(cell), facts)
    cycle = build(cell, open_buses(cell, clock.now), link, clock, random_key, box)
    cycle.events.taps.append(log.take)
    cycle.publish_ticks()
    try:
        cycle.warm_up()
        for notice in prepare():
            log.notice(notice)
        settling = Thread(target=settle, name="settling")
        settling.start()  # beside the devices' boot, which waits more than it works
        booted = _boot(cycle, clock, ending, log)
        settling.join()
        if not booted:
            return LoopStatistics()
        print(f"telerobot: {cell.config.name} is ready at {cell.config.zenoh.endpoint}", flush=True)
        notify("READY=1")
        return run(cycle, clock, cell.config.timing.period_s, ending.go_on)
    finally:
        notify("STOPPING=1")
        cycle.close()
        release()


def _join(
    cell: Cell,
    identity: Identity | None,
    clock: MonotonicClock,
    ending: Shutdown,
    log: LogLines,
) -> Link | None:
    """Open the operators' network, however long a common router takes to appear.

    Return None when told to end.
    """
    zenoh = cell.config.zenoh
    told = False
    while not ending.asked:
        try:
            return ZenohLink(cell.config.name, zenoh.endpoint, identity, zenoh.router is not None)
        except DeviceError as error:
            if zenoh.router is None:
                raise
            if not told:
                log.notice(f"waiting: {error}")
            told = True
            clock.sleep_until(clock.now() + RETRY_S)
    return None


def _boot(cycle: Cycle, clock: MonotonicClock, ending: Shutdown, log: LogLines) -> bool:
    """Open the devices, however long they take to appear; return False when told to end."""
    told = ""
    while not ending.asked:
        try:
            cycle.boot()
        except DeviceError as error:
            if str(error) != told:
                told = str(error)
                log.notice(f"waiting: {told}")
            cycle.wait_in_boot(str(error))
            again_s = clock.now() + RETRY_S
            while clock.now() < again_s:  # what comes in meanwhile must not pile up
                clock.sleep_until(clock.now() + LISTEN_S)
                cycle.listen()
        else:
            return True
    return False
