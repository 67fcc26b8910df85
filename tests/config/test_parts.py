"""Cells of several mechanisms: what the file says of each."""

import pytest
from telerobot.config.load import ConfigError, load_cell

PAIR = """
name = "two"
default_script = "pa10_tour"
[[buses]]
name = "left"
channel = "239.74.163.20"
[[buses]]
name = "right"
channel = "239.74.163.21"
[[mechanisms]]
name = "left"
bus = "left"
like = "pa10"
T_world_base = { xyz = [0.0, 0.55, 0.0] }
[[mechanisms]]
name = "right"
bus = "right"
like = "ur5e"
"""


def test_each_mechanism_is_a_cell_of_its_own(cell):
    two, left, right = cell(PAIR), load_cell("pa10"), load_cell("ur5e")
    a, b = two.parts
    assert a.parts == (a,)
    assert a.config.mechanism.T_world_base.xyz == (0.0, 0.55, 0.0)
    assert (a.config.mechanism.drives, b.config.mechanism.drives) == (
        left.config.mechanism.drives, right.config.mechanism.drives,
    )  # fmt: skip
    assert (a.robot, b.robot) == (left.robot, right.robot)
    # How it moves comes along: gains, null space, its virtual drives.
    assert b.config.sources == right.config.sources
    assert a.config.redundancy == left.config.redundancy
    assert b.config.rig.drive == right.config.rig.drive
    # What they share is this cell's, and not the other's.
    assert a.config.name == b.config.name == "two"
    assert a.config.timing == b.config.timing


def test_joints_bear_the_names_of_their_mechanisms_where_there_are_several(cell):
    two = cell(PAIR)
    assert two.joints[:2] == ("left.s1", "left.s2")
    assert two.joints[7].startswith("right.")
    assert len(two.joints) == len(set(two.joints)) == 13
    assert load_cell("pa10").joints[:2] == ("s1", "s2")


def test_a_task_has_its_own_sources_and_the_file_speaks_for_all_others(cell):
    two = cell(
        PAIR
        + """
[limits]
speed = 0.3
[sources.position]
speed = 0.1
[[tasks]]
name = "fine"
by = ["right"]
[tasks.sources.position]
speed = 0.02
"""
    )
    a, b = two.parts
    assert (a.config.sources.position.speed, b.config.sources.position.speed) == (0.1, 0.02)
    assert a.config.limits.speed == b.config.limits.speed == 0.3


