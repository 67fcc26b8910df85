import math
import re
import tomllib
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from telerobot.config import consistency as buses
from telerobot.config.load import ConfigError, load_cell, script_path, shipped
from telerobot.protocols.canopen import can301
from telerobot.server.control.mechanism.model import Mechanism
from telerobot.server.control.spatial import Pose


def refusal(path: Path | str) -> str:
    with pytest.raises(ConfigError) as caught:
        load_cell(path)
    text = str(caught.value)
    assert all(": " in line for line in text.splitlines()), "a line each, of a file or a name"
    return text


def test_a_cell_brings_its_joints_in_chain_order_without_the_gripper(small):
    cell = load_cell(small.cell)
    assert [j.name for j in cell.robot.joints] == ["j1", "j2", "j3"]
    assert cell.robot.joints[0].velocity == 2.0
    assert cell.robot.urdf == small.urdf
    assert cell.config.timing.period_s == 0.01


def test_a_path_may_be_text(small):
    assert load_cell(str(small.cell)).path == small.cell


@pytest.mark.parametrize("name", shipped("cells"))
def test_every_shipped_cell_loads_by_name(name):
    assert load_cell(name).config.name == name


def shipped_endpoints():
    """UDP ports of buses and TCP endpoints of each shipped cell that has its own."""
    for name in shipped("cells"):
        cell = load_cell(name)
        document = tomllib.loads(cell.path.read_text())
        if "extends" in document and not {"bus", "buses", "zenoh"} & document.keys():
            continue  # the cell that it extends with something changed, in its place
        yield from (f"udp {bus.port}" for bus in cell.config.fieldbuses)
        yield cell.config.zenoh.listen
        if cell.config.scanner is not None:
            yield cell.config.scanner.address


def test_shipped_cells_may_run_side_by_side():
    assert [of for of, times in Counter(shipped_endpoints()).items() if times > 1] == []


def test_an_unknown_name_says_what_is_shipped():
    text = refusal("nosuch")
    assert "nosuch" in text
    assert "shipped: " in text


def test_a_missing_file_is_named():
    assert refusal("/nowhere/cell.toml") == "/nowhere/cell.toml: no such file"


def test_broken_toml_names_the_line(small):
    assert "line 1," in refusal(small.replace('name = "small"\ndefault', "name = \ndefault"))


