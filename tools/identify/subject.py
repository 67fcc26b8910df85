"""The arm of a cell whose sensor is identified."""

from typing import NamedTuple

from ...config.errors import ConfigError, nearest
from ...config.load import Cell


class Subject(NamedTuple):
    """One arm: its part of the cell, and where commands and states have it."""

    part: Cell
    mechanism: str | None
    """Name for commands; None for the only one."""
    task: str | None
    joints: slice
    """Its joints among all of the cell."""


def subject_of(cell: Cell, mechanism: str | None) -> Subject:
    """Return the mechanism of that name, or the only one. Raises `ConfigError`."""
    parts = cell.parts
    names = [part.config.mechanism.name for part in parts]
    if mechanism is None:
        if len(parts) > 1:
            known = ", ".join(names)
            raise ConfigError(f"{cell.path}: mechanisms: say which: --mechanism, one of {known}")
        return Subject(cell, None, None, slice(None))
    if mechanism not in names:
        hint = nearest(mechanism, names)
        raise ConfigError(f"{cell.path}: mechanisms: '{mechanism}': no such mechanism{hint}")
    i = names.index(mechanism)
    first = sum(len(part.robot.joints) for part in parts[:i])
    joints = slice(first, first + len(parts[i].robot.joints))
    return Subject(parts[i], mechanism, parts[i].task, joints)
