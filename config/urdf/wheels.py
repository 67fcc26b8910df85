"""The wheels of a base: joints of the URDF beside the chain that turn for ever."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Final

from ..errors import ConfigError
from ..schema.cell import CellConfig
from .beside_chain import beside_chain, root_joint
from .robot import Robot, axis_of

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
    found = []
    for side in ("left", "right"):
        name = getattr(base.wheels, side)
        where = f"{path}: {words(f'mechanism.base.wheels.{side}')}"
        joint = root_joint(where, robot, name)
        if joint.kind != "continuous" or axis_of(robot.urdf, name) != (0.0, 1.0, 0.0):
            raise ConfigError(
                f"{where}: value '{name}': must be of type continuous, about axis 0 1 0"
            )
        found.append(replace(joint, lower=-TURNS_FOR_EVER, upper=TURNS_FOR_EVER))
    return beside_chain(config, robot, before=tuple(found))
