"""Several arms of one file become one cell; what carries them stands; hands are no arms."""

import numpy as np
import pytest
from laboratory.equipment.arms import read_arm
from telerobot.config.errors import ConfigError
from telerobot.config.load import load_cell
from telerobot.config.urdf.robot import read_robot
from telerobot.config.urdf.shapes import Tube
from telerobot.server.control.proximity.capsules import Capsules
from telerobot.tools.cli import main
from telerobot.tools.init.capsules import Fit, Place, merged
from telerobot.tools.init.robot import read_arms
from telerobot.tools.simulation.simulation import simulate

from .twins import write_twins

TIPS = ["left_gripper", "right_gripper"]


@pytest.fixture(scope="module")
def twins(tmp_path_factory):
    """Return the cell that `init` makes of a robot with two arms, and what it said."""
    folder = tmp_path_factory.mktemp("twins")
    urdf, out = write_twins(folder), folder / "twins.toml"
    tips = [word for tip in TIPS for word in ("--tip", tip)]
    assert main(["init", str(urdf), *tips, "--out", str(out)]) == 0
    return out


def test_two_arms_of_one_file_share_no_link_and_stand_on_one_torso(twins):
    left, right = load_cell(twins).parts
    assert [part.config.mechanism.name for part in (left, right)] == ["left", "right"]
    assert "torso" in left.robot.links()
    assert not any("right_" in link and "wheel" not in link for link in left.robot.links())
    assert not any("left_" in link for link in right.robot.links())
    for part in (left, right):
        side = part.config.mechanism.name
        assert [j.name for j in part.robot.joints] == [f"{side}_joint_{i}" for i in range(1, 7)]
    solid = [c.link for c in Capsules(load_cell(twins)).each]
    assert "left.torso" in solid, "the torso is one mechanism's"
    assert not any(link.startswith("right.") and "torso" in link for link in solid)


def test_two_arms_of_one_file_move_and_never_touch_each_other(twins):
    result = simulate(twins)
    assert [row for row in result.expected if not row.met] == []
    assert result.summary["limit_violations"] == 0
    assert result.summary["own_contact_n"] == 0.0
    assert result.summary["min_between_arms_m"] > 0.005
    moved = np.ptp([s.q for s in result.states], axis=0)
    assert (moved[[0, 6]] > 0.0).all(), "both arms move"


def test_an_arm_that_is_driven_at_the_other_stops_short_of_it(twins):
    """The other arm is a body that moves, not a phantom at zero: the command keeps clear."""
    script = twins.with_name("meet.toml")
    steps = [
        f'[[step]]\nat_s = 0.2\n"cmd/posture" = {{ mechanism = "{side}", posture = "ready" }}'
        for side in ("left", "right")
    ]
    for side, sign in (("left", -1), ("right", 1)):
        twist = f"[0.0, {0.2 * sign}, 0.0, 0.0, 0.0, 0.0]"
        stick = f'{{ task = "{side}", twist = {twist}, expressed_in = "world" }}'
        steps += [f'[[step]]\nat_s = 4.0\nfor_s = 5.0\n"cmd/joystick" = {stick}']
    script.write_text("\n".join(["duration_s = 9.5", *steps]))
    result = simulate(twins, str(script))
    assert result.summary["failure"] is None
    assert 0.0 < result.summary["min_between_arms_m"] < 0.1
    assert result.summary["own_contact_n"] == 0.0


@pytest.mark.parametrize(
    ("base", "held"), [("planar", ["drive"]), ("virtual", ["slide_x", "turn"])]
)
def test_a_base_that_moves_is_held_and_no_drive_of_the_arm(tmp_path, base, held):
    arm = read_arm(write_twins(tmp_path, base), "left_gripper", {})
    assert arm.chain[0].get("name") == "lift"
    assert arm.first_joint == "lift"
    assert all(any(name in told for told in arm.standing) for name in held)


def test_a_gripper_is_told_and_is_no_joint_of_the_arm(tmp_path, capsys):
    urdf = write_twins(tmp_path)
    arm = read_arms(urdf, TIPS, {})[0]
    assert arm.fingers == ["left_gripper_finger_1", "left_gripper_finger_2"]
    assert (
        main(["init", str(urdf), "--tip", "left_gripper", "--out", str(tmp_path / "a.toml")]) == 0
    )
    said = capsys.readouterr().out
    assert "a gripper, no joints of the arm: left_gripper_finger_1" in said
    assert "stands on joints that are held: drive (planar)" in said
    assert "the tool is at" in said


def test_two_tips_of_one_chain_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="give one --tip for each arm"):
        read_arms(write_twins(tmp_path), ["left_3", "left_gripper"], {})


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


def test_first_joint_and_without_are_judged(twins):
    text = twins.read_text()
    for old, new, told in (
        ('first_joint = "left_joint_1"', 'first_joint = "right_joint_1"', "no movable joint"),
        ('without = ["right_1"]', 'without = ["right_9"]', "no such link"),
    ):
        assert old in text
        other = twins.with_name("wrong.toml")
        other.write_text(text.replace(old, new))
        with pytest.raises(ConfigError, match=told):
            load_cell(other)


def test_capsules_of_what_stands_are_merged_until_there_is_room():
    draw, eye = np.random.default_rng(0), np.eye(3)
    fits, places = [], {}
    for i in range(12):
        start = draw.uniform(-0.3, 0.3, 3)
        link, body = f"link_{i}", "" if i < 9 else f"joint_{i}"
        fits.append(Fit(link, (Tube(start, start + draw.uniform(0, 0.2, 3), 0.03),), 1.0, "it"))
        places[link] = Place(body, eye, draw.uniform(-0.2, 0.2, 3))
    kept = merged(fits, places, 6)
    assert sum(len(fit.tubes) for fit in kept) <= 6
    assert {f"link_{i}" for i in (9, 10, 11)} <= {fit.link for fit in kept if not fit.holds}
    assert {fit.link for fit in kept} | {link for fit in kept for link in fit.holds} == set(places)
    for fit in fits:  # whatever lay inside the first ones lies inside those that are left
        for end in (fit.tubes[0].start, fit.tubes[0].end):
            normals = draw.normal(size=(50, 3))
            ball = end + 0.0299 * normals / np.linalg.norm(normals, axis=1)[:, None]
            around = ball + places[fit.link].p
            inside = [
                tube.holds(around - places[other.link].p)
                for other in kept
                if places[other.link].body == places[fit.link].body
                for tube in other.tubes
            ]
            assert np.any(inside, axis=0).all()
