"""Quirks that published robot descriptions have, one by one."""

import math

import numpy as np
import pytest
from laboratory.equipment.arms import read_arm
from telerobot.config.errors import ConfigError
from telerobot.config.load import load_cell
from telerobot.config.urdf.robot import read_robot
from telerobot.drivers.rig.physics.scene import build_model
from telerobot.tools.checks.findings import Severity
from telerobot.tools.checks.judge import judge
from telerobot.tools.cli import main
from telerobot.tools.init.make import make
from telerobot.tools.init.study import GRANTED, Study
from telerobot.tools.scripts.script import load_script


def made(odd, tmp_path, tip=None):
    """Return the draft that `init` makes, and its cell as the daemon loads it."""
    out = tmp_path / "odd.toml"
    found = make(read_arm(odd.write(), tip, {}), out)
    out.write_text(found.cell)
    out.with_name("odd_script.toml").write_text(found.script)
    return found.draft, load_cell(out)


def drive(draft, joint):
    return next(d for d in draft.drives if d.joint == joint)


def test_the_joint_that_turns_a_gripper_is_the_arms(odd):
    """Of the SO-100: `wrist_roll` carries the link `gripper`, on which the fingers hang."""
    odd.replace('"j6"', '"wrist_roll"').replace('"Link_6"', '"gripper_link"')
    arm = read_arm(odd.write(), None, {})
    assert arm.chain[-1].get("name") == "wrist_roll"
    assert arm.held == ["left_finger_joint", "right_finger_joint"]


def test_the_only_finger_of_a_gripper_is_no_part_of_the_arm(odd):
    odd.replace('"j6"', '"gripper_jaw"')
    odd.replace('type="prismatic"', 'type="fixed"')
    assert read_arm(odd.write(), None, {}).tip == "Link_5"


def test_an_arm_ends_where_a_hand_of_many_fingers_begins(odd):
    """Of Tiago's hand, whose fingers have three joints each."""
    joint = (
        '<joint name="{f}_{i}" type="revolute"><parent link="{above}"/><child link="{f}_{i}"/>'
        '</joint><link name="{f}_{i}"/>'
    )
    fingers = [
        joint.format(f=f, i=i, above=f"{f}_{i - 1}" if i else "Flange")
        for f in ("index", "ring", "little")
        for i in range(3)
    ]
    odd.replace('<link name="Flange"/>', '<link name="Flange"/>' + "".join(fingers))
    arm = read_arm(odd.write(), None, {})
    assert arm.tip == "Flange"
    assert len(arm.chain) == 6


def test_a_short_chain_called_a_finger_is_an_arm(odd):
    odd.joints = [(f"finger_{name}", *rest) for name, *rest in odd.joints[:3]]
    odd.replace('parent link="Link_6"', 'parent link="Link_3"')
    odd.replace('type="prismatic"', 'type="fixed"')
    assert len(read_arm(odd.write(), None, {}).chain) == 3


def test_an_arm_of_one_joint_is_refused(odd):
    urdf = odd.write()
    with pytest.raises(ConfigError) as caught:
        read_robot(urdf, "Link_1", "cell.toml: mechanism.tip_link")
    assert caught.value.messages == (
        f"cell.toml: mechanism.tip_link: value 'Link_1': only joint 'Shoulder/Pan' of {urdf} leads "
        "to it: must be at least 2 joints",
    )


def test_an_arm_of_five_joints_pushes_as_straight_as_it_can(odd, tmp_path):
    """Of the SO-100."""
    odd.joints = odd.joints[:5]
    odd.replace('parent link="Link_6"', 'parent link="Link_5"')
    draft, cell = made(odd, tmp_path)
    study = Study(cell, draft.length)
    assert study.mechanism.rank == 5
    ready = np.array(draft.postures["ready"])
    forward = study.tool_pose(ready).R @ (draft.mrf / np.linalg.norm(draft.mrf))
    toward = np.concatenate([forward, np.zeros(3)])
    granted = study.granted(ready, toward)
    assert GRANTED < granted <= 1.0 + 1e-9
    assert study.walk(ready, toward, 0.06, 0.0) is not None
    # Independent: the twist nearest to `toward` that joint rates give, in the study's weights.
    weight = np.array([1.0] * 3 + [draft.length] * 3)
    J = study.mechanism.kinematics(ready, study.tool).J * weight[:, None]
    rates = np.linalg.lstsq(J, toward, rcond=None)[0]
    assert granted == pytest.approx(1.0 - np.linalg.norm(J @ rates - toward) ** 2, abs=1e-3)


