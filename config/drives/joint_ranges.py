"""One `[[mechanism.drives]]` table for several joints: `joint = "j1..j15"`, nodes counted on."""

import re
from pathlib import Path
from typing import Final

from ..errors import ConfigError
from ..schema.cell import CellConfig
from ..schema.mechanism.mechanism import MOST_DRIVES, DriveSection

HIGHEST_NODE: Final = 126
"""The daemon's own is the next one."""
_RANGE: Final = re.compile(r"([A-Za-z][A-Za-z0-9_-]*?)(\d+)\.\.([A-Za-z][A-Za-z0-9_-]*?)(\d+)")


def expand(path: Path, config: CellConfig, place: str) -> CellConfig:
    """Return the configuration with one drive for each joint; the mechanism stands at `place`.

    Raises `ConfigError`.
    """
    drives: list[DriveSection] = []
    for i, drive in enumerate(config.mechanism.drives):
        drives += _joints_of(f"{path}: {place}.drives[{i}]", i, drive)
    if len(drives) > MOST_DRIVES:
        raise ConfigError(f"{path}: {place}.drives: {len(drives)} joints, at most {MOST_DRIVES}")
    mechanism = config.mechanism.model_copy(update={"drives": tuple(drives)})
    return config.model_copy(update={"mechanism": mechanism})


def _joints_of(where: str, index: int, drive: DriveSection) -> list[DriveSection]:
    """Return the drives that a table means, in the order of counting."""
    names = [drive.joint] if ".." not in drive.joint else _names(where, drive.joint)
    last = drive.node + len(names) - 1
    if len(names) > 1 and last > HIGHEST_NODE:
        raise ConfigError(
            f"{where}.node: value {drive.node}: joints {drive.joint} need nodes up to "
            f"{last}; must be at most {HIGHEST_NODE}"
        )
    return [drive.of_table(index, name, drive.node + k) for k, name in enumerate(names)]


def _names(where: str, text: str) -> list[str]:
    match = _RANGE.fullmatch(text)
    stem, low, other, high = match.groups() if match else ("", "1", "", "0")
    count = int(high[:9]) - int(low[:9]) + 1
    if stem != other or not 1 <= count <= MOST_DRIVES or len(high) > 9:
        raise ConfigError(
            f"{where}.joint: value '{text}': a range counts up by at most {MOST_DRIVES} joints of "
            "one name, as 'j1..j15' does"
        )
    width = len(low) if low.startswith("0") else 0
    return [f"{stem}{int(low) + k:0{width}d}" for k in range(count)]
