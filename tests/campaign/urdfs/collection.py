"""Arms among the robots that installed Python packages hold, as they come: no file is edited."""

import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Final, NamedTuple

NEEDED: Final = "pip install 'telerobot[arms]'"
_SHARE: Final = "cmeel.prefix/share/example-robot-data/robots"


class Published(NamedTuple):
    """One description, and where it is."""

    name: str
    urdf: Path
    tips: tuple[str, ...] = ()
    """Last links of its arms, where `init` asks for them: one cell of all."""
    refused: str = ""
    """Part of the line with which `init` rightly refuses it; empty for one that moves."""


_ERD: Final = {
    "panda": ("panda_description/urdf/panda.urdf",),
    "panda_collision": ("panda_description/urdf/panda_collision.urdf",),
    "ur3": ("ur_description/urdf/ur3_robot.urdf",),
    "ur3_gripper": ("ur_description/urdf/ur3_gripper.urdf",),
    "ur5": ("ur_description/urdf/ur5_robot.urdf",),
    "ur5_gripper": ("ur_description/urdf/ur5_gripper.urdf",),
    "ur10": ("ur_description/urdf/ur10_robot.urdf",),
    "ur10_limited": ("ur_description/urdf/ur10_joint_limited_robot.urdf",),
    "kinova": ("kinova_description/robots/kinova.urdf",),
    "xarm7": ("xarm_description/urdf/xarm7.urdf",),
    "z1": ("z1_description/urdf/z1.urdf",),
    "so100": ("so_arm_description/urdf/so100.urdf",),
    "so101": ("so_arm_description/urdf/so101.urdf",),
    "talos_left_arm": ("talos_data/robots/talos_left_arm.urdf",),
    "tiago": ("tiago_description/robots/tiago.urdf",),
    "tiago_no_hand": ("tiago_description/robots/tiago_no_hand.urdf",),
    "borinot": ("borinot_description/urdf/borinot_flying_arm_2.urdf",),
    "hextilt": ("hextilt_description/urdf/hextilt_flying_arm_5.urdf",),
    "anymal_kinova": (
        "anymal_b_simple_description/robots/anymal-kinova.urdf", "j2s6s200_link_6",
    ),
    "b1_z1": ("b1_description/urdf/b1-z1.urdf", "gripperStator"),
    "alex": (
        "alex_description/urdf/alex_sake_hands.urdf", "LeftSakePalmLink", "RightSakePalmLink",
    ),
    "baxter": (
        "baxter_description/urdf/baxter.urdf", "left_gripper_base_link", "right_gripper_base_link",
    ),
    "centauro": ("centauro_description/urdf/centauro.urdf", "arm1_8", "arm2_8"),
    "g1": ("g1_description/urdf/g1_29dof_rev_1_0.urdf", "left_rubber_hand", "right_rubber_hand"),
    "human": ("human_description/robots/human.urdf", "left_hand", "right_hand"),
    "icub": ("icub_description/robots/icub.urdf", "l_hand", "r_hand"),
    "pr2": ("pr2_description/urdf/pr2.urdf", "l_gripper_tool_frame", "r_gripper_tool_frame"),
    "romeo": ("romeo_description/urdf/romeo.urdf", "l_wrist", "r_wrist"),
    "simple_humanoid": (
        "simple_humanoid_description/urdf/simple_humanoid.urdf", "l_wrist", "r_wrist",
    ),
    "talos": (
        "talos_data/robots/talos_full_v2.urdf", "gripper_left_base_link", "gripper_right_base_link",
    ),
    "tiago_dual": (
        "tiago_description/robots/tiago_dual.urdf", "hand_left_palm_link", "hand_right_palm_link",
    ),
    "tiago_pro": (
        "tiago_pro_description/robots/tiago_pro.urdf",
        "gripper_left_base_link", "gripper_right_base_link",
    ),
}  # fmt: skip
_BULLET: Final = {
    "iiwa": ("kuka_iiwa/model.urdf",),
    "bullet_panda": ("franka_panda/panda.urdf",),
    "xarm6": ("xarm/xarm6_robot.urdf",),
    "xarm6_gripper": ("xarm/xarm6_with_gripper.urdf",),
}
_RTB: Final = {
    "irb140": ("abb_irb140_description/urdf/irb140.urdf",),
    "kr16": ("kuka_description/kuka_kr16/urdf/kr16_2.urdf",),
    "kr120": ("kuka_description/kuka_kr120/urdf/kr120r2500pro.urdf",),
    "kr210": ("kuka_description/kuka_kr210/urdf/kr210l150.urdf",),
    "iiwa14": ("kuka_description/kuka_lbr_iiwa/urdf/lbr_iiwa_14_r820.urdf",),
    "al5d": ("lynxmotion_al5d_description/urdf/al5d_robot.urdf",),
    "puma560": ("unimation_puma560_description/urdf/puma560_robot.urdf",),
}

# A cylinder 2 m wide around all of its body, which tests a parser: an arm in there touches it
# wherever it is.
_REFUSED: Final = {"simple_humanoid": "none has room to move the tool"}


def published() -> list[Published]:
    """Return what is installed, of `example-robot-data`, pybullet and `rtb-data`."""
    places: list[tuple[Path, Mapping[str, tuple[str, ...]]]] = [
        (Path(folder) / _SHARE, _ERD) for folder in sys.path
    ]
    for package, under, listed in (("pybullet_data", "", _BULLET), ("rtbdata", "xacro", _RTB)):
        spec = find_spec(package)
        folders = [] if spec is None else spec.submodule_search_locations or []
        places += [(Path(folder) / under, listed) for folder in folders]
    there = {
        name: Published(name, folder / path, tuple(tips), _REFUSED.get(name, ""))
        for folder, listed in reversed(places)
        for name, (path, *tips) in listed.items()
        if (folder / path).is_file()
    }
    return sorted(there.values())
