"""Check of access to the daemon: roles and validity of certificates."""

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from ...config.load import Cell, ConfigError
from ...config.schema.network import refuse_exposure
from ...drivers.network.certificates import known
from .findings import Finding, Severity


def network(cell: Cell) -> Iterator[Finding]:
    """Judge whether strangers can reach the daemon, and how long the certificates hold."""
    zenoh = cell.config.zenoh
    values: dict[str, str | int | float | bool | None] = {
        "endpoint": zenoh.endpoint,
        "exposed": zenoh.exposed,
    }
    try:
        refuse_exposure(cell.config.zenoh, cell.path)
    except ConfigError as error:
        yield Finding("network", Severity.ERROR, str(error), values)
        return
    if zenoh.exposed:
        text = f"{zenoh.endpoint}: insecure: anybody who reaches it may command"
        yield Finding("network", Severity.WARN, text, values)
    elif zenoh.security.directory is None:
        yield Finding("network", Severity.OK, f"{zenoh.endpoint}: this machine only", values)
    else:
        yield Finding("network", Severity.OK, f"{zenoh.endpoint}: with certificates only", values)
        yield from certificates(cell.path.parent / zenoh.security.directory)


def certificates(folder: Path) -> Iterator[Finding]:
    """Judge the certificates of a folder: how long they hold, and who may read the keys."""
    try:
        good, complaints = known(folder)
    except ConfigError as error:
        text = f"{error}; telerobot certify makes certificates"
        yield Finding("certificates", Severity.WARN, text, {"certificates": 0})
        return
    for complaint in complaints:
        yield Finding("certificates", Severity.WARN, complaint)
    if good and not complaints:
        first = min(good, key=lambda one: one.ends)
        days = (first.ends - datetime.now(UTC)).days
        text = f"{len(good)}, of which {first.name} expires first, on {first.ends:%Y-%m-%d}"
        yield Finding("certificates", Severity.OK, text, {"certificates": len(good), "days": days})
    for key in sorted(folder.glob("*.key")):
        mode = key.stat().st_mode & 0o777
        if mode & 0o077:
            text = f"{key}: others may read it (mode {mode:o}); chmod 600"
            yield Finding("private key", Severity.WARN, text, {"mode": mode})
