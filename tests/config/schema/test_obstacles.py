"""What a person can get wrong about obstacles, sight lines and the workspace."""

import re

import pytest
from telerobot.config.load import ConfigError, load_cell
from telerobot.server.control.proximity.capsules import Capsules

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
    assert all(line.startswith("/") for line in str(caught.value).splitlines()), "a file, a line"
    assert str(furnished.cell) in str(caught.value)


def test_a_workspace_is_a_box(furnished):
    furnished.cell.write_text(
        furnished.cell.read_text()
        + "[avoidance.workspace]\nlow = [0.0, 0.0, 0.5]\nhigh = [1.0, 1.0, 0.5]\n"
    )
    with pytest.raises(ConfigError, match="every coordinate of 'low' must be below"):
        load_cell(furnished.cell)


def test_a_sight_line_that_moves_with_the_arm_is_no_barrier(furnished):
    camera = '[[cameras]]\nname = "eye"\nT_wrist_lens = { xyz = [0.0, 0.0, 0.1] }\n'
    text = furnished.cell.read_text().replace("xyz = [1.0, 1.0, 1.0]", 'camera = "eye"') + camera
    furnished.cell.write_text(text)
    load_cell(furnished.cell)
    furnished.cell.write_text(text.replace('camera = "eye"', 'camera = "eye"\nhard = true'))
    with pytest.raises(ConfigError, match=r"obstacles\[1\]\.hard: .* moves with the arm"):
        load_cell(furnished.cell)


def test_only_a_link_that_is_there_may_be_allowed_to_touch(furnished):
    contact = '[[avoidance.allowed_contacts]]\nlink = "{}"\nother = "ball"\n'
    text = furnished.cell.read_text()
    furnished.cell.write_text(text + contact.format("nose"))
    with pytest.raises(ConfigError, match=r"allowed_contacts\[0\]\.link: value 'nose': no such"):
        load_cell(furnished.cell)
    furnished.cell.write_text(text + contact.format(load_cell_links(furnished.cell)[-1]))
    load_cell(furnished.cell)


def load_cell_links(path):
    text = path.read_text().split("[[avoidance")[0]
    path.write_text(text)
    return load_cell(path).robot.links()


SHAPE = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'


def test_a_heavy_link_without_a_shape_is_refused_where_clearances_are_kept(furnished):
    furnished.replace_in_urdf(f"{SHAPE}</link>", "</link>")
    with pytest.raises(ConfigError, match=r"avoidance\.capsules: link 'base' of .* no <collision>"):
        load_cell(furnished.cell)


def test_a_capsule_in_the_cell_is_a_shape_too(furnished):
    furnished.replace_in_urdf(f"{SHAPE}</link>", "</link>")
    links = ("base", "l1", "l2", "l3", "tip", "finger")
    capsules = "".join(
        f'[[avoidance.capsules]]\nlink = "{link}"\nstart = [0.0, 0.0, 0.0]\nend = [0.0, 0.0, 0.1]\n'
        "radius = 0.05\n"
        for link in links
    )
    furnished.cell.write_text(furnished.cell.read_text() + capsules)
    assert len(load_cell(furnished.cell).config.avoidance.capsules) == len(links)


CAPSULE = """
[[avoidance.capsules]]
link = "l3"
start = [0.0, 0.0, 0.0]
end = [0.0, 0.0, 0.35]
radius = 0.06
holds = ["{}"]
"""


def test_a_capsule_stands_for_links_that_are_fixed_to_its_own_and_for_no_others(furnished):
    text, bare = furnished.urdf.read_text(), 0
    for link in text.split("<link ")[1:]:
        if link.startswith('name="tip"'):
            furnished.urdf.write_text(text.replace(link, link.replace(SHAPE, "")))
            bare += 1
    assert bare == 1
    with pytest.raises(ConfigError, match=r"link 'tip' of .* no <collision>"):
        load_cell(furnished.cell)
    text = furnished.cell.read_text()
    furnished.cell.write_text(text + CAPSULE.format("tip"))
    assert "tip" not in Capsules(load_cell(furnished.cell)).links
    for link, told in (("l2", "must be fixed to 'l3'"), ("nose", "no such link")):
        furnished.cell.write_text(text + CAPSULE.format("tip") + CAPSULE.format(link))
        with pytest.raises(
            ConfigError, match=rf"capsules\[1\]\.holds\[0\]: value '{link}': {told}"
        ):
            Capsules(load_cell(furnished.cell))


def test_shapes_are_no_matter_where_no_clearance_is_kept(small):
    small.replace_in_urdf(f"{SHAPE}</link>", "</link>")
    assert not load_cell(small.cell).config.keeps_clear