def test_a_file_that_is_not_text_is_refused(small):
    small.cell.write_bytes(b'name = "\xff"')
    assert "not UTF-8" in refusal(small.cell)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("period_s = 0.01", "periods = 0.01", r"timing\.periods: unknown key; .*'period_s'"),
        ("period_s = 0.01", "period_s = 5", r"timing\.period_s: value 5: .*less than .*0\.1"),
        ("period_s = 0.01", 'period_s = "0.01"', r"timing\.period_s: value '0.01': .*number"),
        ("period_s = 0.01", "period_s = true", r"timing\.period_s: value True: .*number"),
        ("period_s = 0.01", "period_s = nan", r"timing\.period_s: value nan: .*finite"),
        ("period_s = 0.01", "period_s = 2020-01-01", r"timing\.period_s: .*number"),
        ("period_s = 0.01", "period_s = [1, 2]", r"timing\.period_s: value \[1, 2\]: .*number"),
        ("node = 2", "node = 200", r"mechanism\.drives\[1\]\.node: value 200: .*127"),
        ("node = 2", "node = 2.5", r"mechanism\.drives\[1\]\.node: value 2\.5: .*integer"),
        (
            "node = 2",
            "node = 2\nleash = 1.0\nfollowing_window = 0.5",
            r"mechanism\.drives\[1\]: leash 1\.0 must be below following_window 0\.5",
        ),
        ('tip_link = "tip"', "", r"mechanism\.tip_link: missing: last link"),
        ("node = 2", "node = 1", r"mechanism\.drives\[1\]\.node: value 1: already .*'j1'"),
        ("node = 2", "node = 127", r"mechanism\.drives\[1\]\.node: value 127: .* the daemon"),
        ('joint = "j2"', 'joint = "j1"', r"mechanism\.drives\[1\]\.joint: value 'j1': already"),
        ('joint = "j2"', 'joint = "jj2"', r"mechanism\.drives\[1\]\.joint: value 'jj2': no such"),
        ('joint = "j2"', 'joint = "grip"', r"drives\[1\]\.joint: value 'grip': no such movable"),
        ('tip_link = "tip"', 'tip_link = "tipp"', r"tip_link: value 'tipp': no such .*'tip'"),
        ('tip_link = "tip"', 'tip_link = "base"', r"tip_link: value 'base': no movable joint"),
        ('tip_link = "tip"', 'tip_link = "finger"', r"mechanism\.drives: joint 'grip' .* no drive"),
        (", ready = [0.3, 0.6, 1.0]", "", r"mechanism\.postures\.ready: missing"),
        ("[0.3, 0.6, 1.0]", "[0.3, 0.6]", r"mechanism\.postures\.ready: 2 values: must be 3"),
        ("[0.3, 0.6, 1.0]", "[0.3, 0.6, 2.495]", r"ready\[2\]: value 2\.495: .*-2\.49 to 2\.49"),
        ("integral = [0.0]", "integral = [0.0, 1.0]", r"rig\.drive\.integral: 2 values: .*or 3"),
        ("2670176.8", "9e8", r"drives\[0\]\.counts_per_radian: value 9e\+08: .*32 bits"),
        ("max_velocity = 1.5", "max_velocity = 2.5", r"max_velocity: value 2\.5: .*at most 2,"),
        ("rate_hz = 200", "command_id = 0x181", r"command_id: value 0x181: .*drive of 'j1'"),
        ("rate_hz = 200", "reply_ids = [3, 3]", r"reply_ids\[1\]: value 0x3: .*reply_ids\[0\]"),
        ("rate_hz = 200", "rate_hz = 250", r"force_torque\.rate_hz: value 250: .*1000"),
        ('urdf = "small.urdf"', 'urdf = "nosuch"', r"mechanism\.urdf: nosuch: no shipped robot"),
        ('urdf = "small.urdf"', 'urdf = "no.urdf"', r"mechanism\.urdf: .*no\.urdf: no such file"),
    ],
)
def test_what_a_person_gets_wrong_is_named_with_key_value_and_bound(small, old, new, expected):
    text = refusal(small.replace(old, new))
    assert text.startswith(f"{small.cell}: ")
    assert re.search(expected, text), text


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("</robot>", "", r"not well-formed XML"),
        ('<robot name="small">', "<sdf>", r"not well-formed XML"),
        ('name="j1" type="revolute"', 'name="j1" type="planar"', r"joint 'j1': type 'planar'"),
        ('lower="-2.5"', 'lower="3"', r"joint 'j\d': <limit>: lower 3 must be below upper 2\.5"),
        ('velocity="2"', 'velocity="fast"', r"<limit velocity>: value 'fast': must be a number"),
        ('<parent link="base"/>', '<parent link="l3"/>', r"chain runs in a circle"),
        ('<parent link="base"/>', '<parent link="bass"/>', r"joint 'j1': no link 'bass'"),
        ('<parent link="base"/>', "", r"joint 'j1': <parent link=…> is missing"),
        ('<child link="finger"/>', '<child link="l1"/>', r"link 'l1': is the child of two joints"),
        ('<mass value="1"/>', '<mass value="1 kg"/>', r"link 'base': <mass value>: value '1 kg'"),
        ('xyz="0 1 0"', 'xyz="0 1"', r"joint 'j2': <axis xyz>: value '0 1': must be 3 numbers"),
        ("</robot>", '<link name="stray"/></robot>', r"links 'base' and 'stray': only one can be"),
        ('<axis xyz="0 0 1"/>', '<mimic joint="j2"/>', r"joint 'j1': <mimic>"),
        ('effort="100"', 'effort="1_0"', r"<limit effort>: value '1_0': must be a number"),
        ('effort="100"/>', 'effort="1"/><dynamics damping="x"/>', r"<dynamics damping>: value 'x'"),
        (
            'xyz="0 1 0"',
            'xyz="0 0 0"',
            r"joint 'j2': <axis xyz>: value '0 0 0': must not be of len",
        ),
        ('<axis xyz="0 1 0"/>', "<axis/>", r"joint 'j2': <axis xyz>: is missing"),
        ('xyz="0 0 0.4"', 'xyz="0 0 1e9"', r"joint 'j1': <origin xyz>: value '0 0 1e9': .* 10000"),
        ('<mass value="1"/>', "", r"link 'base': <inertial>: <mass> is missing"),
        ('<mass value="1"/>', '<mass value="5e-324"/>', r"<mass value>: value '5e-324': must be a"),
        ('<mass value="1"/>', "<mass/>", r"link 'base': <mass value>: is missing"),
        (
            '<mass value="1"/>',
            '<mass value="-1"/>',
            r"<mass value>: value '-1': must be at least 0",
        ),
        (
            '<mass value="1"/>',
            '<mass value="nan"/>',
            r"<mass value>: value 'nan': must be a number",
        ),
        ('ixx="0.01"', 'ixx="-0.01"', r"link 'base': <inertia>: least principal moment -0\.01"),
        ('iyz="0"', "", r"link 'base': <inertia iyz>: is missing"),
        ('izz="0.01"/>', 'izz="0.01"/><inertia/>', r"<inertia>: is there 2 times"),
        ('<link name="l2">', '<link name="l1">', r"link 'l1': is there twice"),
        ('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><axis xyz="1 0 0"/>', r"<axis>: is there 2 ti"),
        ('izz="0.01"', 'izz="0.05"', r"greatest principal moment 0\.05 .* at most 0\.02, the sum"),
    ],
)
def test_a_urdf_that_we_cannot_drive_is_refused(small, old, new, expected):
    text = refusal(small.replace_in_urdf(old, new))
    assert text.startswith(f"{small.urdf}: ")
    assert re.search(expected, text), text


