"""The detector against pictures of known truth, rendered and drawn."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.server.control.spatial import Pose, rotation_log, rotation_rpy

T_WORLD_LENS = Pose(
    np.column_stack(([0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0])),
    np.array([0.6, 0.0, 0.48]),
)
"""A Lens that looks along +x of the World, upright, with the tag straight ahead."""


@pytest.fixture(scope="module", params=["opengl", "drawn"])
def bench(request):
    """A camera that stands before the tag of the shipped cell, and the way from pose to picture."""
    request.getfixturevalue("opengl" if request.param == "opengl" else "rendering")
    from telerobot.config.schema.section import PoseSection
    from telerobot.drivers.rig.physics import camera
    from telerobot.drivers.vision.detector import Detector

    cell = load_cell("pa10_vision")
    x, y, z, *rpy = T_WORLD_LENS.to_xyz_rpy()
    here = PoseSection(xyz=(x, y, z), rpy=tuple(rpy))
    shipped, *_ = cell.config.cameras
    wrist = shipped.model_copy(
        update={"T_wrist_lens": None, "T_world_lens": here, "size": (640, 480), "focal": (560, 560)}
    )
    cell = altered(cell, {"cameras": (wrist,)})
    tag = cell.config.rig.tags[0]
    park = cell.config.mechanism.postures["park"]

    class Bench:
        camera = wrist
        detector = Detector(wrist)

        def picture(self, T_lens_tag, covered=(), board=()):
            tags = [self.placed(T_lens_tag, tag)]
            for other in board:
                there = T_lens_tag @ Pose.from_xyz_rpy(other.T_board_tag.xyz, other.T_board_tag.rpy)
                update = {"name": f"t{other.tag}", "tag": other.tag, "size": other.size}
                tags.append(self.placed(there, tag.model_copy(update=update)))
            made = altered(cell, {"rig.tags": tuple(tags), "rig.boxes": ()})
            with pytest.MonkeyPatch.context() as patch:
                if request.param == "drawn":
                    patch.setattr(camera, "_unusable", ["this test draws"])
                cameras = camera.RigCameras(made)
                assert (cameras.drawn == "") == (request.param == "opengl")
            try:
                return cameras.picture("wrist", park, covered)
            finally:
                cameras.close()

        def placed(self, T_lens_tag, tag):
            x, y, z, *rpy = (T_WORLD_LENS @ T_lens_tag).to_xyz_rpy()
            pose = PoseSection(xyz=(x, y, z), rpy=tuple(rpy))
            return tag.model_copy(update={"T_world_tag": pose})

        def look(self, T_lens_tag):
            return self.detector.look(self.picture(T_lens_tag))

    return Bench()


def facing(x, y, z, tilt=(0.0, 0.0, 0.0)):
    """Return a tag at a place in the Lens, its face to the Lens, then tilted about Lens axes."""
    return Pose(rotation_rpy(*tilt) @ np.diag([1.0, -1.0, -1.0]), np.array([x, y, z]))


def apart(T, candidate):
    return (
        np.linalg.norm(T.p - candidate.p),
        np.linalg.norm(rotation_log(T.R.T @ candidate.R)),
    )


@pytest.mark.parametrize(
    ("place", "tilt"),
    [
        ((0.0, 0.0, 0.5), (0.0, 0.0, 0.0)),
        ((0.0, 0.0, 0.5), (0.5, 0.0, 0.0)),
        ((0.05, -0.04, 0.5), (0.0, 0.6, 0.0)),
        ((-0.1, 0.05, 0.6), (0.3, -0.4, 0.2)),
        ((0.08, 0.08, 0.4), (-0.4, 0.3, 1.5)),
        ((0.0, 0.1, 0.7), (0.6, 0.3, -2.0)),
    ],
)
def test_a_tag_is_found_where_it_is(bench, place, tilt):
    truth = facing(*place, tilt)
    sight = bench.look(truth)
    metres, radians = apart(truth, sight.candidates[0])
    assert metres < 0.004
    assert radians < 0.015
    assert sight.quality > 0.8


def test_seen_head_on_there_is_one_pose_and_not_two_tilted_ones(bench):
    assert len(bench.look(facing(0.0, 0.0, 0.5)).candidates) == 1


def test_a_small_tag_has_two_poses_and_one_of_them_is_right(bench):
    truth = facing(0.0, 0.0, 1.6, (0.35, 0.0, 0.0))
    sight = bench.look(truth)
    assert len(sight.candidates) == 2
    assert min(apart(truth, c)[1] for c in sight.candidates) < 0.1
    assert sight.candidates[0].error_px <= sight.candidates[1].error_px


def test_a_covered_tag_is_not_seen(bench):
    sight = bench.detector.look(bench.picture(facing(0.0, 0.0, 0.5), covered={"panel"}))
    assert (sight.candidates, sight.quality) == ((), 0.0)


def test_another_tag_is_not_taken_for_the_one_that_is_meant(bench):
    from telerobot.drivers.vision.detector import Detector

    other = Detector(bench.camera.model_copy(update={"tag": 8}))
    assert other.look(bench.picture(facing(0.0, 0.0, 0.5))).candidates == ()


def test_of_two_tags_of_one_id_neither_is_taken(bench):
    picture = bench.picture(facing(0.0, 0.0, 0.7))
    middle = picture[:, 160:480]
    assert bench.detector.look(np.hstack([middle, middle])).candidates == ()


def test_a_grey_picture_does_as_well(bench):
    picture = bench.picture(facing(0.05, 0.0, 0.5, (0.3, 0.0, 0.0)))
    grey = bench.detector.look(np.ascontiguousarray(picture[:, :, 0]))
    colour = bench.detector.look(picture)
    np.testing.assert_allclose(grey.candidates[0].p, colour.candidates[0].p, atol=2e-3)


def test_the_same_picture_gives_the_same_pose_to_the_last_bit(bench):
    picture = bench.picture(facing(0.02, 0.03, 0.5, (0.3, 0.2, 0.0)))
    first, second = bench.detector.look(picture), bench.detector.look(picture)
    assert first.candidates[0].R.tobytes() == second.candidates[0].R.tobytes()


BOARD = (
    {"tag": 9, "size": 0.06, "T_board_tag": {"xyz": [0.13, 0.02, 0.0], "rpy": [0.0, 0.0, 0.7]}},
    {
        "tag": 11,
        "size": 0.08,
        "T_board_tag": {"xyz": [-0.12, -0.01, 0.03], "rpy": [0.2, -0.3, 0.0]},
    },
)
"""Tags beside the first one: turned, and one of them tilted out of its plane."""


@pytest.fixture(scope="module")
def boarded(bench):
    """A detector for the tag and those beside it."""
    from telerobot.config.schema.surroundings import CameraSection
    from telerobot.drivers.vision.detector import Detector

    camera = CameraSection.model_validate({**bench.camera.model_dump(), "board": BOARD})
    return Detector(camera), camera.board


@pytest.mark.parametrize("covered", [(), ("panel",), ("panel", "t9"), ("t11",)])
def test_any_tag_of_a_board_tells_where_the_first_one_is(bench, boarded, covered):
    detector, board = boarded
    truth = facing(0.02, -0.03, 0.5, (0.3, -0.4, 0.2))
    sight = detector.look(bench.picture(truth, covered, board))
    metres, radians = apart(truth, sight.candidates[0])
    assert metres < 0.005
    assert radians < 0.03
    if "panel" in covered:
        assert bench.detector.look(bench.picture(truth, covered, board)).candidates == ()


def test_a_board_that_is_far_away_has_one_pose_where_its_tag_alone_has_two(bench, boarded):
    detector, board = boarded
    truth = facing(0.0, 0.0, 1.6, (0.35, 0.0, 0.0))
    picture = bench.picture(truth, board=board)
    alone, together = bench.detector.look(picture), detector.look(picture)
    assert len(alone.candidates) == 2
    best, *others = together.candidates
    assert apart(truth, best)[1] < 0.05
    assert all(other.error_px > 3.0 * best.error_px for other in others)


def test_a_tag_of_a_board_that_is_there_twice_is_left_out(bench, boarded):
    detector, board = boarded
    truth = facing(0.0, 0.0, 0.6)
    picture = bench.picture(truth, board=board)
    picture[:120] = np.roll(bench.picture(truth, ("panel", "t9"), board), -150, axis=0)[:120]
    metres, _ = apart(truth, detector.look(picture).candidates[0])
    assert metres < 0.005


def test_a_board_with_a_tag_twice_is_bad_usage():
    from pydantic import ValidationError
    from telerobot.config.schema.surroundings import CameraSection

    camera = {"name": "wrist", "T_world_lens": {}, "tag": 9, "board": BOARD}
    with pytest.raises(ValidationError, match="tag 9 is there twice"):
        CameraSection.model_validate(camera)


def test_corners_of_each_tag_are_told_where_a_pinhole_without_distortion_has_them(bench, boarded):
    """Within 0.3 pixels of the truth, by the tag's own sides and places."""
    from telerobot.server.perception.cameras import board_of
    from telerobot.server.perception.filters import pictured

    detector, board = boarded
    truth = facing(0.0, 0.0, 0.6, (0.1, -0.2, 0.1))
    seen = detector.look(bench.picture(truth, board=board[:1])).seen
    camera = bench.camera.model_copy(update={"board": board})
    assert set(seen) == {7, 9}
    for tag, corners in seen.items():
        there = pictured(board_of(camera)[tag] @ truth.R.T + truth.p)
        assert np.abs(560.0 * (corners - there)).max() < 0.3


