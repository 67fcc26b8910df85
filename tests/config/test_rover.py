"""A rover's cell: what cannot be is refused before anything moves, with file and key."""

import mujoco
import numpy as np
import pytest
from telerobot.config.load import ConfigError, load_cell
from telerobot.drivers.rig.physics.scene import build_model
from telerobot.drivers.rig.physics.world import World


def two(first, second):
    return "\n".join(
        (
            'name = "two"\ndefault_script = "drive_and_reach"',
            '[[buses]]\nname = "a"\nchannel = "239.74.163.20"',
            '[[buses]]\nname = "b"\nchannel = "239.74.163.21"',
            f'[[mechanisms]]\nname = "a"\nbus = "a"\nlike = "{first}"',
            f'[[mechanisms]]\nname = "b"\nbus = "b"\nlike = "{second}"',
            "T_world_base = { xyz = [0.0, 2.0, 0.0] }",
        )
    )


@pytest.mark.parametrize(
    ("pair", "places"),
    [
        (("rover", "rover"), ["mechanisms[1].base"]),
        (("pa10", "rover"), ["mechanisms[1].base"]),
    ],
)
def test_only_the_first_of_several_mechanisms_may_drive(cell, pair, places):
    with pytest.raises(ConfigError) as refused:
        cell(two(*pair))
    assert len(refused.value.messages) == len(places)
    for message, place in zip(refused.value.messages, places, strict=True):
        words = "a mechanism on wheels must be the first of its cell, and the only one there"
        assert f"cell.toml: {place}: {words}" in message


def test_wheels_that_follow_others_are_simulated_for_an_only_mechanism(cell):
    words = r"mechanisms\[0\].base.wheels.followers: value .*: the virtual hardware has them for"
    with pytest.raises(ConfigError, match=words):
        cell(two("rover_skid", "pa10"))


def test_a_rover_beside_an_arm_is_a_cell(cell):
    assert [
        part.config.mechanism.base is not None for part in cell(two("rover", "pa10")).parts
    ] == [
        True,
        False,
    ]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ('[scanner]\nlink = "head"', "scanner: there are several mechanisms: give it to the one"),
        ('[mechanisms.scanner]\nlink = "flange"',
         r"mechanisms\[1\].scanner: looks ahead of the first mechanism of a cell only"),
        ("[mechanisms.frames.base]",
         r"mechanisms\[1\].frames.base: a scanner knows the rays on this mechanism by where"),
    ],
)  # fmt: skip
def test_a_scanner_looks_ahead_of_the_first_of_several_mechanisms(cell, more, words):
    first, second = cell(two("rover_bridge", "pa10")).parts
    assert (first.config.scanner.link, second.config.scanner) == ("head", None)
    with pytest.raises(ConfigError, match=words):
        cell(two("rover_bridge", "pa10") + "\n" + more)


def test_a_contour_without_a_scanner_is_refused(cell):
    contour = '[contour]\nshoulder = "j2"\nelbow = "j4"'
    with pytest.raises(ConfigError, match=r"contour: there is no \[scanner\] that sees it"):
        cell(f'extends = "rover"\n{contour}')


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ('shoulder = "j22"', r"contour.shoulder: value 'j22': no such joint of the arm; did you"),
        ('elbow = "tilt"', r"contour.elbow: value 'tilt': no such joint of the arm"),
    ],
)
def test_joints_of_the_contour_are_the_arms(cell, line, words):
    with pytest.raises(ConfigError, match=words):
        cell(f'extends = "rover_bridge"\n[contour]\n{line}')


NEWS = {"speed": 0.6, "angular_speed": 1.2, "acceleration": 1.0, "angular_acceleration": 4.0}


def told(**changed):
    lines = "\n".join(f"{key} = {value}" for key, value in (NEWS | changed).items())
    return f'extends = "rover"\n[frames.base]\n{lines}'


