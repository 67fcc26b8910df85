"""Serial arms among the robots that installed Python packages hold."""

import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Final, NamedTuple

NEEDED: Final = "pip install 'telerobot[arms]'"
_SHARE: Final = "cmeel.prefix/share/example-robot-data/robots"


class Published(NamedTuple):
    """One arm, and where it is."""

    name: str
    urdf: Path


_ERD: Final = {
    "panda": "panda_description/urdf/panda.urdf",
    "panda_collision": "panda_description/urdf/panda_collision.urdf",
    "ur3": "ur_description/urdf/ur3_robot.urdf",
    "ur3_gripper": "ur_description/urdf/ur3_gripper.urdf",
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "ur5_gripper": "ur_description/urdf/ur5_gripper.urdf",
    "ur10": "ur_description/urdf/ur10_robot.urdf",
    "ur10_limited": "ur_description/urdf/ur10_joint_limited_robot.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "z1": "z1_description/urdf/z1.urdf",
    "so100": "so_arm_description/urdf/so100.urdf",
    "so101": "so_arm_description/urdf/so101.urdf",
    "talos_left_arm": "talos_data/robots/talos_left_arm.urdf",
}
_BULLET: Final = {
    "iiwa": "kuka_iiwa/model.urdf",
    "bullet_panda": "franka_panda/panda.urdf",
    "xarm6": "xarm/xarm6_robot.urdf",
    "xarm6_gripper": "xarm/xarm6_with_gripper.urdf",
}


def published() -> list[Published]:
    """Return the arms that are installed, those of `example-robot-data` and of pybullet."""
    found = []
    for folder in map(Path, sys.path):
        found += [Published(name, folder / _SHARE / path) for name, path in _ERD.items()]
    spec = find_spec("pybullet_data")
    for folder in map(Path, [] if spec is None else spec.submodule_search_locations or []):
        found += [Published(name, folder / path) for name, path in _BULLET.items()]
    there = {arm.name: arm for arm in reversed(found) if arm.urdf.is_file()}
    return sorted(there.values())
