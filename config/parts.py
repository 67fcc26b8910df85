"""Several mechanisms in one cell file: what it says of each alone, and of the tasks they share."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from .errors import ConfigError, nearest, short
from .schema.bus import Entry, OnBusSection
from .schema.cell import CellConfig
from .schema.joint_task import JointTaskSection
from .schema.mechanism import MechanismSection
from .schema.rig import RigSection
from .schema.section import PoseSection, Section
from .urdf.elements import place_at, pose_of, rpy_of
from .urdf.robot import Robot

# --- Tasks that several mechanisms of a cell file hold together, and that they fit the mechanisms

SHARED: Final = ("T_world_crf", "sources", "schedules")
"""Keys that a joint task has of the whole file where it says nothing of its own."""


MOST_SWING: Final = 1.2
"""A payload on its pads is simulated well up to this (ω² dt² + c dt / I) [1]."""


def is_joint(table: dict[str, Any]) -> bool:
    """Return whether a table of `[[tasks]]` is for several mechanisms."""
    by = table.get("by")
    return isinstance(by, list) and len(by) > 1


def agree(
    path: Path, tasks: Sequence[tuple[int, JointTaskSection]], mechanisms: Mapping[str, str]
) -> None:
    """Raise `ConfigError` where joint tasks, each with its place in the file, do not fit the cell.

    `mechanisms` tells by name why each can hold no payload with others, "" where it can. A
    mechanism holds one payload at a time: two tasks at start may not ask for the same.
    """
    holder: dict[str, str] = {}
    for i, task in tasks:
        for k, name in enumerate(task.by):
            where = f"{path}: tasks[{i}].by[{k}]: value '{name}'"
            if name not in mechanisms:
                raise ConfigError(f"{where}: no such mechanism{nearest(name, mechanisms)}")
            if mechanisms[name]:
                raise ConfigError(f"{where}: {mechanisms[name]}")
            if not task.at_start:
                continue
            if name in holder:
                raise ConfigError(f"{where}: holds '{holder[name]}' at start")
            holder[name] = task.name


def unable_to_share(mechanism: MechanismSection) -> str:
    """Return why a mechanism can hold no payload with others; "" where it can."""
    if mechanism.base is not None:
        return "is on wheels: only arms that stand hold a payload with others"
    if mechanism.on is not None or mechanism.torso is not None:
        return "shares joints with others: only arms that stand each on its own hold one together"
    if mechanism.force_torque is None:
        return "has no force_torque sensor to hold a payload by"
    return ""


def agree_with_beam(path: Path, tasks: Sequence[JointTaskSection], rig: RigSection | None) -> None:
    """Raise `ConfigError` where the rig's payload does not fit the task that is to hold it."""
    if rig is None or rig.beam is None:
        return
    beam = rig.beam
    if not tasks:
        raise ConfigError(f"{path}: rig.beam: no task of [[tasks]] is by several mechanisms")
    if len(beam.misfit) not in (0, len(tasks[0].by)):
        raise ConfigError(
            f"{path}: rig.beam.misfit: {len(beam.misfit)} places for {len(tasks[0].by)} mechanisms"
            f" of task '{tasks[0].name}': one each"
        )
    x, y, z = beam.half_size
    least = beam.mass / 3.0 * min(y * y + z * z, x * x + z * z, x * x + y * y)
    pads, step = len(tasks[0].by), rig.physics_step_s
    swing = max(
        pads * (stiffness * step + damping) * step / inertia
        for stiffness, damping, inertia in zip(
            beam.grasp_stiffness, beam.grasp_damping, (beam.mass, least), strict=True
        )
    )
    if swing > MOST_SWING:
        raise ConfigError(
            f"{path}: rig.beam.mass: value {beam.mass:g}: on pads as stiff and damped as these it "
            f"needs {beam.mass * swing / MOST_SWING:.2g} kg, or smaller physics steps"
        )


