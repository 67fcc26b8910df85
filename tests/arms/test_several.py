"""Several arms of one file become one cell; what carries them stands; hands are no arms."""

import pytest
from telerobot.config.errors import ConfigError
from telerobot.config.urdf.robot import read_robot

from .twins import write_twins


def test_one_of_two_arms_of_a_file_is_read_without_the_other(tmp_path):
    urdf = write_twins(tmp_path)
    robot = read_robot(
        urdf, "left_gripper", "cell: mechanism.tip_link",
        first_joint="left_joint_1", without=("right_1",),
    )  # fmt: skip
    assert [joint.name for joint in robot.joints] == [f"left_joint_{i}" for i in range(1, 7)]
    assert {"torso", "left_6"} < set(robot.links())
    assert not {link for link in robot.links() if link.startswith("right_") and "wheel" not in link}
    assert "right_" not in robot.description().replace("right_wheel", "")
    rest = read_robot(
        urdf, "right_gripper", "cell: mechanism.tip_link",
        first_joint="right_joint_1", without=("floor",),
    )  # fmt: skip
    shaped = {link.get("name") for link in rest.tree().findall("link") if link.find("collision")
              is not None}  # fmt: skip
    assert shaped == {
        *(f"right_{i}" for i in range(1, 7)),
        *(x for x in rest.links() if "grip" in x),
    }


@pytest.mark.parametrize(
    ("first", "without", "told"),
    [
        ("left_joint_9", (), "first_joint: value 'left_joint_9': no movable joint on the way"),
        ("right_joint_1", (), "first_joint: value 'right_joint_1': no movable joint on the way"),
        ("left_joint_1", ("right_9",), "without: value 'right_9': no such link"),
        (None, ("right_1",), "without: needs first_joint"),
        (
            "left_joint_4",
            ("left_5",),
            "without: value 'left_5': first_joint 'left_joint_4' carries",
        ),
    ],
)
def test_a_part_of_a_file_that_is_none_is_refused(tmp_path, first, without, told):
    with pytest.raises(ConfigError, match=told):
        read_robot(
            write_twins(tmp_path), "left_gripper", "cell: mechanism.tip_link",
            first_joint=first, without=without,
        )  # fmt: skip
