"""Drawn pictures: the tag where a pinhole has it, and OpenGL; what stands before it hides it."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.server.control.spatial import Pose, rotation_rpy

pytest.importorskip("cv2")

CELLS = ("pa10_vision", "pa10_all", "ranger")
CLOSE_PX = 0.2
REFINED_PX = 0.35
"""The detector refines corners to 0.3 px only, in rendered pictures too."""


@pytest.fixture
def drawn(monkeypatch):
    """Return a function that makes the cameras of a cell, which draw."""
    from telerobot.drivers.rig.physics import camera

    monkeypatch.setattr(camera, "_unusable", ["this test draws"])
    return camera.RigCameras


def postures(cell, count):
    ready = np.array(cell.config.mechanism.postures["ready"])
    rng = np.random.default_rng(0)
    return [ready, *(ready + rng.normal(0.0, 0.06, len(ready)) for _ in range(count))]


def corners(cell, cameras, q, covered=()):
    """Return the corners of the tag that each camera finds, None where it finds none."""
    from telerobot.drivers.vision.detector import Detector

    return {
        camera.name: Detector(camera).look(cameras.picture(camera.name, q, covered)).corners
        for camera in cell.cameras
    }


@pytest.mark.parametrize("name", CELLS)
def test_drawn_and_rendered_pictures_agree_on_where_the_tag_is(opengl, drawn, monkeypatch, name):
    from telerobot.drivers.rig.physics import camera

    cell = load_cell(name)
    by_hand = drawn(cell)
    with monkeypatch.context() as patch:
        patch.setattr(camera, "_unusable", [])
        by_opengl = camera.RigCameras(cell)
    assert by_hand.drawn
    found = 0
    for q in postures(cell, 7):
        ours, theirs = corners(cell, by_hand, q), corners(cell, by_opengl, q)
        for eye, seen in theirs.items():
            assert (ours[eye] is None) == (seen is None)
            if seen is not None:
                assert np.abs(ours[eye] - seen).max() < CLOSE_PX
                found += 1
    by_opengl.close()
    assert found >= 8


@pytest.mark.parametrize("tilt", [(0.0, 0.0, 0.0), (0.5, 0.3, 0.4), (-0.4, 0.6, 2.0)])
@pytest.mark.parametrize("away_m", [0.5, 0.8, 1.4])
def test_a_drawn_tag_is_where_a_pinhole_has_it(drawn, tilt, away_m):
    cell = load_cell("pa10_vision")
    (eye,) = [c for c in cell.cameras if c.on == "world"]
    (tag,) = [t for t in cell.config.rig.tags if t.tag == cell.cameras[0].tag]
    lens = eye.T_world_lens
    T_world_lens = Pose(rotation_rpy(*lens.rpy), np.array(lens.xyz))
    T_lens_tag = Pose(
        rotation_rpy(*tilt) @ np.diag([1.0, -1.0, -1.0]), np.array([0.04, -0.05, away_m])
    )
    from telerobot.drivers.vision.detector import Detector

    arm_away = cell.config.mechanism.postures["park"]
    place = (T_world_lens @ T_lens_tag).to_xyz_rpy()
    picture = drawn(cell).picture(eye.name, arm_away, (), {tag.name: place})
    seen = Detector(eye.model_copy(update={"tag": tag.tag})).look(picture).corners

    h = tag.size / 2
    square = np.array([[-h, h, 0.0], [h, h, 0.0], [h, -h, 0.0], [-h, -h, 0.0]])
    in_lens = square @ T_lens_tag.R.T + T_lens_tag.p
    expected = eye.focal[0] * in_lens[:, :2] / in_lens[:, 2:] + np.array(eye.centre)
    assert seen is not None
    assert np.abs(seen - expected).max() < REFINED_PX


def test_a_box_before_the_tag_hides_it_and_one_behind_it_does_not(drawn):
    cell = load_cell("pa10_vision")
    (tag,) = [t for t in cell.config.rig.tags if t.T_world_tag is not None]
    q = cell.config.mechanism.postures["ready"]
    eye = cell.cameras[0].name
    assert corners(cell, drawn(cell), q)[eye] is not None
    x, y, z = tag.T_world_tag.xyz
    for shift, hidden in ((-0.1, True), (0.1, False)):
        box = {
            "name": "screen",
            "half_size": [0.01, 0.3, 0.3],
            "xyz": [x + shift, y, z],
        }
        blocked = altered(cell, {"rig.boxes": [box]})
        assert (corners(blocked, drawn(blocked), q)[eye] is None) == hidden


def test_a_covered_tag_is_not_drawn(drawn):
    cell = load_cell("pa10_vision")
    names = {tag.name for tag in cell.config.rig.tags}
    q = cell.config.mechanism.postures["ready"]
    assert set(corners(cell, drawn(cell), q, names).values()) == {None}


def test_what_reaches_behind_the_camera_is_cut_off_there(drawn):
    """A floor from a metre behind to a metre ahead of the lens fills the picture's lower half."""
    cell = load_cell("pa10_vision")
    eye = next(c for c in cell.cameras if c.on == "world")
    x, y, z = eye.T_world_lens.xyz
    slab = {"name": "slab", "half_size": [2.0, 2.0, 0.01], "xyz": [x, y, z - 0.3]}
    wide = altered(cell, {"rig.boxes": [slab]})
    q = cell.config.mechanism.postures["park"]
    picture = drawn(wide).picture(eye.name, q)
    bottom = picture[-1].astype(int)
    assert np.abs(bottom - bottom[0]).max() <= 2
    assert np.abs(bottom[0] - picture[0, 0]).max() > 5