SAME = ('name = "right"\nbus', 'name = "left"\nbus')
ONE = '[[mechanisms]]\nname = "left"\nlike = "pa10"\n'
HEAD = 'name = "two"\ndefault_script = "pa10_tour"\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PAIR + "[mechanism]\nname = 'third'\n", "mechanisms: there is [mechanism] too"),
        (PAIR.replace(*SAME), "mechanisms[1].name: value 'left': is there already"),
        (PAIR.replace('"ur5e"', '"ur5"'), "mechanisms[1].like: ur5: no shipped cell of that name"),
        (PAIR.replace('"ur5e"', "5"), "mechanisms[1].like: value 5: the name or path of a cell"),
        (PAIR + "urdf = 7\n", "mechanisms[1].urdf: value 7"),
        (PAIR + "tip_link = 'hand'\n", "mechanisms[1].tip_link: value 'hand': no such link"),
        (PAIR + "drive_herz = 7\n", "mechanisms[1].drive_herz: unknown key; did you mean"),
        (PAIR + "[mechanisms.postures]\nstart = [0.0]\n", "mechanisms[1].postures.start: 1 values"),
        (HEAD + "mechanisms = 3\n", "mechanisms: must be tables: [[mechanisms]]"),
        (HEAD + "mechanisms = []\n", "mechanisms: 0 tables: must be 1 to 8"),
        (HEAD + "[[mechanisms]]\nlike = 'pa10'\n", "mechanisms[0].name: missing"),
        (PAIR + "[[tasks]]\nname = 'middle'\n", "tasks[0].by: value 'middle': no such mechanism"),
        (PAIR + "[[tasks]]\nname = 'a'\nby = 'left'\n", "tasks[0].by: value 'left': a list"),
        (
            PAIR + "[[tasks]]\nname = 'left'\n[[tasks]]\nname = 'x'\nby = ['left']\n",
            "tasks[1].by: value 'left': has another task already",
        ),
        (PAIR + "[[tasks]]\nname = 'left'\ngain = 3\n", "tasks[0].gain: unknown key"),
        (PAIR + "[[tasks]]\nname = 3\n", "tasks[0].name: value 3: must be small letters, digits"),
        (PAIR + "[[tasks]]\nname = 'Fine'\nby = ['left']\n", "tasks[0].name: value 'Fine': must"),
        (PAIR + "[[tasks]]\nby = ['left']\n", "tasks[0].name: missing: its name"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_in_one_line(cell, text, words):
    with pytest.raises(ConfigError) as caught:
        cell(text)
    assert words in str(caught.value)
    assert all(line.startswith("/") for line in str(caught.value).splitlines()), "a file, a line"


CAMERA = """
[[tasks.cameras]]
name = "eye"
tag = 7
tag_size = 0.1
device = "0"
T_wrist_lens = { xyz = [0.05, 0.0, 0.0] }
"""
ON = ('[[mechanisms]]\nname = "right', 'on = "right"\n[[mechanisms]]\nname = "right')
TAG = "[[rig.tags]]\nname = 'tag'\nT_wrist_tag = {}\n"
LINE = "[[obstacles]]\nname = 'ray'\nshape = 'sight_line'\nto = [1, 1, 1]\ncamera = 'eye'\n"
LEFT = "[[tasks]]\nname = 'left'\n"
RIGHT = "[[tasks]]\nname = 'right'\n"


def test_a_task_has_its_own_cameras(cell):
    a, b = cell(PAIR + RIGHT + CAMERA).parts
    assert a.config.cameras == ()
    assert [camera.name for camera in b.config.cameras] == ["eye"]


def test_a_task_is_called_as_its_mechanism_unless_its_table_names_it(cell):
    assert [part.task for part in cell(PAIR).parts] == ["left", "right"]
    text = PAIR + "[[tasks]]\nname = 'fine'\nby = ['right']\n"
    assert [part.task for part in cell(text).parts] == ["left", "fine"]
    assert load_cell("pa10").task == "arm"


def test_a_mechanism_has_a_base_of_its_own_that_may_move_and_a_crf_on_it(cell):
    frames = "[mechanisms.frames]\ncrf_on = 'base'\n[mechanisms.frames.base]\n[frames.carrier]\n"
    a, b = cell(PAIR + frames).parts
    assert (a.config.frames.base, a.config.frames.crf_on) == (None, "world")
    assert (b.config.frames.base is not None, b.config.frames.crf_on) == (True, "base")
    assert a.config.frames.carrier == b.config.frames.carrier is not None


def test_a_mechanism_has_hardware_and_null_space_of_its_own(cell):
    text = (
        PAIR
        + """
[mechanisms.redundancy]
posture = 0.3
[mechanisms.rig]
payload_mass = 1.5
tool_radius = 0.0
[rig]
payload_mass = 0.5
"""
    )
    a, b = cell(text).parts
    assert (a.config.rig.payload_mass, b.config.rig.payload_mass) == (0.5, 1.5)
    assert (a.config.rig.tool_radius, b.config.rig.tool_radius) == (0.012, 0.0)
    assert (a.config.redundancy.posture, b.config.redundancy.posture) == (0.0, 0.3)
    assert a.config.rig.seed == b.config.rig.seed


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PAIR + "[frames.base]\n", "frames.base: there are several mechanisms: give each whose"),
        (PAIR + "[mechanisms.frames.carrier]\n",
         "mechanisms[1].frames.carrier: the Carrier is the cell's: [frames]"),
        (PAIR + "[mechanisms.frames.base]\nspeed = 0\n",
         "mechanisms[1].frames.base.speed: value 0"),
        (PAIR + CAMERA.replace("tasks.", ""), "cameras: there are several mechanisms: give each"),
        (
            PAIR + LEFT + CAMERA + RIGHT + CAMERA,
            "tasks: camera 'eye' of mechanism 'right' is also one of 'left'",
        ),
        (PAIR + RIGHT + CAMERA.replace("= 7", "= 'a'"), "tasks[0].cameras[0].tag: value 'a'"),
        (PAIR + LEFT + "[tasks.sources.vision]\ncamera = 'eye'\n",
         "tasks[0].sources.vision.camera: value 'eye': no such camera"),
        (PAIR + LEFT + RIGHT + "[tasks.sources.force]\nweight = 3\n",
         "tasks[1].sources.force.weight: unknown key"),
        (PAIR + "[sources.position]\nspeed = -1\n" + RIGHT
         + "[tasks.sources.position]\nangular_speed = 1.0\n",
         "cell.toml: sources.position.speed: value -1"),
        (PAIR + "[mechanisms.redundancy]\nposture_name = 'hom'\n",
         "mechanisms[1].redundancy.posture_name: value 'hom': no such posture"),
        (PAIR + "[mechanisms.rig]\nwall = {}\n", "mechanisms[1].rig.wall: is no mechanism's own"),
        (PAIR + "[mechanisms.rig]\npayload_mass = 'x'\n",
         "mechanisms[1].rig.payload_mass: value 'x'"),
        (PAIR + "[mechanisms.rig.drive]\nfriction = [1.0, 2.0]\n",
         "mechanisms[1].rig.drive.friction: 2 values: must be 1, or 6"),
        (PAIR + "on = 'lefd'\n", "mechanisms[1].on: value 'lefd': no such mechanism; did you mean"),
        (PAIR + "on = 'right'\n", "mechanisms[1].on: value 'right': goes round in a circle"),
        (PAIR.replace(*ON) + "on = 'left'\n",
         "mechanisms[0].on: value 'right': goes round in a circle: left on right on left"),
        (PAIR + "on = 'left'\n", "mechanisms[1].on: value 'left': has no [torso], so that nothing"),
        (PAIR + "T_on = { xyz = [0.0, 0.0, 1.0] }\n", "mechanisms[1].T_on: there is no"),
        (PAIR + RIGHT + CAMERA + LINE.replace("'eye'", "'ete'"),
         "obstacles[0].camera: value 'ete': no such camera in [[cameras]]; did you mean 'eye'"),
        (PAIR + RIGHT + CAMERA + LINE + "hard = true\n",
         "obstacles[0].hard: value True: the sight line of 'eye' moves with the arm"),
        (PAIR + "[[tasks]]\nname = 'left'\nby = ['right']\n",
         "tasks[0].name: value 'left': the task of mechanism 'left', which has no table, is"),
        (PAIR + TAG + "mechanism = 'lift'\n",
         "rig.tags[0].mechanism: value 'lift': no such mechanism; did you mean 'left'"),
        (PAIR + TAG.replace("wrist", "world") + "mechanism = 'left'\n",
         "rig.tags[0]: mechanism: nobody carries a tag with T_world_tag"),
        (PAIR + "alike = 'pa10'\n", "mechanisms[1].alike: unknown key"),
    ],
)  # fmt: skip
def test_what_is_cell_wide_or_a_tasks_own_is_refused_by_the_files_key(cell, text, words):
    with pytest.raises(ConfigError) as caught:
        cell(text)
    assert words in str(caught.value)
    assert all(line.startswith("/") for line in str(caught.value).splitlines()), "a file, a line"


