"""`telerobot rig CELL`: the virtual hardware of a cell, at the pace of the wall clock."""

import argparse
import math
import signal
import sys
import time
from types import FrameType

from ..config.load import ConfigError
from ..drivers.bus import open_bus
from ..drivers.device import DeviceError
from ..drivers.rig.realtime import run_realtime
from ..drivers.rig.rig import Rig, RigError
from ..drivers.rig.session import RigSession
from .address import add_cell_arguments, cell_from


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    add_cell_arguments(parser)
    parser.add_argument("--seconds", type=float, help="end by itself after this long")


def run(args: argparse.Namespace) -> int:
    """Simulate the hardware until told to end. Raises `ConfigError`, `DeviceError`."""
    cell = cell_from(args)
    asked: list[int] = []

    def on_signal(number: int, _frame: FrameType | None) -> None:
        asked.append(number)

    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, on_signal)
    bus = open_bus(cell.config.bus)
    try:
        try:
            rig = Rig(cell, bus)
        except ValueError as error:
            raise ConfigError(f"{cell.path}: {error}") from None
        session = RigSession(cell.config.name, cell.config.zenoh.listen)
        try:
            end_s = math.inf if args.seconds is None else time.monotonic() + args.seconds
            channel = f"{cell.config.bus.channel}:{cell.config.bus.port}"
            print(f"telerobot: the rig of {cell.config.name} is ready on {channel}", flush=True)
            pace = run_realtime(
                rig,
                lambda: bool(asked) or time.monotonic() > end_s,
                session,
                on_refused=lambda why: print(f"telerobot: fault refused: {why}", file=sys.stderr),
            )
        finally:
            session.close()
    except RigError as error:
        raise DeviceError(str(error)) from None
    finally:
        bus.shutdown()
    print(f"{pace.steps} steps, {pace.skipped} skipped")
    return 0
