"""The axis that sweeps: a joint of the URDF beside the chain, after all others."""

from collections.abc import Callable
from pathlib import Path

from ..errors import ConfigError
from ..schema.cell import CellConfig
from .beside_chain import beside_chain, root_joint
from .robot import Robot


def with_sweep(
    path: Path, config: CellConfig, robot: Robot, words: Callable[[str], str]
) -> tuple[CellConfig, Robot]:
    """Return configuration and robot with the axis that sweeps as last joint, at its low end.

    Both as they are where nothing sweeps. `words` turns a complaint about a mechanism's cell into
    one that begins with the file's key. Raises `ConfigError`.
    """
    sweep = config.mechanism.sweep
    if sweep is None:
        return config, robot
    where = f"{path}: {words('mechanism.sweep')}"
    joint = root_joint(f"{where}.joint", robot, sweep.joint)
    if joint.kind != "revolute":
        raise ConfigError(f"{where}.joint: value '{sweep.joint}': must be of type revolute")
    margin = next(
        (d.position_margin for d in config.mechanism.drives if d.joint == sweep.joint), 0.0
    )
    for key, value in (("low", sweep.low), ("high", sweep.high)):
        if not joint.lower + margin < value < joint.upper - margin:
            raise ConfigError(
                f"{where}.{key}: value {value:g}: must be inside of "
                f"{joint.lower + margin:g} to {joint.upper - margin:g} of joint '{sweep.joint}'"
            )
    return beside_chain(config, robot, behind=(joint,), angle=sweep.low)
