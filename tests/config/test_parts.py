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


@pytest.fixture
def cell(tmp_path):
    """Load a cell from what its file says."""

    def load(text):
        path = tmp_path / "cell.toml"
        path.write_text(text)
        return load_cell(path, several=True)

    return load


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
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused_in_one_line(cell, text, words):
    with pytest.raises(ConfigError) as caught:
        cell(text)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_drives_one_mechanism_refuses_a_cell_of_two(tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text(PAIR)
    with pytest.raises(ConfigError, match="2 tables: a daemon drives one mechanism so far"):
        load_cell(path)


def test_one_mechanism_may_stand_in_a_list_too(cell, tmp_path):
    alone = cell(HEAD + ONE)
    assert alone.parts == (alone,)
    assert alone.joints == load_cell("pa10").joints