def test_a_mechanism_of_another_cell_is_put_on_the_bus_that_this_file_names(cell, tmp_path):
    split = tmp_path / "split.toml"
    split.write_text("""
extends = "pa10"
[[buses]]
name = "near"
channel = "239.74.163.32"
[[buses]]
name = "far"
channel = "239.74.163.33"
[mechanism]
bus = "far"
[mechanism.force_torque]
bus = "far"
""")
    two = cell(PAIR.replace('"pa10"', '"split.toml"'))
    assert {entry.bus for entry in two.devices if entry.part == 0} == {"left"}
    unsaid = PAIR.replace('"pa10"', '"split.toml"').replace('bus = "left"\n', "", 1)
    with pytest.raises(ConfigError, match=r"mechanisms\[0\]\.bus: value 'far': no such bus"):
        cell(unsaid)


@pytest.mark.parametrize(
    "text",
    [
        'extends = "arms/mine.toml"\n',
        HEAD + "[[mechanisms]]\nname = 'a'\nlike = 'arms/mine.toml'\n",
    ],
)
def test_paths_in_another_cells_file_start_from_its_own_folder(cell, tmp_path, text):
    arms = tmp_path / "arms"
    arms.mkdir()
    (arms / "mine.toml").write_text('extends = "pa10"\n[mechanism]\nurdf = "my.urdf"\n')
    (arms / "my.urdf").write_text(load_cell("pa10").robot.urdf.read_text())
    assert cell(text).robot.urdf == arms / "my.urdf"


def test_one_mechanism_may_stand_in_a_list_too(cell, tmp_path):
    alone = cell(HEAD + ONE)
    assert alone.parts == (alone,)
    assert alone.joints == load_cell("pa10").joints
