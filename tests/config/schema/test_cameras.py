"""What a person can get wrong about cameras, tags and views."""

import re

import pytest
from telerobot.config.load import ConfigError, load_cell

CAMERA = """
[[cameras]]
name = "eye"
T_wrist_lens = { xyz = [0.0, 0.0, 0.1] }
tag = 7

[sources.vision]
camera = "eye"
"""
TAG = """
[[rig.tags]]
name = "panel"
T_world_tag = { xyz = [1.0, 0.0, 0.5] }
tag = 7
"""


@pytest.fixture
def seeing(small):
    """The small cell, with a camera and a tag."""
    small.cell.write_text(small.cell.read_text() + CAMERA + TAG)
    return small


def test_a_camera_and_a_tag_are_read(seeing):
    config = load_cell(seeing.cell).config
    assert config.cameras[0].centre == (319.5, 239.5)
    assert not config.sources.vision.enabled


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("tag = 7\n\n[sources", 'tag = 7\nlaw = "pictures"\n\n[sources', "law: value 'pictures'"),
        ('camera = "eye"', 'camera = "eyes"', r"vision\.camera: value 'eyes': no such .*'eye'"),
        ("T_wrist_lens = {", "T_wrist_lense = {", r"cameras\[0\]\.T_wrist_lense: unknown key"),
        ("tag = 7\n\n[sou", "T_world_lens = {}\n\n[sou", r"cameras\[0\]: give one of T_wrist_lens"),
        ("tag = 7\n\n[sou", "focal = [500.0, 510.0]\n\n[sou", r"cameras\[0\]\.focal: .*pinhole"),
        ("tag = 7\n\n[sou", "tag = 7\ntag_size = 0.2\n\n[sou", r"tag_size: value 0\.2: .*as 0\.1"),
        (
            "tag = 7\n\n[sou",
            "tag = 3\nboard = [{ tag = 7, size = 0.2, T_board_tag = {} }]\n\n[sou",
            r"cameras\[0\]\.board\[0\]\.size: value 0\.2: rig\.tags has 0\.1",
        ),
        ('camera = "eye"', "gain = [-1.0, 1, 1, 1, 1, 1]", r"vision\.gain\[0\]: value -1"),
        ("T_world_tag = {", "T_wrist_tag = {}\nT_world_tag = {", r"rig\.tags\[0\]: give either"),
    ],
)
def test_what_does_not_fit_is_named(seeing, old, new, expected):
    with pytest.raises(ConfigError) as error:
        load_cell(seeing.replace(old, new))
    assert re.search(expected, str(error.value)), str(error.value)


def test_two_cameras_of_one_name_are_refused(seeing):
    seeing.cell.write_text(seeing.cell.read_text() + CAMERA.partition("[sources")[0])
    with pytest.raises(ConfigError, match=r"cameras\[1\]\.name: value 'eye': is there already"):
        load_cell(seeing.cell)
