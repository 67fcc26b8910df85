"""What a person can get wrong about obstacles, sight lines and the workspace."""

import re

import pytest
from telerobot.config.load import ConfigError, load_cell

SPHERE = """
[[obstacles]]
name = "ball"
shape = "sphere"
xyz = [0.5, 0.5, 0.5]
radius = 0.1
"""
LINE = """
[[obstacles]]
name = "view"
shape = "sight_line"
xyz = [1.0, 1.0, 1.0]
to = [0.5, 0.0, 0.2]
"""


@pytest.fixture
def furnished(small):
    """The small cell, with a ball and a sight line to keep away from."""
    small.cell.write_text(small.cell.read_text() + SPHERE + LINE)
    return small


def test_obstacles_are_read_and_a_cell_without_word_of_it_avoids_nothing(furnished):
    config = load_cell(furnished.cell).config
    assert [o.name for o in config.obstacles] == ["ball", "view"]
    assert not config.avoidance.enabled


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("radius = 0.1", "", "obstacles[0]: a sphere needs radius"),
        ("radius = 0.1", "radius = -0.1", "obstacles[0].radius: value -0.1: "),
        ("radius = 0.1", "radius = inf", "obstacles[0].radius: value"),
        ('shape = "sphere"', 'shape = "cone"', "obstacles[0].shape: value 'cone': "),
        ('shape = "sphere"', 'shape = "box"', "obstacles[0]: a box needs half_size"),
        ('name = "view"', 'name = "ball"', "obstacles[1].name: value 'ball': is there already"),
        ("xyz = [1.0, 1.0, 1.0]", "", "either at xyz or at a camera"),
        ("xyz = [1.0, 1.0, 1.0]", 'camera = "eye"', "no such camera in [[cameras]]"),
        ("radius = 0.1", "radius = 0.1\nmax_sped = 1", "unknown key; did you mean 'max_speed'"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_key(furnished, old, new, expected):
    text = furnished.cell.read_text()
    assert old in text
    furnished.cell.write_text(text.replace(old, new))
    with pytest.raises(ConfigError, match=re.escape(expected)) as caught:
        load_cell(furnished.cell)
    assert "\n" not in str(caught.value)
    assert str(furnished.cell) in str(caught.value)


def test_a_workspace_is_a_box(furnished):
    furnished.cell.write_text(
        furnished.cell.read_text()
        + "[avoidance.workspace]\nlow = [0.0, 0.0, 0.5]\nhigh = [1.0, 1.0, 0.5]\n"
    )
    with pytest.raises(ConfigError, match="every coordinate of 'low' must be below"):
        load_cell(furnished.cell)
