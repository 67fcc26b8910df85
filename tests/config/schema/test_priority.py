"""What virtual spheres need of a cell: one line that names the key."""

import pytest
from telerobot.config.errors import ConfigError
from telerobot.config.load import HERE, load_cell
from telerobot.server.control.parameters import Parameters

POLE = (HERE / "cells" / "pa10_hand_pole.toml").read_text(encoding="utf-8")
JOINTS = '\njoints = ["s1", "s3"]\n'
WITHOUT = POLE[: POLE.index("\n[priority]")] + POLE[POLE.index("\n[redundancy]") :]


@pytest.mark.parametrize(
    ("text", "old", "new", "expected"),
    [
        (POLE, "outer_radius = 0.25", "outer_radius = 0.15", "outer_radius 0.15 must be above"),
        (POLE, JOINTS, '\njoints = ["s1", "s8"]\n', "priority.joints[1]: value 's8': no such"),
        (POLE, JOINTS, '\njoints = ["s1", "s1"]\n', "joints: 's1' is there twice"),
        (POLE, 'name = "forearm"', 'name = "elbow"', "spheres: 'elbow' is there twice"),
        (POLE, "steepness = 5.0", "steepness = 0.0", "priority.steepness: value 0.0"),
        (POLE, "rate = 0.3", "speed = 0.3", "priority.speed: unknown key"),
        (WITHOUT, "pole", "pole", "redundancy.spheres: value 1: there is no [priority]"),
        (POLE, 'link = "link4"', 'link = "link9"', "spheres[0].link: value 'link9': no such link"),
        (POLE, 'link = "link4"', 'link = "base"', "value 'base': no joint of the arm moves it"),
    ],
)
def test_a_mistake_is_one_line_that_names_the_key(tmp_path, text, old, new, expected):
    assert old in text
    path = tmp_path / "cell.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        Parameters.from_cell(load_cell(path))
    assert expected in str(caught.value)
    assert all(line.startswith("/") for line in str(caught.value).splitlines()), "a file, a line"


def test_a_cell_without_spheres_looks_at_none():
    assert Parameters.from_cell(load_cell("pa10_hand")).priority is None
