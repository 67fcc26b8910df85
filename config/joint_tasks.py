"""Tasks that several mechanisms of a cell file hold together, and that they fit the mechanisms."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from .errors import ConfigError, nearest
from .schema.joint_task import JointTask
from .schema.rig.beam import RigBeam

SHARED: Final = ("T_world_crf", "sources", "schedules")
"""Keys that a joint task has of the whole file where it says nothing of its own."""


def is_joint(table: dict[str, Any]) -> bool:
    """Return whether a table of `[[tasks]]` is for several mechanisms."""
    by = table.get("by")
    return isinstance(by, list) and len(by) > 1


def agree(
    path: Path, tasks: Sequence[tuple[int, JointTask]], mechanisms: Mapping[str, bool]
) -> None:
    """Raise `ConfigError` where joint tasks, each with its place in the file, do not fit the cell.

    `mechanisms` tells by name which have a force/torque sensor: none holds a payload with others
    without. A mechanism holds one payload at a time: two tasks at start may not ask for the same.
    """
    holder: dict[str, str] = {}
    for i, task in tasks:
        for k, name in enumerate(task.by):
            where = f"{path}: tasks[{i}].by[{k}]: value '{name}'"
            if name not in mechanisms:
                raise ConfigError(f"{where}: no such mechanism{nearest(name, mechanisms)}")
            if not mechanisms[name]:
                raise ConfigError(f"{where}: has no force_torque sensor to hold a payload by")
            if not task.at_start:
                continue
            if name in holder:
                raise ConfigError(f"{where}: holds '{holder[name]}' at start")
            holder[name] = task.name


def agree_with_beam(path: Path, tasks: Sequence[JointTask], beam: RigBeam | None) -> None:
    """Raise `ConfigError` where the rig's payload does not fit the task that is to hold it."""
    if beam is None:
        return
    if not tasks:
        raise ConfigError(f"{path}: rig.beam: no task of [[tasks]] is by several mechanisms")
    if len(beam.misfit) not in (0, len(tasks[0].by)):
        raise ConfigError(
            f"{path}: rig.beam.misfit: {len(beam.misfit)} places for {len(tasks[0].by)} mechanisms"
            f" of task '{tasks[0].name}': one each"
        )