INERTIAL = (
    '<inertial><mass value="1"/><inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" '
    'izz="0.01"/></inertial>'
)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ('<sphere radius="abc"/>', r"<sphere radius>: value 'abc': must be a number"),
        ('<sphere radius="nan"/>', r"<sphere radius>: value 'nan': must be a number"),
        ('<sphere radius="-0.06"/>', r"<sphere radius>: value '-0\.06': must be above 0"),
        ('<sphere radius="0"/>', r"<sphere radius>: value '0': must be above 0"),
        ('<sphere radius="1e5"/>', r"<sphere radius>: value '1e5': .* at most 10000"),
        ("<sphere/>", r"<sphere radius>: is missing"),
        ('<cylinder radius="0.1"/>', r"<cylinder length>: is missing"),
        ('<capsule radius="0.1" length="-1"/>', r"<capsule length>: value '-1'"),
        ('<box size="1 2"/>', r"<box size>: value '1 2': must be 3 numbers"),
        ('<box size="1 2 0"/>', r"<box size>: value '1 2 0': must be above 0"),
        ("<mesh/>", r"<collision>: <mesh filename=…> is missing"),
        ('<cone radius="0.1"/>', r"<collision>: <geometry> holds cone: must be one of"),
        ("", r"<collision>: <geometry> holds nothing"),
    ],
)
def test_a_shape_that_a_parser_would_drop_is_refused(small, shape, expected):
    small.replace_in_urdf(
        '<link name="l2">',
        f'<link name="l2"><collision><geometry>{shape}</geometry></collision>',
    )
    text = refusal(small.cell)
    assert text.startswith(f"{small.urdf}: link 'l2': ")
    assert re.search(expected, text), text


def test_what_stands_in_a_link_for_another_program_is_not_read(small):
    other = '<collision_checking><capsule name="test"/></collision_checking>'
    small.replace_in_urdf('<link name="l2">', f'<link name="l2">{other}')
    assert len(load_cell(small.cell).robot.joints) == 3


def test_a_joint_that_moves_nothing_of_any_mass_is_refused(small):
    small.replace_in_urdf(f'<link name="l2">{INERTIAL}', '<link name="l2">')
    assert "link 'l2': <inertial> is missing or of mass 0: joint 'j2'" in refusal(small.cell)


def test_a_frame_without_mass_is_no_mistake_where_something_heavy_hangs_on_it(small):
    small.replace_in_urdf(f'<link name="l3">{INERTIAL}', '<link name="l3">')
    assert len(load_cell(small.cell).robot.joints) == 3


def test_xml_that_is_no_urdf_is_refused(small):
    small.urdf.write_text("<sdf/>")
    assert "not a URDF: the outer element is <sdf>" in refusal(small.cell)


def test_all_mistakes_are_told_at_once(small):
    small.replace("period_s = 0.01", "period_s = 5")
    lines = refusal(small.replace("node = 2", "node = 200")).splitlines()
    assert [line.split(": ")[1] for line in lines] == [
        "timing.period_s",
        "mechanism.drives[1].node",
    ]


def test_all_links_that_cannot_be_are_told_at_once(small):
    small.replace_in_urdf('<mass value="1"/>', '<mass value="-1"/>')
    lines = refusal(small.cell).splitlines()
    assert len(lines) == small.urdf.read_text().count('<mass value="-1"/>')


