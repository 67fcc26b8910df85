"""`telerobot certify`: an authority, and certificates of who may command, tell and listen."""

import argparse
import re
from datetime import UTC, datetime
from pathlib import Path

from ...config.errors import printable
from ...config.load import Cell, ConfigError, load_cell
from ...drivers.network.authority import (
    SCAN,
    SCANS,
    Authority,
    Holder,
    is_host,
    named,
    sensor_keys,
    standing,
    write_router,
)
from ...drivers.network.certificates import Certificate, certificate, issued, read
from ...protocols.roles import NAME

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
        holders = named(cells, args.operator, args.observer, args.sensor, args.router, args.host)
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
        one = certificate(read(path))
        granted = " ".join(grant.uri.partition(":")[2] for grant in one.grants)
        _say(f"{word:<7} {path.with_suffix('')}  until {one.ends:%Y-%m-%d}  {granted}")
    for path in write_router(folder, args.listen, args.router):
        _say(f"wrote {path}  configuration of the router")
    return 0


def _refuse_more(path: Path, there: Certificate, holder: Holder, hosts: frozenset[str]) -> None:
    """Raise `ConfigError` for a certificate that says less than what is asked for."""
    more = sorted(grant.uri for grant in holder.grants.difference(there.grants))
    more += sorted(hosts - there.hosts)
    if more:
        raise ConfigError(f"{path}: does not certify {', '.join(more)}; --renew adds that")


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
