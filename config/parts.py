"""Several mechanisms in one cell file: what it says of each alone.

A part is what the file would say with that mechanism alone: the mechanism, which may be `like` that
of another cell, with what that cell says of how it moves; on top of it what this file says for all;
on top of that what it says for the task that the mechanism has.
"""

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any, Final

from .errors import ConfigError, nearest
from .joint_tasks import SHARED, is_joint

MOST: Final = 8
"""Mechanisms in one cell [1]."""

OF_A_MECHANISM: Final = (
    "T_world_crf", "potential", "priority", "redundancy", "reflection", "resolve", "schedules",
    "sources", "torque", "touch",
)  # fmt: skip
"""Sections that come along with the mechanism of another cell."""

OF_ITS_RIG: Final = (
    "drive", "force_torque", "tool_radius", "payload_mass", "payload_com", "gripper", "peg",
)  # fmt: skip
"""What comes along of its virtual hardware."""

OF_A_TASK: Final = ("T_world_crf", "reflection", "schedules", "sources")
"""Sections that a task may have of its own."""

Document = dict[str, Any]
Whole = Callable[[object, Path, str], Document]
"""Reads another cell's file: its name or path, the folder that a path starts from, and who asks."""


def parts_of(path: Path, document: Document, whole: Whole) -> list[tuple[str, Document]]:
    """Return what a file with `[[mechanisms]]` says of each, as a file with `[mechanism]` would.

    Each comes with the name of its task.

    Raises `ConfigError`.
    """
    document = dict(document)
    if "mechanism" in document:
        raise ConfigError(f"{path}: mechanisms: there is [mechanism] too: give one of both")
    entries = _tables(path, "mechanisms", document.pop("mechanisms"))
    if not 1 <= len(entries) <= MOST:
        raise ConfigError(f"{path}: mechanisms: {len(entries)} tables: must be 1 to {MOST}")
    names = _names(path, "mechanisms", entries)
    if len(names) > 1:
        # Several arms keep clear of each other, unless the file says otherwise.
        document = on_top({"avoidance": {"enabled": True}}, document)
    tasks = _tasks(path, _tables(path, "tasks", document.pop("tasks", [])), names)
    parts = []
    for i, (name, entry) in enumerate(zip(names, entries, strict=True)):
        own = {key: value for key, value in entry.items() if key != "like"}
        under = _alike(whole, entry["like"], path, i) if "like" in entry else {}
        part = on_top(on_top(under, document), {"mechanism": own})
        task, sections = tasks.get(name, (name, {}))
        parts.append((task, on_top(part, sections)))
    return parts


def joint_tables_of(path: Path, document: Document) -> list[tuple[int, Document]]:
    """Return the tables of tasks that several mechanisms hold, each with its place in the file.

    Raises `ConfigError`.
    """
    shared: Document = {key: document[key] for key in SHARED if key in document}
    tables = _tables(path, "tasks", document.get("tasks", []))
    return [(i, on_top(shared, table)) for i, table in enumerate(tables) if is_joint(table)]


def on_top(under: Document, over: Document) -> Document:
    """Return two documents as one, key by key; any value but a table takes the other's place."""
    both = dict(under)
    for key, other in (("bus", "buses"), ("buses", "bus")):
        if key in over:
            both.pop(other, None)  # one takes the other's place, too
    for key, value in over.items():
        if isinstance(value, dict) and isinstance(both.get(key), dict):
            both[key] = on_top(both[key], value)
        else:
            both[key] = value
    return both


def _alike(whole: Whole, name: object, path: Path, i: int) -> Document:
    """Return what comes along with the mechanism of another cell."""
    where = f"{path}: mechanisms[{i}].like: "
    other = whole(name, path.parent, where)
    if not isinstance(other.get("mechanism"), dict):
        raise ConfigError(f"{where}value '{name}': a cell with [mechanism] is needed")
    found: Document = {key: other[key] for key in ("mechanism", *OF_A_MECHANISM) if key in other}
    rig = other.get("rig")
    if isinstance(rig, dict):
        found["rig"] = {key: rig[key] for key in OF_ITS_RIG if key in rig}
    return deepcopy(found)


def _tasks(
    path: Path, tables: list[Document], mechanisms: list[str]
) -> dict[str, tuple[str, Document]]:
    """Return the name and own sections of each mechanism's task, where the file has one."""
    found: dict[str, tuple[str, Document]] = {}
    for i, (name, table) in enumerate(zip(_names(path, "tasks", tables), tables, strict=True)):
        if is_joint(table):
            continue
        where = f"{path}: tasks[{i}]"
        by = table.get("by", [name])
        if not isinstance(by, list) or len(by) != 1 or not isinstance(by[0], str):
            raise ConfigError(f"{where}.by: value {by!r}: a list with the name of one mechanism")
        if by[0] not in mechanisms:
            hint = nearest(by[0], mechanisms)
            raise ConfigError(f"{where}.by: value '{by[0]}': no such mechanism{hint}")
        if by[0] in found:
            raise ConfigError(f"{where}.by: value '{by[0]}': has another task already")
        for key in table:
            if key not in ("name", "by", *OF_A_TASK):
                hint = nearest(key, ("name", "by", *OF_A_TASK))
                raise ConfigError(f"{where}.{key}: unknown key{hint}")
        found[by[0]] = name, {key: table[key] for key in OF_A_TASK if key in table}
    return found


def _tables(path: Path, key: str, value: object) -> list[Document]:
    if not isinstance(value, list) or not all(isinstance(x, dict) for x in value):
        raise ConfigError(f"{path}: {key}: must be tables: [[{key}]]")
    return value


def _names(path: Path, key: str, tables: list[Document]) -> list[str]:
    names: list[str] = []
    for i, table in enumerate(tables):
        name = table.get("name")
        if not isinstance(name, str):
            raise ConfigError(f"{path}: {key}[{i}].name: missing: its name")
        if name in names:
            raise ConfigError(f"{path}: {key}[{i}].name: value '{name}': is there already")
        names.append(name)
    return names
