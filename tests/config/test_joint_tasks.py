"""Tasks that several mechanisms hold together, as the cell file says them."""

import pytest
from telerobot.config.load import ConfigError

TWO = """
name = "two"
default_script = "pa10_tour"
[sources.joystick]
gain = [0.1, 0.1, 0.1, 0.2, 0.2, 0.2]
[[buses]]
name = "left"
[[buses]]
name = "right"
port = 43211
[[mechanisms]]
name = "left"
like = "pa10"
bus = "left"
T_world_base = { xyz = [0.0, 0.55, 0.0] }
[[mechanisms]]
name = "right"
like = "pa10"
bus = "right"
T_world_base = { xyz = [0.0, -0.55, 0.0] }
"""
BEAM = """
[[tasks]]
name = "beam"
by = ["left", "right"]
at_start = true
T_wrist_mrf = [{ xyz = [0.0, -0.55, 0.121] }, { xyz = [0.0, 0.55, 0.121] }]
"""


def test_a_joint_task_stands_beside_the_parts_and_not_in_them(cell):
    two = cell(TWO + BEAM + "payload = { mass = 5.0 }\n[tasks.sources.force]\nhold_threshold = 7.0")
    (beam,) = two.joint_tasks
    assert (beam.name, beam.by, beam.at_start) == ("beam", ("left", "right"), True)
    assert beam.T_wrist_mrf[1].xyz == (0.0, 0.55, 0.121)
    assert beam.payload.mass == 5.0
    assert beam.sources.force.hold_threshold == 7.0
    assert all(part.joint_tasks == () for part in two.parts)
    # Alone, an arm is what it is without the joint task.
    assert [part.config for part in two.parts] == [part.config for part in cell(TWO).parts]


def test_the_load_is_shared_out_by_rated_payloads_where_the_task_says_nothing(cell):
    (even,) = cell(TWO + BEAM).joint_tasks
    assert even.shares == ((1.0,) * 6, (1.0,) * 6)
    half = TWO.replace('name = "right"\nlike', 'name = "right"\nrated_payload = 5.0\nlike')
    (by_rating,) = cell(half + BEAM).joint_tasks
    assert by_rating.shares == ((1.0,) * 6, (2.0,) * 6)
    (told,) = cell(half + BEAM + "shares = [[3, 3, 3, 3, 3, 3], [1, 1, 1, 1, 1, 1]]").joint_tasks
    assert told.shares == ((3.0,) * 6, (1.0,) * 6)


def test_the_file_speaks_for_the_joint_task_where_that_says_nothing(cell):
    (beam,) = cell(TWO + BEAM).joint_tasks
    assert beam.sources.joystick.gain == (0.1, 0.1, 0.1, 0.2, 0.2, 0.2)


def test_an_arm_may_have_a_task_alone_and_one_with_another(cell):
    two = cell(TWO + BEAM + '[[tasks]]\nname = "mine"\nby = ["left"]\n')
    assert len(two.joint_tasks) == 1
    assert len(two.parts) == 2


REFUSED = [
    (BEAM.replace('"right"]', '"rihgt"]'), "tasks[0].by[1]: value 'rihgt': no such mechanism"),
    (BEAM.replace('"right"]', '"left"]'), "tasks[0]: by[1]: 'left' holds it already"),
    (BEAM.replace("0.121] }, ", "0.121] }] #"), "T_wrist_mrf: 1 poses for 2 mechanisms: one each"),
    (BEAM + "shares = [[1, 1, 1, 1, 1, 1]]", "shares: 1 rows for 2 mechanisms: one each"),
    (BEAM + "shares = [[1, 1, 1, 1, 1], [1, 1, 1, 1, 1, 1]]", "tasks[0].shares[0][5]: missing"),
    (
        BEAM + "shares = [[1, 1, 1, 1, 1, 0], [1, 1, 1, 1, 1, 1]]",
        "tasks[0].shares[0][5]: value 0: should be greater than or equal to 0.001",
    ),
    (BEAM + BEAM.replace('"beam"', '"rod"'), "tasks[1].by[0]: value 'left': holds 'beam' at start"),
    (BEAM + BEAM, "tasks[1].name: value 'beam': is there already"),
    (BEAM + "strech = 0.001", "tasks[0].strech: unknown key; did you mean 'stretch'?"),
    (
        "[rig.beam]\nmass = 5.0\nhalf_size = [0.1, 0.5, 0.1]",
        "rig.beam: no task of [[tasks]] is by several mechanisms",
    ),
    (
        BEAM + "[rig.beam]\nmass = 5\nhalf_size = [1, 1, 1]\nmisfit = [[0, 0, 0]]",
        "rig.beam.misfit: 1 places for 2 mechanisms of task 'beam': one each",
    ),
    (
        BEAM.replace('"right"]', '"third"]')
        + '[[buses]]\nname = "third"\nport = 43212\n'
        + '[[mechanisms]]\nname = "third"\nlike = "ranger"\nbus = "third"\n',
        "tasks[0].by[1]: value 'third': has no force_torque sensor to hold a payload by",
    ),
    (
        BEAM + "[rig.beam]\nmass = 1\nhalf_size = [0.05, 0.6, 0.05]",
        "rig.beam.mass: value 1: on pads as stiff and damped as these it needs 2 kg",
    ),
    (BEAM + "most_internal = -1.0", "tasks[0].most_internal: value -1.0: should be greater than 0"),
]


@pytest.mark.parametrize(("text", "words"), REFUSED)
def test_what_does_not_fit_is_one_line_that_says_where(cell, text, words):
    with pytest.raises(ConfigError) as refusal:
        cell(TWO + text)
    assert words in str(refusal.value)
    assert all(line.startswith("/") for line in str(refusal.value).splitlines()), "a file, a line"


def test_two_joint_tasks_may_take_turns(cell):
    later = BEAM.replace('"beam"', '"rod"').replace("at_start = true", "")
    assert [task.name for task in cell(TWO + BEAM + later).joint_tasks] == ["beam", "rod"]