def test_news_of_a_base_on_wheels_is_believed_as_fast_as_the_wheels_go(cell):
    assert cell(told()).config.frames.base.speed == 0.6
    for key, value, bound in (
        ("speed", 0.4, "0.5"),
        ("angular_speed", 0.5, "1,"),
        ("acceleration", 0.5, "0.96"),
        ("angular_acceleration", 2.0, "3.84"),
    ):
        with pytest.raises(ConfigError) as refused:
            cell(told(**{key: value}))
        words = f"frames.base.{key}: value {value:g}: must be at least {bound}"
        assert words in str(refused.value)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (
            ('left = "wheel_left"', 'left = "wheel_lift"'),
            "value 'wheel_lift': no joint on the root",
        ),
        (('left = "wheel_left"', 'left = "j1"'), "must be of type continuous, about axis 0 1 0"),
        (('joint = "tilt"\nlow', 'joint = "tilts"\nlow'), "value 'tilts': no joint on the root"),
        # What may meet things may fall behind; an axis that only looks, and sticks, looks nowhere.
        (("following_window = 0.06\n", ""), "value 'tilt': its drive must tell following_window"),
    ],
)
def test_joints_beside_the_chain_are_on_the_root_link(cell, wrong, words):
    text = (load_cell("rover_bridge").path).read_text()
    assert wrong[0] in text
    with pytest.raises(ConfigError) as refused:
        cell(text.replace(*wrong))
    assert words in str(refused.value)


WHEEL = '<origin xyz="0 0.25 0.12"/>\n    <axis xyz="0 1 0"/>'
"""Place and axis of the rover's left wheel in its URDF."""


CHASSIS = '<collision><origin xyz="0.2 0 0.42"/><geometry><cylinder radius="0.06" length="0.16"/>'


def altered(cell, tmp_path, old, new):
    """Load the rover with another text in its URDF."""
    text = load_cell("rover").robot.urdf.read_text()
    assert old in text
    (tmp_path / "altered.urdf").write_text(text.replace(old, new))
    rover = load_cell("rover").path.read_text()
    return cell(rover.replace('urdf = "rover"', 'urdf = "./altered.urdf"'))


def turned(cell, tmp_path, rpy, axis):
    """Load the rover with its left wheel's joint turned, and so its axis."""
    wheel = f'<origin xyz="0 0.25 0.12" rpy="{rpy}"/><axis xyz="{axis}"/>'
    return altered(cell, tmp_path, WHEEL, wheel)


def test_a_wheels_axis_is_judged_where_its_joint_is_turned_to(cell, tmp_path):
    rover = turned(cell, tmp_path, "-1.5707963 0 0", "0 0 1")
    assert rover.joints[0] == "wheel_left"
    model, _ = build_model(rover)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    tyre = data.geom("wheel_left_tyre")
    assert np.abs(tyre.xmat.reshape(3, 3)[:, 1]) == pytest.approx([0.0, 1.0, 0.0], abs=1e-6)
    for rpy, axis in (("0 0 0", "0 0 1"), ("-1.5707963 0 0", "0 1 0")):
        with pytest.raises(
            ConfigError, match="must be of type continuous, about axis 0 1 0 of Base"
        ):
            turned(cell, tmp_path, rpy, axis)


@pytest.mark.parametrize(
    ("rpy", "axis"), [("0 0 0", "0 -1 0"), ("1.57 0 0", "0 0 1"), ("0 0 3.14159", "0 1 0")]
)
def test_a_wheel_that_turns_about_minus_y_drives_ahead_by_positive_angles(
    cell, tmp_path, rpy, axis
):
    rover = turned(cell, tmp_path, rpy, axis)
    model, _ = build_model(rover)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    assert data.joint("wheel_left").xaxis == pytest.approx([0.0, 1.0, 0.0], abs=1e-3)
    tyre = data.geom("wheel_left_tyre").xmat.reshape(3, 3)
    assert np.abs(tyre[:, 1]) == pytest.approx([0.0, 1.0, 0.0], abs=1e-3)