# --- Several mechanisms in one cell file: what it says of each alone ------------------------------
#
# A part is what the file would say with that mechanism alone: the mechanism, which may be
# `like` that of another cell, with what that cell says of how it moves; on top of it what this
# file says for all; on top of that what it says in the mechanism's own table, and for the task
# that the mechanism has.

MOST: Final = 8
"""Mechanisms in one cell [1]."""

NAME: Final = re.compile(r"[a-z][a-z0-9_]{0,31}")

OF_A_MECHANISM: Final = (
    "T_world_crf", "contour", "potential", "priority", "redundancy", "reflection", "resolve",
    "scanner", "schedules", "sources", "torque", "touch",
)  # fmt: skip
"""Sections that come along with the mechanism of another cell."""

OF_ITS_RIG: Final = (
    "drive", "force_torque", "tool_radius", "payload_mass", "payload_com", "gripper", "peg",
)  # fmt: skip
"""Keys of its virtual hardware that come along."""

OF_A_TASK: Final = ("T_world_crf", "cameras", "reflection", "schedules", "sources")
"""Sections that a task may have of its own."""

OF_ITS_OWN: Final = tuple(key for key in (*OF_A_MECHANISM, "frames", "rig") if key not in OF_A_TASK)
"""Sections that may stand in the table of one of several mechanisms."""

ONE_ONLY: Final = {
    "cameras": "give each to the task that looks through it, as [[tasks.cameras]]",
    "contour": "give it to the one that looks ahead, as [mechanisms.contour]",
    "scanner": "give it to the one that carries it, as [mechanisms.scanner]",
    "frames.base": "give each whose Base moves its own, as [mechanisms.frames.base]",
}
"""Keys that mean nothing where there are several mechanisms, and why."""

Document = dict[str, Any]
Whole = Callable[[object, Path, str], Document]
"""Reads another cell's file: its name or path, the folder that a path starts from, and who asks."""


@dataclass(frozen=True)
class MechanismKeys:
    """Keys that a file has for one mechanism."""

    document: Document
    """As a file with `[mechanism]` would say it."""
    place: str = "mechanism"
    """Where the mechanism stands in the file."""
    task: str = ""
    """Name of its task; empty where nothing names it."""
    says: tuple[tuple[str, Document], ...] = ()
    """Tables that speak for it, each with its place in the file, the last word first."""

    def words(self, complaint: str) -> str:
        """Return a complaint that begins with a key of `document`, by the file's own key."""
        names = re.findall(r"[^.\[\]]+", re.split(r":( |$)", complaint, maxsplit=1)[0])
        if names[0] == "mechanism":
            return self.place + complaint.removeprefix("mechanism")
        for found in (names, names[:-1]):
            for place, table in self.says if found else ():
                if _has(table, found):
                    return place + complaint
        return complaint


def _has(table: object, names: list[str]) -> bool:
    """Return whether a table says anything of a key, or of the list that it is in."""
    for name in names:
        if not isinstance(table, dict):
            break
        if name not in table:
            return False
        table = table[name]
    return True


