"""A rover's cell: what cannot be is refused before anything moves, with file and key."""

import pytest
from telerobot.config.load import ConfigError, load_cell


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
        (("rover", "rover"), ["mechanisms[0].base", "mechanisms[1].base"]),
        (("pa10", "rover"), ["mechanisms[1].base"]),
    ],
)
def test_several_mechanisms_of_which_one_drives_are_refused(cell, pair, places):
    with pytest.raises(ConfigError) as refused:
        cell(two(*pair))
    assert len(refused.value.messages) == len(places)
    for message, place in zip(refused.value.messages, places, strict=True):
        words = "a mechanism on wheels must be the only one of its cell, which has 2"
        assert f"cell.toml: {place}: {words}" in message


def test_a_scanner_of_several_mechanisms_is_refused(cell):
    scanner = '\n[scanner]\nlink = "flange"'
    with pytest.raises(ConfigError, match="scanner: looks ahead of one mechanism: the cell has 2"):
        cell(two("pa10", "ur5e") + scanner)


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
    ],
)
def test_joints_beside_the_chain_are_on_the_root_link(cell, wrong, words):
    text = (load_cell("rover_bridge").path).read_text()
    assert wrong[0] in text
    with pytest.raises(ConfigError) as refused:
        cell(text.replace(*wrong))
    assert words in str(refused.value)