def test_a_chassis_whose_shape_reaches_below_the_floor_stands_on_its_wheels(cell, tmp_path):
    """As a capsule around a flat one does: the floor would throw it up."""
    low = '<collision><origin xyz="0.1 0 0.2"/><geometry><sphere radius="0.3"/>'
    rover = altered(cell, tmp_path, CHASSIS, low)
    model, _ = build_model(rover)
    data = mujoco.MjData(model)
    for _ in range(200):
        mujoco.mj_step(model, data)
    base = int(model.joint("base_free").qposadr[0])
    assert data.qpos[base + 2] == pytest.approx(0.0, abs=0.01)
    assert np.abs(data.qvel[model.joint("base_free").dofadr[0] :][:3]).max() < 0.05


def test_a_base_with_a_contour_ahead_does_not_move_by_itself(cell):
    words = r"mechanism.base.objectives: value 'posture': a base with a \[contour\] ahead drives"
    with pytest.raises(ConfigError, match=words):
        cell('extends = "rover_bridge"\n[mechanism.base]\nobjectives = ["posture"]')


def test_a_base_takes_part_in_objectives_of_the_arms_posture_alone(cell):
    with pytest.raises(ConfigError, match=r"mechanism.base.objectives\[0\]: .*'along'"):
        cell('extends = "rover"\n[mechanism.base]\nobjectives = ["along"]')


def test_a_search_of_the_least_potential_takes_base_to_stand(cell):
    with pytest.raises(ConfigError, match=r"potential.search: value 2: .*\[mechanism.base\]"):
        cell('extends = "rover"\n[potential]\nsearch = 2')


@pytest.mark.parametrize(
    ("wheels", "words"),
    [
        ('followers = ["wheel_left"]', "wheels: followers: 'wheel_left' is named twice"),
        (
            'followers = ["wheel_left_back"]',
            "wheels.followers[0]: value 'wheel_left_back': no joint on the root link",
        ),
        ('followers = ["j1"]', "wheels.followers[0]: value 'j1': must be of type continuous"),
        ("slip_factor = 0.9", "wheels.slip_factor: value 0.9: "),
    ],
)
def test_wheels_that_follow_are_wheels_of_the_base_without_a_drive(cell, wheels, words):
    with pytest.raises(ConfigError) as refused:
        cell(f'extends = "rover_skid"\n[mechanism.base.wheels]\n{wheels}')
    assert words in str(refused.value)


def test_a_wheel_that_follows_has_no_drive(cell):
    text = load_cell("rover").path.read_text().replace('urdf = "rover"', 'urdf = "rover_skid"')
    drive = text[text.index("[[mechanism.drives]]") :].split("\n\n")[0]
    drive = drive.replace("wheel_left", "wheel_left_rear").replace("node = 1", "node = 30")
    text = text.replace("track = 0.50 }", 'track = 0.50, followers = ["wheel_left_rear"] }')
    with pytest.raises(ConfigError) as refused:
        cell(text.replace("[[mechanism.drives]]", f"{drive}\n\n[[mechanism.drives]]", 1))
    words = "wheels.followers[0]: value 'wheel_left_rear': must have no drive"
    assert words in str(refused.value)


def test_wheels_that_follow_turn_with_the_driven_one_of_their_side_and_slip_with_it():
    cell = load_cell("rover_skid")
    world = World(cell)
    for joint in range(world.n):
        world.set_brake(joint, closed=joint > 1)
    for _ in range(300):
        world.step(np.array([20.0, -20.0, *[0.0] * 7]))
    speed = {
        name: float(world.data.joint(name).qvel[0])
        for name in ("wheel_left", "wheel_left_rear", "wheel_right", "wheel_right_rear")
    }
    assert speed["wheel_left"] > 0.05
    assert speed["wheel_right"] < -0.05
    for side in ("wheel_left", "wheel_right"):
        assert speed[f"{side}_rear"] == pytest.approx(speed[side], abs=0.05)

    def grips() -> list[float]:
        names = ("wheel_left_tyre", "wheel_left_tyre_wheel_left_rear", "wheel_right_tyre")
        return [float(world.model.geom(name).friction[0]) for name in names]

    before = grips()
    world.set_grip(0, 0.01)
    assert grips() == [0.01, 0.01, before[2]]
    world.set_grip(0)
    assert grips() == before
