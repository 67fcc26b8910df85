"""The wheels of a base: joints of the URDF beside the chain that turn for ever."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from .errors import ConfigError, nearest
from .schema.cell import CellConfig
from .urdf import Robot, axis_of, joints_of_root

TURNS_FOR_EVER: Final = 1e9
"""Wheels have no position limits: no command gets here [rad]."""


def with_wheels(
    path: Path, config: CellConfig, robot: Robot, words: Callable[[str], str]
) -> tuple[CellConfig, Robot]:
    """Return configuration and robot with the wheels as first joints, at angle 0 in each posture.

    Both as they are where nothing rolls. `words` turns a complaint about a mechanism's cell into
    one that begins with the file's key. Raises `ConfigError`.
    """
    base = config.mechanism.base
    if base is None:
        return config, robot
    found, known = [], joints_of_root(robot.urdf)
    for side in ("left", "right"):
        name = getattr(base.wheels, side)
        where = f"{path}: {words(f'mechanism.base.wheels.{side}')}: value '{name}': "
        if name not in known:
            raise ConfigError(
                f"{where}no joint on the root link of {robot.urdf}{nearest(name, list(known))}"
            )
        if known[name].kind != "continuous" or axis_of(robot.urdf, name) != (0.0, 1.0, 0.0):
            raise ConfigError(f"{where}must be of type continuous, about axis 0 1 0")
        found.append(replace(known[name], lower=-TURNS_FOR_EVER, upper=TURNS_FOR_EVER))
    n = len(robot.joints)
    postures = {
        name: (0.0, 0.0, *q) if len(q) == n else q for name, q in config.mechanism.postures.items()
    }
    mechanism = config.mechanism.model_copy(update={"postures": postures})
    robot = replace(robot, joints=(*found, *robot.joints))
    return config.model_copy(update={"mechanism": mechanism}), robot