def parts_of(path: Path, document: Document, whole: Whole) -> list[MechanismKeys]:
    """Return what a file with `[[mechanisms]]` says of each, as a file with `[mechanism]` would.

    Raises `ConfigError`.
    """
    document = dict(document)
    if "mechanism" in document:
        raise ConfigError(f"{path}: mechanisms: there is [mechanism] too: give one of both")
    entries = _tables(path, "mechanisms", document.pop("mechanisms"))
    if not 1 <= len(entries) <= MOST:
        raise ConfigError(f"{path}: mechanisms: {len(entries)} tables: must be 1 to {MOST}")
    names = _names(path, "mechanisms", entries)
    tasks = _tasks(path, _tables(path, "tasks", document.pop("tasks", [])), names)
    said = document
    if len(names) > 1:
        _refuse_of_one(path, document)
        # Several arms keep clear of each other, unless the file says otherwise.
        document = on_top({"avoidance": {"enabled": True}}, document)
    parts = []
    for i, (name, entry) in enumerate(zip(names, entries, strict=True)):
        place = f"mechanisms[{i}]"
        own: Document = {key: entry[key] for key in OF_ITS_OWN if key in entry}
        _check_rig(path, place, own)
        for key in ("carrier", "T_world_carrier"):
            if len(names) > 1 and _has(own, ["frames", key]):
                raise ConfigError(
                    f"{path}: {place}.frames.{key}: the Carrier is the cell's: [frames]"
                )
        arm = {key: value for key, value in entry.items() if key != "like" and key not in own}
        alike = _alike(whole, entry, path, i) if "like" in entry else {}
        task = tasks.get(name, _Task(name, "", {}))
        part = on_top(on_top(alike, document), {**own, "mechanism": arm})
        says = ((f"{task.place}.", task.says), (f"{place}.", own), ("", said))
        like = (f"{place}.like: ", alike)
        parts.append(MechanismKeys(on_top(part, task.says), place, task.name, (*says, like)))
    return parts


def _refuse_of_one(path: Path, document: Document) -> None:
    for key, why in ONE_ONLY.items():
        if _has(document, key.split(".")):
            raise ConfigError(f"{path}: {key}: there are several mechanisms: {why}")


def _check_rig(path: Path, place: str, own: Document) -> None:
    rig = own.get("rig", {})
    for key in rig if isinstance(rig, dict) else ():
        if key not in OF_ITS_RIG:
            hint = nearest(key, OF_ITS_RIG)
            raise ConfigError(f"{path}: {place}.rig.{key}: is no mechanism's own{hint}")


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


def _alike(whole: Whole, entry: Document, path: Path, i: int) -> Document:
    """Return what comes along with the mechanism of another cell.

    The names of that cell's buses come along only where the mechanism is not put on one of this.
    """
    name, where = entry["like"], f"{path}: mechanisms[{i}].like: "
    other = whole(name, path.parent, where)
    if not isinstance(other.get("mechanism"), dict):
        raise ConfigError(f"{where}value '{name}': a cell with [mechanism] is needed")
    found: Document = {key: other[key] for key in ("mechanism", *OF_A_MECHANISM) if key in other}
    rig = other.get("rig")
    if isinstance(rig, dict):
        found["rig"] = {key: rig[key] for key in OF_ITS_RIG if key in rig}
    found = deepcopy(found)
    if "on" in entry:
        found["mechanism"].pop("T_world_base", None)
    if "bus" in entry:
        drives = found["mechanism"].get("drives", [])
        others = found["mechanism"].values()
        for device in (*(drives if isinstance(drives, list) else ()), *others):
            if isinstance(device, dict):
                device.pop("bus", None)
    return found


class _Task(NamedTuple):
    """A task of one mechanism: its name, its place in the file, and its own sections."""

    name: str
    place: str
    says: Document


def _tasks(path: Path, tables: list[Document], mechanisms: list[str]) -> dict[str, _Task]:
    """Return the task that each mechanism has, where the file has a table for it."""
    found: dict[str, _Task] = {}
    names = _names(path, "tasks", tables)
    for i, (name, table) in enumerate(zip(names, tables, strict=True)):
        if is_joint(table):
            continue
        where = f"{path}: tasks[{i}]"
        by = table.get("by", [name])
        if not isinstance(by, list) or len(by) != 1 or not isinstance(by[0], str):
            raise ConfigError(
                f"{where}.by: value {short(by)}: a list with the name of one mechanism"
            )
        if by[0] not in mechanisms:
            hint = nearest(by[0], mechanisms)
            raise ConfigError(f"{where}.by: value '{by[0]}': no such mechanism{hint}")
        if by[0] in found:
            raise ConfigError(f"{where}.by: value '{by[0]}': has another task already")
        for key in table:
            if key not in ("name", "by", *OF_A_TASK):
                hint = nearest(key, ("name", "by", *OF_A_TASK))
                raise ConfigError(f"{where}.{key}: unknown key{hint}")
        own: Document = {key: table[key] for key in OF_A_TASK if key in table}
        found[by[0]] = _Task(name, f"tasks[{i}]", own)
    for i, name in enumerate(names):
        if name in mechanisms and name not in found:
            raise ConfigError(
                f"{path}: tasks[{i}].name: value '{name}': the task of mechanism '{name}', which "
                "has no table, is called so"
            )
    return found


