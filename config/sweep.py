"""The axis that sweeps: a joint of the URDF beside the chain, after all others."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from .errors import ConfigError, nearest
from .schema.cell import CellConfig
from .urdf import Robot, joints_of_root


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
    known = joints_of_root(robot.urdf)
    if sweep.joint not in known:
        raise ConfigError(
            f"{where}.joint: value '{sweep.joint}': no joint on the root link of {robot.urdf}"
            f"{nearest(sweep.joint, list(known))}"
        )
    joint = known[sweep.joint]
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
    n = len(robot.joints)
    postures = {
        name: (*q, sweep.low) if len(q) == n else q for name, q in config.mechanism.postures.items()
    }
    mechanism = config.mechanism.model_copy(update={"postures": postures})
    return config.model_copy(update={"mechanism": mechanism}), replace(
        robot, joints=(*robot.joints, joint)
    )