@pytest.mark.parametrize("missing", ['velocity="2"', 'effort="100"'])
def test_a_limit_that_the_urdf_leaves_out_is_the_drives(small, missing):
    joint = load_cell(small.replace_in_urdf(missing, "")).robot.joints[0]
    drive = load_cell(small.cell).config.mechanism.drives[0]
    expected = (drive.max_velocity, 100.0) if "vel" in missing else (2.0, drive.max_torque)
    assert (joint.velocity, joint.effort) == expected


def test_limits_that_the_urdf_has_not_are_said_with_the_drive(small):
    small.replace_in_urdf('lower="-2.5" upper="2.5" ', "")
    assert "its drive says 'lower' and 'upper'" in refusal(small.cell)


def test_a_misspelt_required_key_is_reported_as_misspelt(small):
    text = refusal(small.replace('tip_link = "tip"', 'tiplink = "tip"'))
    assert "mechanism.tiplink: unknown key; did you mean 'tip_link'?" in text.splitlines()[0]
    assert "mechanism.tip_link: missing" in text


def test_a_continuous_joint_is_one_turn_either_way(small):
    small.replace_in_urdf('name="j1" type="revolute"', 'name="j1" type="continuous"')
    small.replace_in_urdf('lower="-2.5" upper="2.5" ', "")
    small.replace_in_urdf('name="j2" type="revolute"', 'name="j2" type="continuous"')
    small.replace_in_urdf('name="j3" type="revolute"', 'name="j3" type="continuous"')
    robot = load_cell(small.cell).robot
    assert robot.joints[0].kind == "continuous"
    assert (robot.joints[0].lower, robot.joints[0].upper) == (-2 * math.pi, 2 * math.pi)
    description = robot.description()
    assert "continuous" not in description
    assert f'upper="{2 * math.pi!r}"' in description


def test_blanks_around_a_number_cost_no_link_its_inertia(small):
    """One reader takes them, the next drops the link's inertia, and says so to nobody."""
    small.replace_in_urdf('<mass value="1"/>', '<mass value=" +1.0\t"/>')
    small.replace_in_urdf('<axis xyz="0 1 0"/>', '<axis xyz="0\n1  0 "/>')
    mechanism = Mechanism.from_cell(load_cell(small.cell))
    assert [inertia.mass for inertia in mechanism.model.inertias][1:] == [1.0, 1.0, 3.0]
    assert mechanism.kinematics(np.zeros(3), Pose.identity()).J[3:, 1].tolist() == [0.0, 1.0, 0.0]


def test_a_slide_keeps_its_metres(small):
    small.replace_in_urdf('name="j1" type="revolute"', 'name="j1" type="prismatic"')
    assert load_cell(small.cell).robot.joints[0].kind == "prismatic"


@pytest.mark.parametrize(
    ("told", "window"),
    [
        ("", 1.5 * (1.5**2 / (2.0 * 10.0) + 0.03 * 1.5)),
        ("\nleash = 0.2", 0.4),  # twice the leash is more
        ("\nfollowing_window = 0.07", 0.07),
    ],
)
def test_a_window_that_is_not_told_is_what_a_stop_from_full_speed_takes_and_half_more(
    small, told, window
):
    cell = load_cell(small.replace("max_jerk = 200.0", "max_jerk = 200.0" + told))
    assert cell.config.mechanism.drives[0].window == pytest.approx(window)


def test_a_margin_that_leaves_nothing_of_the_range_is_refused(small):
    small.replace_in_urdf('lower="-2.5" upper="2.5"', 'lower="-0.5" upper="0.5"')
    text = refusal(small.replace("max_jerk = 200.0", "max_jerk = 200.0\nposition_margin = 0.5"))
    assert "mechanism.drives[0].position_margin: value 0.5: leaves nothing of joint 'j1'" in text


def test_a_script_is_found_beside_the_cell(small):
    script = small.cell.with_name("mine.toml")
    script.write_text("")
    assert script_path("mine.toml", small.cell.parent) == script
    with pytest.raises(ConfigError, match="no such file"):
        script_path("other.toml", small.cell.parent)


@pytest.mark.parametrize("name", shipped("scripts"))
def test_every_shipped_script_is_found_by_name(name):
    assert script_path(name, Path()).stem == name


def test_the_daemons_node_is_the_one_on_the_bus():
    assert buses.MASTER_NODE == can301.MASTER_NODE


