"""What must agree between the parts of a cell: its mechanisms, and the buses that they share."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from ..errors import ConfigError
from ..schema.cell import CellConfig
from ..schema.on_bus import Entry
from .buses import bus_disagreements


def check_cell(
    path: Path, parts: Sequence[tuple[str, CellConfig]], devices: Sequence[Entry]
) -> None:
    """Raise `ConfigError`, of the first disagreement found, naming the file and the key.

    `parts` are the cell's mechanisms: each one's place in the file, and what the file says of it.
    """
    first = next(_disagreements(parts, devices), None)
    if first is not None:
        raise ConfigError(f"{path}: {first}")


def _disagreements(
    parts: Sequence[tuple[str, CellConfig]], devices: Sequence[Entry]
) -> Iterator[str]:
    yield from bus_disagreements(parts, devices)