def test_an_arm_that_cannot_go_straight_is_not_made_to_press_a_wall(odd, tmp_path, capsys):
    """It would slide along the wall, and friction would decide what it presses."""
    odd.joints = odd.joints[:2]
    odd.replace('parent link="Link_6"', 'parent link="Link_2"')
    out = tmp_path / "odd.toml"
    assert main(["init", str(odd.write()), "--out", str(out)]) == 0
    assert "cannot go straight at a wall: the script does not push" in capsys.readouterr().out
    script = load_script(str(out.with_name("odd_script.toml")))
    assert script.expect is not None
    assert script.expect.contact_force_n is None


def test_a_tool_looks_away_from_the_arm_where_the_last_link_lies_behind_its_frame(odd, tmp_path):
    """Of the xArm: the frame of the last link is its flange, in the last joint's own place."""
    odd.replace('"Flange"/><origin xyz="0 0 0.05"/>', '"Flange"/>')
    mesh = '<mesh filename="package://odd_description/meshes/link6.stl"'
    odd.replace(f"<geometry>{mesh}", f'<origin xyz="0 0 -0.05"/><geometry>{mesh}')
    draft, _ = made(odd, tmp_path)
    assert draft.mrf[2] > 0.03
    assert draft.mrf[:2] == pytest.approx([0.0, 0.0])


def test_a_frame_with_a_token_mass_needs_no_shape(odd, tmp_path):
    """Of the SO-101: a frame of 1e-9 kg and no inertia."""
    odd.replace(
        '<link name="Flange"/>',
        '<link name="Flange"><inertial><mass value="1e-9"/><inertia ixx="0" ixy="0" ixz="0" '
        'iyy="0" iyz="0" izz="0"/></inertial></link>',
    )
    draft, cell = made(odd, tmp_path)
    assert draft.arm.inertials == []
    assert "Flange" not in cell.robot.unshaped_links()


def test_a_mass_without_a_shape_gets_a_ball(odd, tmp_path):
    odd.replace(
        '<link name="Flange"/>',
        '<link name="Flange"><inertial><origin xyz="0 0 0.03"/><mass value="0.4"/><inertia '
        'ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>',
    )
    _, cell = made(odd, tmp_path)
    (ball, _) = [c for c in cell.config.avoidance.capsules if c.link == "Flange"]  # and the stalk
    assert ball.start == ball.end == (0.0, 0.0, 0.03)
    assert 4.0 / 3.0 * math.pi * ball.radius**3 == pytest.approx(0.4 / 1000.0, rel=0.02)


def test_an_inertia_that_misses_a_body_by_rounding_is_taken(odd, tmp_path):
    """Of the xArm with its gripper: A + B is 1 % below C, which MuJoCo refuses."""
    urdf = odd.write()
    text = urdf.read_text()
    at = text.index('<link name="Link_2">')
    end = text.index("</inertial>", at)
    urdf.write_text(
        text[:at]
        + '<link name="Link_2"><inertial><origin xyz="0 0 0.1"/><mass value="3"/><inertia '
        'ixx="0.02" ixy="0.001" ixz="0" iyy="0.0101" iyz="0" izz="0.0099"/>' + text[end:]
    )
    assert read_arm(urdf, None, {}).inertials == []
    I = np.array([[0.02, 0.001, 0.0], [0.001, 0.0101, 0.0], [0.0, 0.0, 0.0099]])  # noqa: E741
    a, b, c = np.linalg.eigvalsh(I)
    assert 0.98 * c < a + b < c
    described = read_robot(urdf, "Flange", "here").description()
    values = {
        name: float(described.partition('name="Link_2"')[2].partition(f'{name}="')[2].split('"')[0])
        for name in ("ixx", "ixy", "iyy", "izz")
    }
    J = np.array(
        [
            [values["ixx"], values["ixy"], 0],
            [values["ixy"], values["iyy"], 0],
            [0, 0, values["izz"]],
        ]
    )
    assert np.linalg.eigvalsh(J)[:2] == pytest.approx([a, b], rel=1e-6)
    assert np.linalg.eigvalsh(J)[2] == pytest.approx(a + b, rel=1e-6)
    out = tmp_path / "odd.toml"
    out.write_text(
        make(read_arm(urdf, None, {}), out).cell.replace("./odd_script.toml", "pose_move")
    )
    build_model(load_cell(out))


