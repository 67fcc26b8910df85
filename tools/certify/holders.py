"""Holders of certificates: those named on the command line, and those of every cell."""

import argparse
import ipaddress
import re
import socket
from dataclasses import dataclass
from typing import Final

from ...config.load import Cell
from ...drivers.network.certificates import AUTHORITY, certificate, issued
from ...protocols.roles import Grant
from ...protocols.topics import SENSORS, Role
from .authority import Authority


@dataclass(frozen=True)
class Holder:
    """Holder of a certificate, and its role."""

    name: str
    """The common name."""
    grants: frozenset[Grant]
    hosts: frozenset[str] = frozenset()


SCAN: Final = "scan"
"""`telerobot scan`, which asks for a certificate of that name."""
SCANS: Final = ("contour", "obstacle")
"""Keys that it puts on: a scanner tells of obstacles, too."""


def named(cells: list[Cell], args: argparse.Namespace) -> list[Holder]:
    """Return whom the arguments name, and what every cell has: its daemon, its virtual hardware.

    Without a name, one of each role that the cells can use.
    """
    names = [cell.config.name for cell in cells]
    here, given = frozenset(_own_hosts()), frozenset(args.host)
    made = []
    for cell, name in zip(cells, names, strict=True):
        # Behind a router a daemon is not dialled: the hosts are the router's.
        hosts = here | _listening(cell) | (frozenset() if args.router else given)
        made.append(Holder(f"{Role.DAEMON}-{name}", frozenset({Grant(name, Role.DAEMON)}), hosts))
        if cell.config.rig is not None:
            made += _virtual(name)
    operators, observers, sensors = args.operator, args.observer, args.sensor
    if not (operators or observers or sensors or args.router):
        operators, observers = ["operator"], ["observer"]
        sensors = [(key, (f"sensor/{key}",)) for key in _used(cells)]
        if any(cell.config.scanner is not None for cell in cells):
            sensors.append((SCAN, tuple(f"sensor/{key}" for key in SCANS)))
    for role, each in ((Role.OPERATOR, operators), (Role.OBSERVER, observers)):
        made += [
            Holder(f"{role}-{who}", frozenset(Grant(cell, role) for cell in names)) for who in each
        ]
    for who, keys in sensors:
        grants = frozenset(Grant(cell, Role.SENSOR, key) for cell in names for key in keys)
        made.append(Holder(f"{Role.SENSOR}-{who}", grants))
    if args.router:
        grants = frozenset(Grant(cell, Role.ROUTER) for cell in names)
        made.append(Holder(f"{Role.ROUTER}-{args.router}", grants, here | given))
    return made


def standing(authority: Authority, cells: set[str], hosts: frozenset[str]) -> list[Holder]:
    """Return whom an authority certified for any of the cells; servers with more hosts."""
    paths = (path for path in authority.folder.glob("*.crt") if path.stem != AUTHORITY)
    every = [certificate(issued(path, authority.own)) for path in sorted(paths)]
    return [
        Holder(one.name, frozenset(one.grants), one.hosts | (hosts if one.serves else frozenset()))
        for one in every
        if cells.intersection(grant.cell for grant in one.grants)
    ]


def _virtual(cell: str) -> list[Holder]:
    """Return a cell's rig, whose sensors tell of frames, and the one who plays all parts there."""
    rig = {Grant(cell, Role.RIG), Grant(cell, Role.SENSOR, "sensor/frame")}
    judge = {Grant(cell, Role.JUDGE), Grant(cell, Role.OPERATOR)}
    judge |= {Grant(cell, Role.SENSOR, topic.key) for topic in SENSORS}
    return [
        Holder(f"{Role.RIG}-{cell}", frozenset(rig)),
        Holder(f"{Role.JUDGE}-{cell}", frozenset(judge)),
    ]


def _used(cells: list[Cell]) -> list[str]:
    """Return the keys on which sensors of these cells put."""
    used = {
        "vision": any(cell.config.cameras for cell in cells),
        "obstacle": any(cell.config.keeps_clear for cell in cells),
        "frame": any(cell.config.frames.moving for cell in cells),
    }
    return [key for key in sensor_keys() if used.get(key)]


def _own_hosts() -> tuple[str, ...]:
    host = socket.gethostname().lower()
    return ("localhost", "127.0.0.1", "::1", *([host] if is_host(host) else []))


def _listening(cell: Cell) -> frozenset[str]:
    """Return the host at which a cell's daemon listens, where it is one to dial."""
    host = cell.config.zenoh.listen.partition("/")[2].rpartition(":")[0].strip("[]")
    return frozenset() if host in ("0.0.0.0", "::") or not is_host(host) else frozenset({host})


def is_host(host: str) -> bool:
    """Return whether a text is a host's name, in small letters, or its address."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        label = r"[a-z0-9]([a-z0-9-]{0,61}[a-z0-9])?"
        return len(host) <= 253 and re.fullmatch(rf"{label}(\.{label})*", host) is not None
    return True


def sensor_keys() -> list[str]:
    """Return the keys that sensors put on, by their last part."""
    return [topic.key.removeprefix("sensor/") for topic in SENSORS]
