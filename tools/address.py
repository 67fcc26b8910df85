"""Where a cell's bus and daemon are to be found, and how the command line moves them.

Two demos, or a test beside a running daemon, share a machine when each has a multicast group and
an endpoint of its own; everything else about the cell stays what its file says.
"""

import argparse
import math
from dataclasses import replace

from pydantic import BaseModel, ValidationError

from ..config.load import Cell, ConfigError, load_cell


def duration(text: str) -> float:
    """Return a duration from the command line [s]; it is positive and finite."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not 0.0 < seconds < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of seconds above 0")
    return seconds


def add_cell_arguments(parser: argparse.ArgumentParser, bus: bool = True) -> None:
    """Describe CELL and the options that move it; without `bus`, only the endpoint."""
    parser.add_argument(
        "cell", metavar="CELL", help="path of a cell file, or a shipped cell's name"
    )
    parser.add_argument(
        "--endpoint",
        metavar="tcp/HOST:PORT",
        help="where the daemon listens, instead of the cell's zenoh.listen",
    )
    if bus:
        parser.add_argument(
            "--channel", help="CAN channel or multicast group, instead of the cell's bus.channel"
        )
        parser.add_argument(
            "--port", type=int, help="UDP port of a loopback bus, instead of the cell's bus.port"
        )


def cell_from(args: argparse.Namespace) -> Cell:
    """Return the cell that the arguments name, moved as they say. Raises `ConfigError`."""
    return moved(
        load_cell(args.cell),
        endpoint=args.endpoint,
        channel=getattr(args, "channel", None),
        port=getattr(args, "port", None),
    )


def moved(
    cell: Cell,
    endpoint: str | None = None,
    channel: str | None = None,
    port: int | None = None,
) -> Cell:
    """Return a cell with another endpoint, channel or port. Raises `ConfigError`."""
    config = cell.config
    bus = _with(config.bus, channel=channel, port=port)
    zenoh = _with(config.zenoh, listen=endpoint)
    return replace(cell, config=config.model_copy(update={"bus": bus, "zenoh": zenoh}))


def options(cell: Cell) -> list[str]:
    """Return the arguments that lead another process to this cell."""
    bus = cell.config.bus
    return [
        str(cell.path),
        f"--endpoint={cell.config.zenoh.listen}",
        f"--channel={bus.channel}",
        f"--port={bus.port}",
    ]


def _with(section: BaseModel, **changes: object) -> BaseModel:
    given = {key: value for key, value in changes.items() if value is not None}
    try:
        return type(section).model_validate({**section.model_dump(), **given})
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigError(f"--{first['loc'][0]}: value {first['input']}: {first['msg']}") from None
