"""A loaded cell as one text that needs no other file, and back: for recordings of its runs."""

import json
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from .errors import ConfigError
from .load import Cell
from .schema.cell import CellConfig
from .schema.joint_task import JointTaskSection
from .urdf.robot import read_robot, with_sweep, with_wheels

FORMAT: Final = 1


def to_text(cell: Cell) -> str:
    """Return a cell as JSON, as it is now: with what the command line changed, and its URDFs."""
    return json.dumps(
        {
            "format": FORMAT,
            "path": str(cell.path),
            "joint_tasks": [task.model_dump(mode="json") for task in cell.joint_tasks],
            "parts": [_part(part) for part in cell.parts],
        }
    )


def from_text(text: str, folder: Path) -> Cell:
    """Return the cell of such a text; its URDFs are written into a folder.

    Raises `ConfigError` for a text that is none, `OSError` where a URDF cannot be written.
    """
    try:
        table = json.loads(text)
        if table["format"] != FORMAT:
            raise ConfigError(f"a recorded cell of format {table['format']}, not {FORMAT}")
        path = Path(table["path"])
        parts = [_restored(path, part, folder, i) for i, part in enumerate(table["parts"])]
        joint = tuple(JointTaskSection.model_validate(task) for task in table["joint_tasks"])
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, first["loc"]))
        raise ConfigError(f"a recorded cell of another version: {where}: {first['msg']}") from None
    except (ValueError, KeyError, TypeError, IndexError, RecursionError) as error:
        raise ConfigError(f"no recorded cell: {type(error).__name__}: {error}") from None
    first_part, *others = parts
    if not others and not joint:
        return first_part
    return Cell(
        path,
        first_part.config,
        first_part.robot,
        tuple(others),
        joint,
        first_part.prefix,
        first_part.place,
        first_part.task,
    )


def _part(part: Cell) -> dict[str, Any]:
    return {
        "config": part.config.model_dump(mode="json", exclude_unset=True),
        "urdf": part.robot.urdf.read_text(encoding="utf-8"),
        "urdf_name": part.robot.urdf.name,
        "prefix": part.prefix,
        "place": part.place,
        "task": part.task,
    }


def _restored(path: Path, part: dict[str, Any], folder: Path, i: int) -> Cell:
    config = CellConfig.model_validate(part["config"])
    urdf = folder / f"{i}_{Path(part['urdf_name']).name}"
    urdf.write_text(part["urdf"], encoding="utf-8")
    mechanism, asked_by = config.mechanism, f"{path}: {part['place']}.tip_link"
    drives = {drive.joint: drive for drive in mechanism.drives}
    robot = read_robot(
        urdf, mechanism.tip_link, asked_by, drives, mechanism.inertials,
        first_joint=mechanism.first_joint, without=mechanism.without,
    )  # fmt: skip
    for beside_chain in (with_sweep, with_wheels):  # postures have their joints already
        config, robot = beside_chain(path, config, robot, str)
    return Cell(path, config, robot, prefix=part["prefix"], place=part["place"], task=part["task"])
