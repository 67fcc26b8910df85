"""Two driven wheels on one axle become the base of a cell; other bases are held, with a reason."""

import math
import re

import mujoco
import numpy as np
import pytest
from laboratory.campaign.urdfs.trial import try_arm
from laboratory.equipment.arms import read_arm
from telerobot.config.errors import ConfigError
from telerobot.config.load import load_cell
from telerobot.drivers.rig.physics.scene import build_model
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.spatial import Pose
from telerobot.tools.cli import main
from telerobot.tools.init.draft import Wheels
from telerobot.tools.init.make import make
from telerobot.tools.init.wheels import base_of

from .rovers import LEFT, OVER_FLOOR, RADIUS, RIGHT, TRACK, Wheel, write_rover
from .twins import JOINTS, write_twins

BACKWARD = {"rpy": "1.57 0 0"}
"""The joint's own z axis is -y of the chassis."""


def base(urdf, tip=None):
    return base_of([read_arm(urdf, tip, {})], {})


@pytest.mark.parametrize(
    ("wheels", "rest"),
    [
        ((LEFT, RIGHT), {}),
        ((RIGHT, LEFT), {}),
        ((LEFT._replace(**BACKWARD), RIGHT), {}),
        ((LEFT._replace(axis="0 0 -1"), RIGHT._replace(**BACKWARD)), {}),
        ((LEFT._replace(axis="0 0 2"), RIGHT), {}),
        ((LEFT, RIGHT), {"lower": RADIUS}),
        ((LEFT, RIGHT), {"suspension": "prismatic"}),
        ((LEFT, RIGHT), {"before": [("planar", "0 0 1")]}),
        ((LEFT, RIGHT), {"before": OVER_FLOOR}),
        ((LEFT, RIGHT, Wheel("caster", (0.2, 0.0, RADIUS))), {}),
        ((LEFT, RIGHT, Wheel("scanner_motor", (0.2, 0.0, 0.4), rpy="0 0 0", axis="0 1 0")), {}),
    ],
)
def test_two_wheels_on_one_axle_are_found(tmp_path, wheels, rest):
    found = base(write_rover(tmp_path, wheels, **rest))
    assert isinstance(found, Wheels)
    assert [drive.joint for drive in found.drives] == ["left_wheel", "right_wheel"]
    assert (found.radius, found.track) == (pytest.approx(RADIUS), pytest.approx(TRACK))
    assert found.height == pytest.approx(rest.get("lower", 0.0), abs=1e-4)


def shifted(wheel, x=0.0, y=0.0, z=0.0, **changed):
    place = tuple(float(a + b) for a, b in zip(wheel.xyz, (x, y, z), strict=True))
    return wheel._replace(xyz=place, **changed)


REAR = [shifted(wheel, x=-0.3, name=f"rear_{wheel.name}") for wheel in (LEFT, RIGHT)]
OMNI = [
    Wheel(f"wheel_{i}", (0.2 * math.cos(a), 0.2 * math.sin(a), RADIUS), rpy=f"-1.57 0 {a - 1.57}")
    for i, a in enumerate((0.0, 2.1, 4.2))
]


@pytest.mark.parametrize(
    ("wheels", "rest", "told"),
    [
        ((LEFT, RIGHT, *REAR), {}, "4 wheels drive it, not two on one axle: left_wheel, right_w"),
        (OMNI, {}, "3 wheels drive it"),
        (OMNI[1:], {}, "its wheels must turn about the root link's y axis: wheel_"),
        ((LEFT,), {}, "1 wheels drive it"),
        (
            (LEFT, RIGHT._replace(radius=0.09)),
            {},
            "left_wheel and right_wheel have different radii: 0.1 and 0.09 m",
        ),
        ((LEFT, shifted(RIGHT, x=0.1)), {}, "left_wheel and right_wheel are not on one axle"),
        (
            (shifted(LEFT, x=0.1), shifted(RIGHT, x=0.1)),
            {},
            "the middle of left_wheel and right_wheel is at x 0.1, y 0 m of the root link",
        ),
        ((), {"before": [("planar", "0 0 1")]}, "no wheels drive it: over_floor (planar)"),
        ((), {"before": OVER_FLOOR}, "no wheels drive it: over_floor (prismatic), over_floor_ (pr"),
        ((LEFT, RIGHT), {"suspension": "revolute"}, "no wheel of it is on its chassis and turns"),
    ],
)
def test_any_other_base_is_held_with_its_reason(tmp_path, wheels, rest, told):
    found = base(write_rover(tmp_path, wheels, **rest))
    assert isinstance(found, str)
    assert told in found


@pytest.mark.parametrize(
    ("axis", "told"),
    [
        ("a 0 1", "joint 'left_wheel': <axis xyz>: value 'a 0 1'"),
        ("0 1", "joint 'left_wheel': <axis xyz>: value '0 1'"),
        ("0 nan 1", "joint 'left_wheel': <axis xyz>: value '0 nan 1'"),
    ],
)
def test_a_wheel_whose_axis_cannot_be_read_is_refused(tmp_path, axis, told):
    with pytest.raises(ConfigError, match=re.escape(told)):
        base(write_rover(tmp_path, (LEFT._replace(axis=axis), RIGHT)))


