import dataclasses

import numpy as np
import pytest
from telerobot.server.control.inputs import NO_PICTURE
from telerobot.server.control.spatial import Pose, rotation_exp, rotation_log
from telerobot.server.perception.filters import (
    KnownCorners,
    KnownTarget,
    PictureRejection,
    SightingBounds,
    in_common,
    judge,
)

BELIEF = SightingBounds(
    period_s=0.01,
    least_quality=0.3,
    speed=0.5,
    angular_speed=2.0,
    slack=0.02,
    angular_slack=0.1,
    smoothing_s=0.0,
)


def at(x=0.0, turn=0.0):
    return Pose(rotation_exp(np.array([0.0, turn, 0.0])), np.array([1.0 + x, 0.0, 0.5]))


def told(known, *poses, errors=(0.05, 2.0), tick=105, quality=0.9, belief=BELIEF):
    return judge(known, tick, poses, errors[: len(poses)], quality, belief)


KNOWN = KnownTarget(at(), 100)


def test_the_first_picture_is_believed():
    assert told(None, at()).tick == 105


def test_a_picture_without_a_tag_or_of_poor_quality_is_not_believed():
    assert told(KNOWN) is PictureRejection.NO_TAG
    assert told(KNOWN, at(), quality=0.29) is PictureRejection.QUALITY


def test_a_target_that_jumps_is_not_believed_and_one_that_moves_is():
    # five ticks: 0.02 m of noise and 0.05 s at 0.5 m/s
    assert isinstance(told(KNOWN, at(x=0.044)), KnownTarget)
    assert told(KNOWN, at(x=0.046)) is PictureRejection.JUMP
    assert isinstance(told(KNOWN, at(turn=0.19)), KnownTarget)
    assert told(KNOWN, at(turn=0.21)) is PictureRejection.JUMP
    assert isinstance(told(KNOWN, at(x=0.046), tick=110), KnownTarget)


def test_two_poses_that_fit_alike_are_ambiguous_until_one_is_known():
    alike = (0.4, 0.5)
    assert told(None, at(turn=0.5), at(turn=-0.5), errors=alike) is PictureRejection.AMBIGUOUS
    known = KnownTarget(at(turn=-0.5), 100)
    kept = told(known, at(turn=0.5), at(turn=-0.48), errors=alike)
    np.testing.assert_allclose(kept.T_anchor_target.R, at(turn=-0.48).R, atol=1e-12)


def test_errors_inside_the_noise_tell_no_pose_from_another():
    assert told(None, at(turn=0.5), at(turn=-0.5), errors=(0.01, 0.2)) is PictureRejection.AMBIGUOUS


def test_a_pose_that_clearly_fits_worse_is_never_taken():
    assert told(KNOWN, at(turn=0.8), at(), errors=(0.1, 5.0)) is PictureRejection.JUMP


def test_an_older_picture_is_not_believed():
    assert told(KNOWN, at(), tick=100) is PictureRejection.OUT_OF_ORDER


@pytest.mark.parametrize("ticks", [1, 5, 20])
def test_the_filter_forgets_by_its_time_constant_whatever_the_rate(ticks):
    belief = dataclasses.replace(BELIEF, smoothing_s=0.1)
    known, tick = KNOWN, 100
    while tick < 120:
        tick += ticks
        known = told(known, at(x=0.01, turn=0.05), tick=tick, belief=belief)
    left = np.exp(-0.2 / 0.1)
    assert 1.01 - known.T_anchor_target.p[0] == pytest.approx(0.01 * left)
    turned = rotation_log(known.T_anchor_target.R)[1]
    assert 0.05 - turned == pytest.approx(0.05 * left)


def test_a_picture_of_which_less_than_four_corners_off_a_line_are_known_tells_nothing():
    square = np.array([[-0.1, 0.1], [0.1, 0.1], [0.1, -0.1], [-0.1, -0.1]])
    known = {3: KnownCorners(np.ones((4, 3)), 10), 5: KnownCorners(np.full((4, 3), 2.0), 10)}
    points, wanted = in_common(known, {5: square, 8: square})
    np.testing.assert_array_equal(points, known[5].points)
    np.testing.assert_array_equal(wanted, square)
    assert in_common(known, {8: square}) is NO_PICTURE
    assert in_common({}, {5: square}) is NO_PICTURE
    flat = square * [1.0, 0.005]
    assert in_common(known, {5: flat}) is NO_PICTURE
    both = in_common(known, {3: flat, 5: flat + np.array([0.0, 0.1])})
    assert len(both.points) == 8
