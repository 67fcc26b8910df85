"""Where a cell's bus and daemon are to be found, and how the command line moves them.

Two demos, or a test beside a running daemon, share a machine when each has a multicast group and
an endpoint of its own; everything else about the cell stays what its file says.
"""

import argparse
import math
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from ...config.load import Cell, ConfigError, load_cell
from ...config.schema.security import Security, Zenoh

SectionT = TypeVar("SectionT", bound=BaseModel)


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
        help="where the daemon is reached, instead of the cell's zenoh.listen or zenoh.router",
    )
    parser.add_argument(
        "--identity",
        metavar="PATH",
        help="folder of the certificates, or the one to show, without .crt; instead of the cell's "
        "zenoh.security.directory",
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
        identity=args.identity,
        channel=getattr(args, "channel", None),
        port=getattr(args, "port", None),
    )


def moved(
    cell: Cell,
    endpoint: str | None = None,
    channel: str | None = None,
    port: int | None = None,
    identity: str | Path | None = None,
) -> Cell:
    """Return a cell with another endpoint, channel, port or identity. Raises `ConfigError`."""
    config = cell.config
    bus = _with(config.bus, channel=channel, port=port)
    zenoh = _with(config.zenoh, **{config.zenoh.key: endpoint})
    if identity is not None:
        security = Security(directory=str(Path(identity).absolute()))
        zenoh = zenoh.model_copy(update={"security": security})
    return replace(cell, config=config.model_copy(update={"bus": bus, "zenoh": zenoh}))


def options(cell: Cell) -> list[str]:
    """Return the arguments that lead another process to this cell."""
    bus, zenoh = cell.config.bus, cell.config.zenoh
    folder = zenoh.security.directory
    return [
        str(cell.path),
        f"--endpoint={zenoh.endpoint}",
        f"--channel={bus.channel}",
        f"--port={bus.port}",
        *([] if folder is None else [f"--identity={cell.path.parent / folder}"]),
    ]


def _with(section: SectionT, **changes: object) -> SectionT:
    given = {key: value for key, value in changes.items() if value is not None}
    try:
        return type(section).model_validate({**section.model_dump(), **given})
    except ValidationError as error:
        first = error.errors()[0]
        option = "endpoint" if isinstance(section, Zenoh) else first["loc"][0]
        raise ConfigError(f"--{option}: value {first['input']}: {first['msg']}") from None
