"""From a TOML file to a cell: the schema's fields, the robot's chain, and that the two agree.

Whatever a person can get wrong ends in a `ConfigError` of one line that names file, key, value
and bound. What needs numbers to judge (bus load, stability) is `telerobot check`'s.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from .consistency import PartOf, check_agreement, check_cell
from .drives import expand, with_drives
from .errors import ConfigError, nearest, short
from .parts import (
    MechanismKeys,
    agree,
    agree_with_beam,
    devices_of,
    joint_tables_of,
    on_top,
    parts_of,
    place_on,
    shared_devices,
    unable_to_share,
)
from .schema.bus import Entry
from .schema.cell import CellConfig
from .schema.joint_task import JointTaskSection
from .schema.section import PoseSection, Section
from .schema.surroundings import CameraSection
from .toml import read_toml, under, validated
from .urdf.robot import Robot, UrdfJoint, read_robot, with_sweep, with_wheels

__all__ = [
    "Cell",
    "ConfigError",
    "Robot",
    "UrdfJoint",
    "altered",
    "load_cell",
    "read_toml",
    "script_path",
    "shipped",
]

HERE: Final = Path(__file__).resolve().parent


@dataclass(frozen=True)
class Cell:
    """One daemon's worth of robot: the file, what it says, and the arm that it means.

    A cell of several mechanisms is made of parts: each is the cell as it would be with that
    mechanism alone. What they share, as the period, reads the same in all.
    """

    path: Path
    config: CellConfig
    """Contents of the file, drives in the order of the chain's joints; of a cell of several
    mechanisms those of the first."""
    robot: Robot
    others: tuple["Cell", ...] = ()
    """The other parts, in the order of the file."""
    joint_tasks: tuple[JointTaskSection, ...] = ()
    """Tasks that several mechanisms hold together; none in a part."""
    prefix: str = ""
    """Names of this part's joints, links and devices begin so where the cell has several:
    `MECHANISM.`"""
    place: str = "mechanism"
    """Where this part's mechanism stands in the file."""
    task: str = ""
    """Name of this part's task: the mechanism's, unless the file gives it another."""

    @property
    def parts(self) -> tuple["Cell", ...]:
        """The cell of each mechanism alone; the cell itself where there is one."""
        if not self.others:
            return (self,)
        return (replace(self, others=(), joint_tasks=()), *self.others)

    def part(self, mechanism: str | None) -> "Cell":
        """Return the part of a mechanism by its name, the first without one."""
        by = {part.config.mechanism.name: part for part in self.parts}
        return self.parts[0] if mechanism is None else by[mechanism]

    @property
    def carriers(self) -> tuple[int, ...]:
        """Of each part, the place of the one whose tip link it stands on; -1: it is in World."""
        names = [part.config.mechanism.name for part in self.parts]
        under = [part.config.mechanism.on for part in self.parts]
        return tuple(names.index(on) if on in names else -1 for on in under)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of all joints; with several mechanisms each is `MECHANISM.JOINT`."""
        return tuple(
            f"{part.prefix}{joint.name}" for part in self.parts for joint in part.robot.joints
        )

    @property
    def devices(self) -> tuple[Entry, ...]:
        """Every device on a bus, in the order of booting: mechanism by mechanism, shared ones last.

        Those of a mechanism are its drives, as the chain's joints, then its sensor and gripper.
        """
        each = (
            devices_of(part.config, part.place, part.prefix, i) for i, part in enumerate(self.parts)
        )
        return (*chain.from_iterable(each), *shared_devices(self.config))

    @property
    def cameras(self) -> tuple[CameraSection, ...]:
        """The cameras of all tasks, each with a name of its own."""
        return tuple(camera for part in self.parts for camera in part.config.cameras)

    @property
    def default_script(self) -> Path:
        """The script that is played where none is named; a path is one beside the cell's file."""
        return script_path(self.config.default_script, self.path.parent)


def altered(cell: Cell, changes: Mapping[str, Any], table: str = "") -> Cell:
    """Return a cell with other values, by their keys: `{"rig.wall.stiffness": 2000.0}`.

    They are keys of a `table` where one is named: `{"stiffness": 2000.0}, "rig.wall"`. A number
    stands for an entry of a list: `rig.boxes.0.xyz`. Each value is judged as a file's is,
    in its own table; not whether tables agree. Raises `ConfigError` for a key that is not there,
    or a value that may not be.
    """
    config = cell.config
    for name, value in changes.items():
        key = f"{table}.{name}" if table else name
        config = _altered(config, key.split("."), value, f"{cell.path}: {key}")
    return replace(cell, config=config)