def test_drives_may_stand_in_any_order(small):
    turned = small.cell.read_text().replace('"j1"\nnode = 1', '"jX"\nnode = 9')
    turned = turned.replace('"j3"\nnode = 3', '"j1"\nnode = 1')
    small.cell.write_text(turned.replace('"jX"\nnode = 9', '"j3"\nnode = 3'))
    drives = load_cell(small.cell).config.mechanism.drives
    assert [(d.joint, d.node) for d in drives] == [("j1", 1), ("j2", 2), ("j3", 3)]


def test_a_cells_own_script_lies_beside_it(small):
    mine = small.cell.with_name("mine.toml")
    mine.write_text("duration_s = 1.0")
    cell = load_cell(small.replace('script = "pose_move"', 'script = "mine.toml"'))
    assert cell.default_script == mine


def test_a_default_script_that_is_not_there_is_named(small):
    path = small.replace('script = "pose_move"', 'script = "nosuch.toml"')
    assert refusal(path).startswith(f"{path}: default_script: ")


def test_an_endpoint_names_its_protocol(small):
    path = small.replace("[timing]", '[zenoh]\nlisten = "127.0.0.1:7447"\n\n[timing]')
    assert "zenoh.listen: value '127.0.0.1:7447'" in refusal(path)


def test_a_pull_to_a_posture_that_is_not_named_is_an_error(small):
    small.cell.write_text(small.cell.read_text() + '\n[redundancy]\nposture_name = "redy"\n')
    with pytest.raises(ConfigError, match=r"redundancy.posture_name: value 'redy'.*'ready'"):
        load_cell(small.cell)


def test_a_schedule_that_falls_back_is_an_error(small):
    table = '\n[[schedules]]\nsource = "force"\nby = "time"\nat = [1.0, 0.5]\nfactor = [0.0, 1.0]\n'
    small.cell.write_text(small.cell.read_text() + table)
    with pytest.raises(ConfigError, match=r"schedules\[0\].*must rise"):
        load_cell(small.cell)


@pytest.mark.parametrize(
    ("says", "words"),
    [
        ('relative_to = "carrier"', r"sources\.spring\.relative_to: value 'carrier'.*no \[frames"),
        ("direction = [0.0, 0.0, 0.0]", r"sources\.spring\.direction.*must point somewhere"),
        ("gain = [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0]", r"sources\.spring\.gain"),
    ],
)
def test_a_fixture_that_is_nowhere_is_an_error(small, says, words):
    small.cell.write_text(small.cell.read_text() + f"\n[sources.spring]\n{says}\n")
    with pytest.raises(ConfigError, match=words):
        load_cell(small.cell)


@pytest.mark.parametrize(
    ("says", "words"),
    [
        ('relative_to = "base"', r"sources\.point_at\.relative_to: value 'base'.*no \[frames"),
        ("tool_axis = [0.0, 0.0, 0.0]", r"sources\.point_at\.tool_axis.*must point somewhere"),
        ("gain = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]", r"sources\.point_at\.gain"),
        ("nearest = 0.0", r"sources\.point_at\.nearest"),
    ],
)
def test_an_axis_that_can_look_nowhere_is_an_error(small, says, words):
    small.cell.write_text(small.cell.read_text() + f"\n[sources.point_at]\n{says}\n")
    with pytest.raises(ConfigError, match=words):
        load_cell(small.cell)


def test_a_schedule_of_a_source_that_there_is_not_names_those_that_there_are(small):
    table = '\n[[schedules]]\nsource = "stick"\nby = "time"\nat = [0, 1]\nfactor = [0, 1]\n'
    small.cell.write_text(small.cell.read_text() + table)
    with pytest.raises(ConfigError, match=r"schedules\[0\]\.source.*'stick'.*joystick, position"):
        load_cell(small.cell)


GRIPPER = "[mechanism.payloads]\nbare = {{ mass = 0.4 }}\n[mechanism.gripper]\nnode = {0}\n{1}\n"


@pytest.mark.parametrize(
    ("node", "more", "words"),
    [
        (2, "", "mechanism.gripper.node: value 2: already the node of the drive of 'j2'"),
        (127, "", "mechanism.gripper.node: value 127: already the node of the daemon"),
        (20, 'closed_payload = "bar"', "mechanism.gripper.closed_payload: value 'bar'"),
    ],
)
def test_a_gripper_agrees_with_nodes_and_payloads(small, node, more, words):
    block = GRIPPER.format(node, more)
    text = refusal(small.replace("[rig.drive]", f"{block}\n[rig.drive]"))
    assert words in text