def test_wheels_are_found_beside_a_link_whose_inertia_no_body_can_have(tmp_path):
    urdf = write_rover(tmp_path)
    assert 'mass value="0.3"/><inertia ixx="0.003"' in urdf.read_text()
    urdf.write_text(urdf.read_text().replace('<inertia ixx="0.003"', '<inertia ixx="3"'))
    assert isinstance(base(urdf), Wheels)


@pytest.mark.parametrize(
    ("limit", "told"),
    [
        ('velocity="10" effort="20"', []),
        ('velocity="10"', ["torque limit of {} is missing, or absurd"]),
        ('velocity="10" effort="0.1"', ["torque limit of {} is 0.1, and would not drive the base"]),
        ('velocity="10" effort="1e9"', ["torque limit of {} is missing, or absurd"]),
        ('effort="20"', ["no speed limit of {}"]),
        ("", ["no speed limit of {}", "torque limit of {} is missing"]),
    ],
)
def test_a_wheels_drive_moves_the_base_and_stops_it_within_a_second(tmp_path, limit, told):
    """Closed form: half of the mass at the rim, by 1 m/s² at most."""
    urdf = write_rover(tmp_path)
    urdf.write_text(urdf.read_text().replace('velocity="10" effort="20"', limit))
    found, mass = base(urdf), 30.0 + 2.0 + 0.4 + sum(row[4] for row in JOINTS)
    assert isinstance(found, Wheels)
    for drive in found.drives:
        words = zip(told, drive.notes, strict=True)
        assert all(each.format(drive.joint) in note for each, note in words)
        assert 0.05 * mass * RADIUS <= drive.acceleration * 0.5 * mass * RADIUS**2 <= drive.torque
        assert drive.acceleration * RADIUS <= 1.0
        assert drive.velocity <= 0.9 * drive.acceleration
        assert 0.5 * TRACK * found.angular_speed + found.speed <= drive.velocity * RADIUS


def test_an_arm_that_stands_has_no_base(tmp_path, odd):
    assert base(write_rover(tmp_path, ())) is None
    assert base(odd.write()) is None


def test_the_wheels_of_two_arms_are_held(tmp_path, capsys):
    urdf, out = write_twins(tmp_path), tmp_path / "twins.toml"
    assert isinstance(base(urdf, "left_gripper"), Wheels)
    tips = ["--tip", "left_gripper", "--tip", "right_gripper"]
    assert main(["init", str(urdf), *tips, "--out", str(out)]) == 0
    told = "left_wheel_joint, right_wheel_joint drive it, but a cell of several arms has no base"
    assert f"base: held: {told}" in capsys.readouterr().out
    assert f"# The base is held: {told}" in out.read_text()


def test_a_rover_goes_from_its_urdf_to_motion(tmp_path, capsys):
    """One wheel turns about -y, its joint a right angle only nearly; the root link is as high as
    the axle; wheels hang on springs: ahead is ahead in the physics, and odometry knows where."""
    wheels = (LEFT._replace(**BACKWARD), RIGHT)
    urdf = write_rover(tmp_path, wheels, lower=RADIUS, suspension="prismatic")
    trial = try_arm("rover", urdf, folder=None)
    assert trial.reasons == []
    out = tmp_path / "rover.toml"
    assert main(["init", str(urdf), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "base: drives on left_wheel and right_wheel, radius 0.1 m, track 0.5 m" in said
    assert "held at zero: left_wheel_hangs, right_wheel_hangs, turns, follows\n" in said
    cell = load_cell(out)
    assert cell.config.mechanism.mode_of(cell.config.mechanism.drives[0]) == "csv"


def test_the_script_names_its_target_as_seen_from_a_base_above_the_floor(tmp_path):
    arm = read_arm(write_rover(tmp_path, lower=RADIUS), None, {})
    out = tmp_path / "rover.toml"
    made = make(arm, out, base_of([arm], {}))
    out.write_text(made.cell)
    out.with_name("rover_script.toml").write_text(made.script)
    mechanism = Mechanism.from_cell(load_cell(out))
    assert mechanism.T_world_base.p[2] == pytest.approx(RADIUS)
    target = made.draft.passes[4]  # half the way to `start`, all of it; half the way here
    T_wrist_mrf = Pose(np.eye(3), made.draft.mrf)
    T_world_mrf = mechanism.kinematics(np.array([0.0, 0.0, *target]), T_wrist_mrf).T_world_mrf
    assert made.plans[0].target[0] == pytest.approx(T_world_mrf.p - [0.0, 0.0, RADIUS], abs=1e-4)


def test_a_wheels_positive_sense_is_ahead_whichever_way_its_axis_points(tmp_path):
    urdf = write_rover(tmp_path, (LEFT._replace(**BACKWARD), RIGHT), lower=RADIUS)
    out = tmp_path / "rover.toml"
    assert main(["init", str(urdf), "--out", str(out)]) == 0
    model, _ = build_model(load_cell(out))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    axes = [data.joint(name).xaxis for name in ("left_wheel", "right_wheel")]
    assert np.array(axes) == pytest.approx(np.array([[0.0, 1.0, 0.0]] * 2), abs=2e-3)
    for name in ("left_wheel_tyre", "right_wheel_tyre"):
        assert abs(data.geom(name).xmat[4]) == pytest.approx(1.0, abs=1e-5)
        assert data.geom(name).xpos[2] == pytest.approx(RADIUS, abs=1e-4)