def _altered(table: Any, keys: list[str], value: object, where: str) -> Any:
    """Return a table, list or mapping in which the value at these keys is another."""
    key, *deeper = keys
    if isinstance(table, tuple):
        entries = list(table)
        if not key.isdecimal() or int(key) >= len(entries):
            raise ConfigError(f"{where}: {key}: no entry of {len(entries)}")
        entries[int(key)] = _altered(entries[int(key)], deeper, value, where) if deeper else value
        return tuple(entries)
    if isinstance(table, Mapping):
        return {**table, key: _altered(table.get(key), deeper, value, where) if deeper else value}
    if not isinstance(table, Section):
        raise ConfigError(f"{where}: {key}: there is no table around it")
    if key not in type(table).model_fields:
        raise ConfigError(f"{where}: unknown key{nearest(key, type(table).model_fields)}")
    if deeper:
        value = _altered(getattr(table, key), deeper, value, where)
    try:
        return table.model_copy(update={key: value})
    except ValidationError as error:
        first = error.errors()[0]
        raise ConfigError(f"{where}: value {short(first['input'])}: {first['msg']}") from None


def grasp_part(cell: Cell, task: JointTaskSection, member: int) -> Cell:
    """Return what the file would say with one mechanism of a joint task alone, and that task.

    What one arm feels of another over the grasps is the stiffest that force control meets there.
    """
    part = cell.part(task.by[member])
    mechanism = part.config.mechanism
    if mechanism.force_torque is not None:
        stiff = {
            "stiffest_environment": task.internal_stiffness,
            "stiffest_environment_rotation": task.internal_stiffness_rotation,
            "contact_length": 0.0,
        }
        sensor = mechanism.force_torque.model_copy(update=stiff)
        mechanism = mechanism.model_copy(update={"force_torque": sensor})
    own = {
        "mechanism": mechanism,
        "sources": task.sources,
        "schedules": task.schedules,
        "T_world_crf": task.T_world_crf,
        "reflection": None,
    }
    return replace(part, config=part.config.model_copy(update=own))


def joint_part(cell: Cell, task: JointTaskSection) -> Cell:
    """Return that of a joint task's first mechanism, with the shared MRF for its own."""
    part = grasp_part(cell, task, 0)
    mechanism = part.config.mechanism.model_copy(update={"T_wrist_mrf": task.T_wrist_mrf[0]})
    return replace(part, config=part.config.model_copy(update={"mechanism": mechanism}))


def shipped(kind: str) -> tuple[str, ...]:
    """Return the names of what is shipped of a kind: `cells`, `robots` or `scripts`."""
    suffix = ".urdf" if kind == "robots" else ".toml"
    return tuple(sorted(p.stem for p in (HERE / kind).glob(f"*{suffix}")))


def load_cell(name_or_path: str | Path) -> Cell:
    """Load a cell: the path of a TOML file, or the name of one that is shipped.

    Raises `ConfigError`.
    """
    path = _find("cells", name_or_path, Path(), "")
    document = _whole(path)
    if "mechanisms" not in document:
        return _agreed(_part(path, MechanismKeys(document, "mechanism")))
    parts = [_part(path, part) for part in parts_of(path, document, _whole_cell)]
    if len(parts) > 1:
        parts = [replace(part, prefix=f"{part.config.mechanism.name}.") for part in parts]
    parts = _on_others(parts)
    joint = [
        (i, validated(path, table, JointTaskSection, partial(under, f"tasks[{i}]")))
        for i, table in joint_tables_of(path, document)
    ]
    agree(
        path, joint, {p.config.mechanism.name: unable_to_share(p.config.mechanism) for p in parts}
    )
    rated = {p.config.mechanism.name: p.config.mechanism.rated_payload for p in parts}
    tasks = tuple(task.shared_by(rated) for _, task in joint)
    return _agreed(replace(parts[0], others=tuple(parts[1:]), joint_tasks=tasks))


def _on_others(parts: list[Cell]) -> list[Cell]:
    """Return the parts, with the Base of what stands on another where that stands at `start`.

    What does not fit is `_agreed`'s to tell.
    """
    by = {part.config.mechanism.name: part for part in parts}
    found = []
    for part in parts:
        mechanism = part.config.mechanism
        under = by.get(mechanism.on or "")
        if under is not None and under.config.mechanism.torso is not None:
            if "T_world_base" in mechanism.model_fields_set:
                where = f"{part.path}: {part.place}.T_world_base"
                raise ConfigError(f"{where}: stands on '{mechanism.on}': give {part.place}.T_on")
            on = mechanism.T_on or PoseSection()
            place = place_on(under.config.mechanism, under.robot, on)
            told = {"mechanism": mechanism.model_copy(update={"T_world_base": place})}
            found.append(replace(part, config=part.config.model_copy(update=told)))
        else:
            found.append(part)
    return found


