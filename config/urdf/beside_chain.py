"""Joints of the URDF's root link beside the arm's chain: wheels before it, a sweep behind it."""

from dataclasses import replace

from ..errors import ConfigError, nearest
from ..schema.cell import CellConfig
from .robot import Robot, UrdfJoint, joints_of_root


def root_joint(where: str, robot: Robot, name: str) -> UrdfJoint:
    """Return a joint of the root link; `where` is file and key that name it.

    Raises `ConfigError`.
    """
    known = joints_of_root(robot.urdf)
    if name not in known:
        raise ConfigError(
            f"{where}: value '{name}': no joint on the root link of {robot.urdf}"
            f"{nearest(name, list(known))}"
        )
    return known[name]


def beside_chain(
    config: CellConfig,
    robot: Robot,
    before: tuple[UrdfJoint, ...] = (),
    behind: tuple[UrdfJoint, ...] = (),
    angle: float = 0.0,
) -> tuple[CellConfig, Robot]:
    """Return configuration and robot with more joints, at an angle [rad] in each posture.

    A posture that has an angle for them already stays as it is.
    """
    n = len(robot.joints)
    first, last = (angle,) * len(before), (angle,) * len(behind)
    postures = {
        name: (*first, *q, *last) if len(q) == n else q
        for name, q in config.mechanism.postures.items()
    }
    mechanism = config.mechanism.model_copy(update={"postures": postures})
    return (
        config.model_copy(update={"mechanism": mechanism}),
        replace(robot, joints=(*before, *robot.joints, *behind)),
    )