def _tables(path: Path, key: str, value: object) -> list[Document]:
    if not isinstance(value, list) or not all(isinstance(x, dict) for x in value):
        raise ConfigError(f"{path}: {key}: must be tables: [[{key}]]")
    return value


def _names(path: Path, key: str, tables: list[Document]) -> list[str]:
    names: list[str] = []
    for i, table in enumerate(tables):
        if "name" not in table:
            raise ConfigError(f"{path}: {key}[{i}].name: missing: its name")
        name = table["name"]
        if not isinstance(name, str) or not NAME.fullmatch(name):
            raise ConfigError(
                f"{path}: {key}[{i}].name: value {short(name)}: must be small letters, digits and "
                "_, at most 32, a letter first"
            )
        if name in names:
            raise ConfigError(f"{path}: {key}[{i}].name: value '{name}': is there already")
        names.append(name)
    return names


# --- Mechanisms that stand on others --------------------------------------------------------------


def place_on(carrier: MechanismSection, robot: Robot, T_on: PoseSection) -> PoseSection:
    """Return where a Base on a mechanism's tip link is in World, its joints at `start`."""
    q = dict(zip([joint.name for joint in robot.joints], carrier.postures["start"], strict=True))
    tip = place_at(robot.tree(), carrier.tip_link, q)
    R, p = np.eye(3), np.zeros(3)
    for R_next, p_next in (pose_of(carrier.T_world_base), tip, pose_of(T_on)):
        R, p = R @ R_next, p + R @ p_next
    x, y, z = p.tolist()
    return PoseSection(xyz=(x, y, z), rpy=rpy_of(R))


# --- Devices on a cell's buses: an entry for each, in the order of booting ------------------------


def devices_of(config: CellConfig, place: str, prefix: str, part: int) -> Iterator[Entry]:
    """Yield the devices of one mechanism: drives as the chain's joints, then as its fields stand.

    The mechanism stands at `place` in the file and is the cell's `part`-th; names of its devices
    begin with `prefix`.
    """
    mechanism = config.mechanism
    default = mechanism.bus or config.fieldbuses[0].name
    for i, drive in enumerate(mechanism.drives):
        name = f"{prefix}{drive.joint}"
        key = f"{place}.{drive.key(i)}"
        yield Entry(key, name, drive, drive.bus or default, f"the drive of '{name}'", part)
    of = f" of '{mechanism.name}'" if prefix else ""
    for kind, section in _on_bus(mechanism):
        owner = f"the {kind.replace('_', '/')}{of}"
        bus = section.bus or default
        yield Entry(f"{place}.{kind}", f"{prefix}{kind}", section, bus, owner, part)


def shared_devices(config: CellConfig) -> Iterator[Entry]:
    """Yield the devices that a cell has once, however many mechanisms it has."""
    for name, section in _on_bus(config):
        bus = section.bus or config.fieldbuses[0].name
        yield Entry(name, name, section, bus, f"the {name.replace('_', ' ')}", None)


def _on_bus(table: Section) -> Iterator[tuple[str, OnBusSection]]:
    """Yield the devices of a table that it has once, in the order of its fields."""
    for key in type(table).model_fields:
        section = getattr(table, key)
        if isinstance(section, OnBusSection):
            yield key, section