def test_a_torque_that_holds_the_arm_in_part_of_its_postures_is_kept(odd, tmp_path):
    """Of Talos: stretched out, the shoulder takes more than the URDF says that it has."""
    limit = '<limit lower="-2.0" upper="2.0" velocity="2" effort='
    odd.replace(f'{limit}"150"', f'{limit}"22"')
    draft, cell = made(odd, tmp_path)
    shoulder = drive(draft, "Link_2")
    assert shoulder.torque == 22.0
    assert "does not hold the arm everywhere" in shoulder.notes[0]
    told = {f.check: f for f in judge(cell)}
    assert [f.text for f in told.values() if f.status is Severity.ERROR] == []
    assert told["holding ready"].values["share"] < 0.7
    assert told["holding start"].values["share"] < 0.7


def test_a_torque_that_holds_nothing_is_none(odd, tmp_path):
    limit = '<limit lower="-2.0" upper="2.0" velocity="2" effort='
    odd.replace(f'{limit}"150"', f'{limit}"1"')
    draft, _ = made(odd, tmp_path)
    assert drive(draft, "Link_2").torque > 50.0
    assert "would not hold the arm" in drive(draft, "Link_2").notes[0]


def test_limits_that_are_missing_or_absurd_are_made_up_and_named(odd, tmp_path):
    odd.replace('lower="-2.9" upper="2.9" velocity="2" effort="150"', 'lower="-1e6" upper="1e6"')
    odd.replace('lower="-2.4" upper="2.4" velocity="2"', 'lower="-2.4" upper="2.4" velocity="1e9"')
    odd.replace('lower="-3.0" upper="3.0" velocity="2" effort="150"', 'effort="1e12"')
    draft, cell = made(odd, tmp_path)
    pan, flex, last = (drive(draft, name) for name in ("Shoulder/Pan", "elbow.flex", "j6"))
    assert (pan.lower, pan.upper) == pytest.approx((-2 * math.pi, 2 * math.pi))
    assert "the URDF has no speed limit of Shoulder/Pan" in pan.notes
    assert "the URDF's torque limit of Shoulder/Pan is missing, or absurd" in pan.notes
    assert flex.velocity <= 1.5
    assert (last.lower, last.upper) == (-3.0, 3.0)
    assert last.torque < 1e4
    continuous = next(j for j in cell.robot.joints if j.name == "Forearm Roll")
    assert continuous.upper == pytest.approx(2 * math.pi)


def test_a_link_and_a_joint_may_have_one_name(odd, tmp_path):
    """The odd arm's second joint is called as its second link."""
    _, cell = made(odd, tmp_path)
    assert "Link_2" in cell.joints
    assert "Link_2" in cell.robot.links()
    model, _ = build_model(cell)
    assert model.nv == 6 + 1  # and the wall's


def test_all_mistakes_of_a_description_are_told_at_once(odd):
    odd.replace('velocity="2" effort="150"/>', 'velocity="two" effort="150"/>')
    urdf = odd.write()
    with pytest.raises(ConfigError) as caught:
        read_robot(urdf, "Flange", "here")
    assert len(caught.value.messages) == 6
