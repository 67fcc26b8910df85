"""`telerobot rig CELL`: the virtual hardware of a cell, at the pace of the wall clock."""

import argparse
import os
import sys

from ...config.load import ConfigError
from ...drivers.bus import CanBus, open_bus
from ...drivers.network.identity import identity_of
from ...drivers.rig.realtime import refuse_second, run_realtime
from ...drivers.rig.rig import Rig
from ...drivers.rig.session import RigSession, serve_scanner
from ...protocols.topics import Role
from ...server.control import compilation
from ...server.process import PRIORITY as DAEMON
from ...server.process import settle
from ..host.address import cell_from
from ..host.local_plant import until_told
from ..host.progress import sparing
from ..simulation.frame_sensors import FrameSensors

PRIORITY = DAEMON + 1
"""SCHED_FIFO priority: hardware answers while a daemon computes, its own or another plant's."""

TOLD_EVERY_S = 1.0  # refused faults and odd frames are told at most so often [s]


def run(args: argparse.Namespace) -> int:
    """Simulate the hardware until told to end. Raises `ConfigError`, `DeviceError`."""
    cell = cell_from(args)
    over = until_told(args.seconds)
    compilation.make_all()
    buses: list[CanBus] = []
    try:
        buses.extend(open_bus(bus) for bus in cell.config.fieldbuses)
        refuse_second(cell, buses)
        try:
            rig = Rig(cell, *buses)
        except ValueError as error:
            raise ConfigError(f"{cell.path}: {error}") from None
        moving = bool(cell.config.frames.moving)
        name = cell.config.name
        identity = identity_of(cell, Role.RIG, name)
        session = RigSession(name, cell.config.zenoh.dialled, identity, frames=moving)
        scanner = serve_scanner(cell, rig)
        try:
            if moving:
                FrameSensors(cell, rig, session.newest_tick, session.tell)
            places = ", ".join(bus.place for bus in cell.config.fieldbuses)
            _prefer()
            print(f"telerobot: the rig of {name} is ready on {places}", flush=True)
            pace = run_realtime(rig, over, session, tell=sparing(TOLD_EVERY_S))
        finally:
            session.close()
            if scanner is not None:
                scanner.close()
    finally:
        for bus in buses:
            bus.shutdown()
    print(f"{pace.steps} steps, {pace.skipped} skipped")
    return 0


def _prefer() -> None:
    """Ask for real-time scheduling, and keep the garbage collector from long pauses.

    Hardware does not slow down because a machine is busy; a rig that is late looks like drives
    that have failed.
    """
    settle()
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except OSError as error:
        print(
            f"telerobot: no real-time scheduling ({error.strerror}): on a busy machine the "
            "virtual drives may miss their deadlines",
            file=sys.stderr,
        )