def test_no_payload_is_heavier_than_the_arm_is_rated_for(small):
    small.replace('tip_link = "tip"', 'tip_link = "tip"\nrated_payload = 0.1')
    brick = "[mechanism.payloads.brick]\nmass = 0.2\n"
    text = refusal(small.replace("[rig.drive]", f"{brick}\n[rig.drive]"))
    assert "mechanism.payloads.brick.mass: value 0.2" in text


def test_a_sound_gripper_is_taken(small):
    block = GRIPPER.format(20, 'open_payload = "bare"')
    cell = load_cell(small.replace("[rig.drive]", f"{block}\n[rig.drive]"))
    assert cell.config.mechanism.gripper.open_payload == "bare"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("port = " + "9" * 5000, r"not TOML: Exceeds the limit"),
        ("port = 0x" + "f" * 5000, r"port: an integer of more than 64 bits"),
        ("port = 9223372036854775808", r"port: an integer of more than 64 bits"),
        ("a = " + "[" * 3000 + "]" * 3000, r"nested more than 24 deep"),
        ("a = " + "{a = " * 3000 + "1" + "}" * 3000, r"nested more than 24 deep"),
        (".".join(["a"] * 3000) + " = 1", r"a\.a\.a.*: nested more than 24 deep"),
        ("[" + ".".join(["a"] * 3000) + "]", r"nested more than 24 deep"),
        ("# " + "x" * (1 << 20), r"1048\d+ bytes: must be at most 1048576"),
    ],
)
def test_absurd_toml_is_refused_in_one_line(small, text, expected):
    small.cell.write_text(text)
    found = refusal(small.cell)
    assert found.startswith(f"{small.cell}: ")
    assert re.search(expected, found), found
    assert len(found) < 300 + len(str(small.cell))


@pytest.mark.parametrize(
    ("key", "value"),
    [("max_jerk", "200.0"), ("max_acceleration", "10.0"), ("max_velocity", "1.5")],
)
def test_a_denormal_bound_is_refused(small, key, value):
    text = refusal(small.replace(f"{key} = {value}", f"{key} = 5e-324"))
    assert f"mechanism.drives[0].{key}: value 5e-324: " in text


def test_a_urdf_nested_without_end_is_refused(small):
    small.replace_in_urdf("</robot>", "<a>" * 3000 + "</a>" * 3000 + "</robot>")
    assert refusal(small.cell) == f"{small.urdf}: elements are nested more than 32 deep"


def test_xml_that_blows_up_is_refused(small):
    levels = "".join(
        f"<!ENTITY e{i} '{f'&e{i - 1};' * 10}'>" if i else "<!ENTITY e0 'ha'>" for i in range(12)
    )
    small.urdf.write_text(f"<!DOCTYPE robot [{levels}]><robot>&e11;</robot>")
    assert "not well-formed XML: limit on input amplification" in refusal(small.cell)


@pytest.mark.parametrize(
    "name",
    [
        n
        for n in shipped("cells")
        if n not in ("ranger", "planar3", "pa10_torso") and not n.startswith("snake")
    ],
)
def test_every_shipped_arm_that_can_be_bought_says_what_it_is_rated_for(name):
    rated = {"pa10": 10.0, "ur5e": 5.0, "gantry": 5.0}
    rated |= {"rover": 3.0, "rover_scan": 3.0, "rover_skid": 3.0}
    cell = load_cell(name)
    assert cell.config.mechanism.rated_payload == rated[cell.robot.urdf.stem]


@pytest.mark.parametrize(
    "text",
    ["{key} = 1", "[{key}]", "[[ {key} ]]", "x = {{ {key} = 1 }}", "x = {{ y = 1, {key} = 1 }}"],
)
@pytest.mark.parametrize("part", ["a", '"a.b"', "'a'"])
def test_a_key_of_very_many_parts_is_refused_before_it_is_parsed(tmp_path, text, part, monkeypatch):
    monkeypatch.setattr(tomllib, "loads", lambda _text: pytest.fail("parsed"))
    path = tmp_path / "cell.toml"
    path.write_text("# a\n" + text.format(key=" . ".join([part] * 20_000)))
    with pytest.raises(ConfigError, match="nested more than 24 deep") as caught:
        load_cell(path)
    assert len(str(caught.value)) < 300
