"""Needs of virtual spheres in the robot and in the null space."""

from collections.abc import Iterator

from ..errors import nearest
from ..schema.cell import CellConfig
from ..urdf.robot import Robot


def priority_disagreements(config: CellConfig, robot: Robot) -> Iterator[str]:
    """Yield what does not fit, each in one line with its key."""
    priority = config.priority
    if priority is None:
        if config.redundancy.spheres > 0.0:
            yield (
                f"redundancy.spheres: value {config.redundancy.spheres:g}: there is no [priority], "
                "which says where the spheres are"
            )
        return
    names = [joint.name for joint in robot.joints]
    for i, name in enumerate(priority.joints):
        if name not in names:
            hint = nearest(name, names)
            yield f"priority.joints[{i}]: value '{name}': no such joint of the arm{hint}"
