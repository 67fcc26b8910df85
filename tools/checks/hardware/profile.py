"""Rules of CiA 301 and CiA 402-2 tried on one drive: `telerobot check CELL --profile JOINT`."""

from collections.abc import Callable, Iterator
from typing import Final

from ....config.errors import ConfigError
from ....config.load import Cell
from ....config.schema.bus import Entry
from ....config.schema.mechanism import DriveSection
from ....drivers.fieldbus import open_buses
from ..findings import Finding, Severity
from .rule import RuleOutcome
from .trial import try_drive

STATUS: Final = {
    RuleOutcome.KEPT: Severity.OK,
    RuleOutcome.ABSENT: Severity.WARN,
    RuleOutcome.BROKEN: Severity.ERROR,
}


def drive_named(cell: Cell, joint: str) -> Entry:
    """Return the drive of a joint. Raises `ConfigError`."""
    drives = {e.name: e for e in cell.devices if isinstance(e.section, DriveSection)}
    if joint not in drives:
        raise ConfigError(f"{cell.path}: no drive moves {joint!r}; one of {', '.join(drives)}")
    return drives[joint]


def profile(
    cell: Cell, joint: str, clock: Callable[[], float], *, power: bool
) -> Iterator[Finding]:
    """Try every rule on the drive of a joint, which stands. Raises `DeviceError`."""
    entry = drive_named(cell, joint)
    node = entry.section.node if isinstance(entry.section, DriveSection) else 0
    buses = open_buses(cell, clock)
    try:
        names = [config.name for config in cell.config.fieldbuses]
        fieldbus = buses[names.index(entry.bus)]
        for verdict in try_drive(fieldbus, node, power=power):
            text = verdict.rule.promise
            if verdict.detail:
                text += f": {verdict.detail}"
            values = {"outcome": verdict.outcome.value}
            yield Finding(verdict.rule.clause, STATUS[verdict.outcome], text, values)
    finally:
        buses.close()