def _agreed(cell: Cell) -> Cell:
    """Return a cell whose parts agree with each other. Raises `ConfigError`."""
    agree_with_beam(cell.path, cell.joint_tasks, cell.config.rig)
    parts = [PartOf(part.place, part.prefix, part.config, part.robot) for part in cell.parts]
    check_cell(cell.path, parts, cell.devices)
    return cell


def _whole_cell(name: object, base: Path, where: str) -> dict[str, Any]:
    """Return what another cell's file says."""
    if not isinstance(name, str):
        raise ConfigError(f"{where}value {short(name)}: the name or path of a cell")
    other = _find("cells", name, base, where)
    return _seen_from(base, other.parent, _whole(other))


def _part(path: Path, part: MechanismKeys) -> Cell:
    """Return the cell of one mechanism."""
    place = part.place
    config = expand(path, validated(path, part.document, CellConfig, part.words), place)
    mechanism = config.mechanism
    urdf = _find("robots", mechanism.urdf, path.parent, f"{path}: {place}.urdf: ")
    of_joint = {drive.joint: drive for drive in mechanism.drives}
    asked_by = f"{path}: {place}.tip_link"
    robot = read_robot(
        urdf, mechanism.tip_link, asked_by, of_joint, mechanism.inertials,
        first_joint=mechanism.first_joint, without=mechanism.without,
    )  # fmt: skip
    config, robot = with_sweep(path, config, robot, part.words)
    config, robot = with_wheels(path, config, robot, part.words)
    check_agreement(path, config, robot, part.words)
    config = with_drives(config, robot)
    _find("scripts", config.default_script, path.parent, f"{path}: default_script: ")
    order = {joint.name: i for i, joint in enumerate(robot.joints)}
    mechanism = config.mechanism
    drives = tuple(sorted(mechanism.drives, key=lambda drive: order[drive.joint]))
    mechanism = mechanism.model_copy(update={"drives": drives})
    config = config.model_copy(update={"mechanism": mechanism})
    return Cell(path, config, robot, place=place, task=part.task or mechanism.name)


def _whole(path: Path, below: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Return what a cell file says, on top of what the cell says that it `extends`.

    Tables are taken together, key by key; any other value, and a list of tables as a whole, takes
    the other's place.
    """
    document = read_toml(path)
    name = document.pop("extends", None)
    if name is None:
        return document
    if not isinstance(name, str):
        raise ConfigError(f"{path}: extends: value {short(name)}: the name or path of a cell")
    other = _find("cells", name, path.parent, f"{path}: extends: ")
    if other.resolve() in (p.resolve() for p in (*below, path)):
        raise ConfigError(f"{path}: extends: value '{name}': extends itself")
    said = _seen_from(path.parent, other.parent, _whole(other, (*below, path)))
    return on_top(said, document)


def _seen_from(folder: Path, its_own: Path, document: dict[str, Any]) -> dict[str, Any]:
    """Return what another file says, with paths from its own folder where that is another one."""
    if folder.resolve() == its_own.resolve():
        return document
    seen = {**document, **_with_path(document, "default_script", its_own)}
    if isinstance(seen.get("mechanism"), dict):
        seen["mechanism"] = _with_path(seen["mechanism"], "urdf", its_own)
    arms = seen.get("mechanisms")
    if isinstance(arms, list) and all(isinstance(arm, dict) for arm in arms):
        arms = [_with_path(arm, "urdf", its_own) for arm in arms]
        seen["mechanisms"] = [_with_path(arm, "like", its_own) for arm in arms]
    return seen


def _with_path(table: dict[str, Any], key: str, folder: Path) -> dict[str, Any]:
    """Return a table in which a path that a key gives is one from `folder`."""
    value = table.get(key)
    if not isinstance(value, str) or not _is_path(value):
        return table
    return {**table, key: str(folder.resolve() / value)}


def script_path(name_or_path: str | Path, base: Path) -> Path:
    """Return the file of a script: a path, relative to `base`, or the name of a shipped one.

    Raises `ConfigError` if there is none.
    """
    return _find("scripts", name_or_path, base, "")


def _is_path(text: str) -> bool:
    """Return whether a text is a path, and not the name of something that is shipped."""
    return "/" in text or text.endswith((".toml", ".urdf"))


def _find(kind: str, name_or_path: str | Path, base: Path, where: str) -> Path:
    text = str(name_or_path)
    suffix = ".urdf" if kind == "robots" else ".toml"
    if isinstance(name_or_path, Path) or _is_path(text):
        path = base / name_or_path
        if not path.is_file():
            raise ConfigError(f"{where}{path}: no such file")
        return path
    names = shipped(kind)
    if text not in names:
        listed = ", ".join(names) or "none"
        raise ConfigError(
            f"{where}{text}: no shipped {kind[:-1]} of that name, and not a path that ends in "
            f"{suffix}; shipped: {listed}{nearest(text, names)}"
        )
    return HERE / kind / f"{text}{suffix}"
