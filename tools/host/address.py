"""Addresses of a cell's bus, scanner and daemon, and their overrides on the command line.

Two demos, or a test beside a running daemon, share a machine when each has a multicast group, a
scanner's port and an endpoint of its own; everything else about the cell stays what its file says.
"""

import argparse
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from ...config.load import Cell, ConfigError, load_cell
from ...config.schema.network import SecuritySection, ZenohSection
from ...config.schema.surroundings import ScannerSection

SectionT = TypeVar("SectionT", bound=BaseModel)


def cell_from(args: argparse.Namespace) -> Cell:
    """Return the cell that the arguments name, moved as they say. Raises `ConfigError`."""
    return moved(
        load_cell(args.cell),
        endpoint=args.endpoint,
        identity=args.identity,
        channels=getattr(args, "channel", None) or (),
        ports=getattr(args, "port", None) or (),
        scanner=getattr(args, "scanner", None),
    )


def moved(
    cell: Cell,
    endpoint: str | None = None,
    channels: Iterable[str] = (),
    ports: Iterable[str] = (),
    identity: str | Path | None = None,
    scanner: str | None = None,
) -> Cell:
    """Return a cell with another endpoint, identity, scanner, and channels and ports of its buses.

    Each of the last is a value, or `BUS=value` where there are several buses. Raises `ConfigError`.
    """
    config = cell.config
    buses = {bus.name: bus for bus in config.fieldbuses}
    for key, texts in (("channel", channels), ("port", ports)):
        for text in texts:
            name, value = _addressed(key, text, tuple(buses))
            buses[name] = _with(buses[name], **{key: value})
    zenoh = _with(config.zenoh, **{config.zenoh.key: endpoint})
    if identity is not None:
        security = SecuritySection(directory=str(Path(identity).absolute()))
        zenoh = zenoh.model_copy(update={"security": security})
    moved_to: dict[str, object] = {"zenoh": zenoh}
    moved_to |= {"buses": tuple(buses.values())} if config.buses else {"bus": buses["bus"]}
    if scanner is not None:
        if config.scanner is None:
            raise ConfigError(f"--scanner: value {scanner}: the cell has no scanner")
        moved_to["scanner"] = _with(config.scanner, address=scanner)
    return replace(cell, config=config.model_copy(update=moved_to))


def options(cell: Cell, bus: bool = True) -> list[str]:
    """Return the arguments that lead another process to this cell; without `bus`, an operator."""
    zenoh = cell.config.zenoh
    folder = zenoh.security.directory
    buses = cell.config.fieldbuses if bus else ()
    scanner = cell.config.scanner if bus else None
    return [
        str(cell.path),
        f"--endpoint={zenoh.endpoint}",
        *(f"--channel={bus.name}={bus.channel}" for bus in buses),
        *(f"--port={bus.name}={bus.port}" for bus in buses),
        *([] if scanner is None else [f"--scanner={scanner.address}"]),
        *([] if folder is None else [f"--identity={cell.path.parent / folder}"]),
    ]


def _addressed(key: str, text: str, names: tuple[str, ...]) -> tuple[str, str]:
    """Return the bus that an option is about, and the value."""
    name, equals, value = text.partition("=")
    if len(names) == 1 and name not in names:
        return names[0], text
    if not equals or name not in names:
        listed = ", ".join(names)
        raise ConfigError(f"--{key}: value {text}: write BUS={key.upper()}; buses: {listed}")
    return name, value


_OPTIONS: dict[type[BaseModel], str] = {ZenohSection: "endpoint", ScannerSection: "scanner"}
"""The option of a section of which one alone changes."""


def _with(section: SectionT, **changes: object) -> SectionT:
    given = {key: value for key, value in changes.items() if value is not None}
    try:
        return type(section).model_validate({**section.model_dump(), **given})
    except ValidationError as error:
        first = error.errors()[0]
        option = _OPTIONS.get(type(section), first["loc"][0])
        raise ConfigError(f"--{option}: value {first['input']}: {first['msg']}") from None