def test_distortion_is_taken_out_of_corners():
    import cv2
    from telerobot.config.schema.surroundings import CameraSection
    from telerobot.drivers.vision.detector import Detector

    distortion = (-0.2, 0.05, 1e-3, -2e-3, 0.0)
    camera = CameraSection.model_validate(
        {"name": "eye", "T_world_lens": {}, "distortion": distortion}
    )
    points = np.array(
        [[-0.05, 0.05, 0.0], [0.05, 0.05, 0.0], [0.05, -0.05, 0.0], [-0.05, -0.05, 0.0]]
    )
    turn, place = np.array([3.0, 0.2, 0.1]), np.array([0.12, 0.09, 0.5])
    K = np.array([[560.0, 0.0, 319.5], [0.0, 560.0, 239.5], [0.0, 0.0, 1.0]])
    pixels = cv2.projectPoints(points, turn, place, K, np.array(distortion))[0].reshape(4, 2)
    plain = cv2.projectPoints(points, turn, place, np.eye(3), None)[0].reshape(4, 2)
    detector = Detector(camera)
    detector._find = lambda _picture: {0: pixels}
    seen = detector.look(np.zeros((480, 640), np.uint8)).seen
    np.testing.assert_allclose(seen[0], plain, atol=1e-4)
    assert np.abs((pixels - [319.5, 239.5]) / 560.0 - plain).max() > 3e-3
