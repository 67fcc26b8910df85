"""Tasks that several mechanisms of a cell file hold together, and that they fit the mechanisms."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from .errors import ConfigError, nearest
from .schema.joint_task import JointTaskSection
from .schema.rig.rig import RigSection

SHARED: Final = ("T_world_crf", "sources", "schedules")
"""Keys that a joint task has of the whole file where it says nothing of its own."""


MOST_SWING: Final = 1.2
"""A payload on its pads is simulated well up to this (ω² dt² + c dt / I) [1]."""


def is_joint(table: dict[str, Any]) -> bool:
    """Return whether a table of `[[tasks]]` is for several mechanisms."""
    by = table.get("by")
    return isinstance(by, list) and len(by) > 1


def agree(
    path: Path, tasks: Sequence[tuple[int, JointTaskSection]], mechanisms: Mapping[str, bool]
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
