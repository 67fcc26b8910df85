"""`telerobot certify`: an authority, and certificates of who may command, tell and listen."""

import argparse
import ipaddress
import re
import socket
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from ...config.errors import printable
from ...config.load import Cell, ConfigError, load_cell
from ...drivers.network.authority import Authority, write_router
from ...drivers.network.certificates import AUTHORITY, Certificate, certificate, issued, read
from ...protocols.roles import NAME, Grant
from ...protocols.topics import SENSORS, Role


# --- Holders of certificates: those named on the command line, and those of every cell ------------
@dataclass(frozen=True)
class Holder:
    """Holder of a certificate, and its role."""

    name: str  # the common name
    grants: frozenset[Grant]
    hosts: frozenset[str] = frozenset()


SCAN: Final = "scan"  # `telerobot scan`, which asks for a certificate of that name
SCANS: Final = ("contour", "obstacle")  # keys that it puts on: a scanner tells of obstacles, too


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


# --- `telerobot certify CELL …`: certificates for those who take part in the cells' network -------


def run(args: argparse.Namespace) -> int:
    """Make what is missing; print what there is. Raises `ConfigError`."""
    cells = [load_cell(name) for name in args.cells]
    folder = args.directory or _folder(cells)
    if args.listen and not args.router:
        raise ConfigError(f"--listen: value '{args.listen}': is a router's; name it by --router")
    now = datetime.now(UTC)
    authority = Authority.of(folder)
    if authority is None:
        authority = Authority.make(folder, now)
        _say(f"made  {folder / 'authority'}  keep its key where nobody else gets at it")
    anybody = args.operator or args.observer or args.sensor or args.router
    if args.renew and not anybody:
        holders = standing(authority, {c.config.name for c in cells}, frozenset(args.host))
    else:
        holders = named(cells, args)
    for holder in holders:
        path = folder / f"{holder.name}.crt"
        there = certificate(issued(path, authority.own)) if path.exists() else None
        if there is not None and not args.renew:
            _refuse_more(path, there, holder, holder.hosts.intersection(args.host))
            word = "kept"
        else:
            old = (frozenset(), frozenset()) if there is None else (there.grants, there.hosts)
            authority.certify(
                holder.name, holder.grants.union(old[0]), holder.hosts.union(old[1]), now, args.days
            )
            word = "made" if there is None else "renewed"
        _tell(word, path, certificate(read(path)))
    for path in write_router(folder, args.listen, args.router):
        _say(f"wrote {path}  configuration of the router")
    return 0


def _refuse_more(path: Path, there: Certificate, holder: Holder, hosts: frozenset[str]) -> None:
    """Raise `ConfigError` for a certificate that says less than what is asked for."""
    more = sorted(grant.uri for grant in holder.grants.difference(there.grants))
    more += sorted(hosts - there.hosts)
    if more:
        raise ConfigError(f"{path}: does not certify {', '.join(more)}; --renew adds that")


def _tell(word: str, path: Path, one: Certificate) -> None:
    granted = " ".join(grant.uri.partition(":")[2] for grant in one.grants)
    _say(f"{word:<7} {path.with_suffix('')}  until {one.ends:%Y-%m-%d}  {granted}")


def _say(line: str) -> None:
    print(printable(line))


def _folder(cells: list[Cell]) -> Path:
    """Return the folder that the cells name. Raises `ConfigError` unless they agree."""
    folders = set()
    for cell in cells:
        named = cell.config.zenoh.security.directory
        if named is None:
            raise ConfigError(f"{cell.path}: zenoh.security.directory: missing; or say --directory")
        folders.add(cell.path.parent / named)
    if len({folder.resolve() for folder in folders}) > 1:
        listed = ", ".join(sorted(str(folder) for folder in folders))
        raise ConfigError(f"zenoh.security.directory: {listed}: one for all cells; say --directory")
    return folders.pop()


def holder(text: str) -> str:
    """Return a name from the command line."""
    if not re.fullmatch(NAME, text):
        raise argparse.ArgumentTypeError(
            f"{text!r} is no name: small letters, digits and _, up to 32"
        )
    return text


def sensor(text: str) -> tuple[str, tuple[str, ...]]:
    """Return a sensor's name and the keys that it may put on, from the command line."""
    name, given, listed = text.partition("=")
    keys = listed.split(",") if given else SCANS if name == SCAN else [name]
    wrong = [key for key in keys if key not in sensor_keys()]
    if wrong:
        raise argparse.ArgumentTypeError(
            f"{wrong[0]!r} is no sensor's key; those are {sensor_keys()}"
        )
    return holder(name), tuple(f"sensor/{key}" for key in keys)


def host_name(text: str) -> str:
    """Return a host's name or address from the command line."""
    if not is_host(text.lower()):
        raise argparse.ArgumentTypeError(f"{text!r} is no host's name or address")
    return text.lower()
