"""The image-based law: against OpenCV's projection, against the pose-based one, and in its loop."""

import numpy as np
import pytest
from telerobot.config.schema.sources import VisionSection
from telerobot.server.control.inputs import Picture, ViewGoal
from telerobot.server.control.spatial import (
    Pose,
    pose_error,
    rotation_exp,
    rotation_log,
    twist_at,
)
from telerobot.server.control.task import image
from telerobot.server.control.task.image import DAMPING, view_error
from telerobot.server.control.task.sources import Vision, VisionState

from .shown import SHAPING, shown

SQUARE = 0.05 * np.array([[-1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, -1.0, 0.0]])
TARGET = Pose(rotation_exp(np.array([np.pi, 0.0, 0.0])), np.array([0.0, 0.0, 0.5]))
"""A tag straight ahead of a Lens, upright."""


def displaced(rng, metres, radians):
    return Pose(rotation_exp(rng.uniform(-radians, radians, 3)), rng.uniform(-metres, metres, 3))


def seen(T_lens_target, points=SQUARE):
    P = points @ T_lens_target.R.T + T_lens_target.p
    return P[:, :2] / P[:, 2:]


def before_carried(T_world_lens, T_world_target, T_lens_stored, points=SQUARE):
    """Return the goal of a carried Lens and where that is; the Wrist is in World."""
    picture = Picture(points @ T_world_target.R.T + T_world_target.p, seen(T_lens_stored, points))
    return ViewGoal(
        T_world_lens, T_world_target @ T_lens_stored.inverse(), picture=picture
    ), T_world_lens


def before_standing(T_world_lens, T_world_target, T_lens_stored, points=SQUARE):
    """Return the goal of a carried target and where that is, before a Lens that stands."""
    picture = Picture(points, seen(T_lens_stored, points))
    goal = ViewGoal(T_world_target, T_world_lens @ T_lens_stored, T_world_lens, picture)
    return goal, T_world_target


def test_the_interaction_matrix_is_the_slope_of_opencvs_projection(rng):
    """By central differences over motions of the camera; nothing of the projection is ours."""
    cv2 = pytest.importorskip("cv2")
    points = np.column_stack([rng.uniform(-0.3, 0.3, (12, 2)), rng.uniform(0.3, 2.0, 12)])

    def projected(twist):
        shift = -cv2.Rodrigues(-twist[3:])[0] @ twist[:3]
        found, _ = cv2.projectPoints(points, -twist[3:], shift, np.eye(3), None)
        return found.ravel()

    h = 1e-5
    slope = [(projected(h * axis) - projected(-h * axis)) / (2 * h) for axis in np.eye(6)]
    L = np.empty((2 * len(points), 6))
    image._interaction.py_func(points, L)
    np.testing.assert_allclose(L, np.transpose(slope), atol=2e-8)


@pytest.mark.parametrize("before", [before_carried, before_standing])
def test_to_first_order_it_asks_for_what_the_pose_based_law_asks_for(rng, before):
    """Of a board with some depth: at a tenth of the way, the rest is a tenth of its share."""
    beside = np.array([[0.0, 0.0, 0.0], [0.3, 0.1, 0.15], [-0.25, -0.1, -0.1]])
    board = np.concatenate([SQUARE + each for each in beside])
    for _ in range(10):
        T_world_lens = displaced(rng, 0.5, 1.0)
        step = displaced(rng, 0.02, 0.04)
        T_world_target = T_world_lens @ TARGET @ displaced(rng, 0.05, 0.1)
        rests = []
        for part in (1.0, 0.1):
            small = Pose(rotation_exp(part * rotation_log(step.R)), part * step.p)
            stored = T_world_lens.inverse() @ T_world_target @ small
            goal, here = before(T_world_lens, T_world_target, stored, board)
            asked, pose = view_error(goal, here), pose_error(goal.T_world_goal, here)
            rests.append(np.linalg.norm(asked - pose) / np.linalg.norm(pose))
        assert rests[0] < 0.15
        assert rests[1] < 0.2 * rests[0] + 1e-3


def followed(before, T_world_lens, T_world_target, stored, seconds=20.0, gain=1.0):
    """Let the moved thing go as it is asked to; return the target in the Lens, step by step."""
    lens, target, way = T_world_lens, T_world_target, []
    for _ in range(round(seconds * 50)):
        goal, here = before(lens, target, stored)
        rate = 0.02 * gain * view_error(goal, here)
        went = Pose(rotation_exp(rate[3:]) @ here.R, here.p + rate[:3])
        lens, target = (went, target) if before is before_carried else (lens, went)
        way.append(lens.inverse() @ target)
    return way


@pytest.mark.parametrize("before", [before_carried, before_standing])
def test_it_leads_to_the_stored_picture_from_half_a_metre_and_forty_degrees(rng, before):
    for _ in range(6):
        lens = displaced(rng, 0.5, 1.0)
        tilt = Pose(rotation_exp(np.array([0.25, -0.15, 0.0])), np.zeros(3))
        stored = TARGET @ tilt
        target = (
            lens @ Pose(np.eye(3), rng.uniform(-0.1, 0.1, 3)) @ stored @ displaced(rng, 0.1, 0.4)
        )
        end = followed(before, lens, target, stored)[-1]
        np.testing.assert_allclose(seen(end), seen(stored), atol=1e-5)
        assert np.linalg.norm(pose_error(end, stored)) < 1e-3


@pytest.mark.parametrize("before", [before_carried, before_standing])
@pytest.mark.parametrize("degrees", [90, 150, 179, -179, 180])
def test_a_turn_about_the_optical_axis_backs_off_by_a_seventh_at_most(before, degrees):
    """Without a bound a turn of 180° takes the camera straight back, for ever."""
    stored = Pose(TARGET.R, np.array([0.03, -0.02, 0.5]))
    spin = Pose(rotation_exp(np.array([0.0, 0.0, np.radians(degrees)])), np.zeros(3))
    way = followed(before, Pose.identity(), stored @ spin, stored, 15.0)
    away = max(T.p[2] for T in way)
    assert away < 0.5 / np.cos(np.radians(30.0)) * 1.02
    assert np.linalg.norm(pose_error(way[-1], stored)) < 1e-3
    # The tag stays near where it was in the picture, and in it.
    off = [np.abs(T.p[:2] / T.p[2] - stored.p[:2] / stored.p[2]).max() for T in way]
    assert max(off) < 0.03


def test_what_tells_little_is_damped_and_never_asks_for_more_than_noise_over_twice_the_damping(rng):
    """A tag far away and head-on, whose corners are a tenth of a pixel off."""
    stored = Pose(TARGET.R, np.array([0.0, 0.0, 8.0]))
    for _ in range(50):
        goal, here = before_carried(Pose.identity(), stored, stored)
        noise = rng.normal(0.0, 2.5e-4, (4, 2))
        wanted = goal.picture.wanted + noise
        noisy = ViewGoal(
            goal.T_wrist_point, goal.T_world_goal, picture=Picture(goal.picture.points, wanted)
        )
        asked = view_error(noisy, here) / np.repeat([8.0, 1.0], 3)
        most = np.sqrt((noise**2).sum() / 4) / (2.0 * DAMPING)
        assert np.linalg.norm(asked) <= most * 1.0001


@pytest.mark.parametrize("place", [(0.0, 0.0, -0.5), (0.0, 0.0, 1e-4), (5.0, 0.0, 0.4)])
def test_points_that_no_picture_shows_ask_for_nothing(place):
    goal, here = before_carried(Pose.identity(), Pose(TARGET.R, np.array(place)), TARGET)
    assert not view_error(goal, here).any()


def test_what_is_asked_for_is_finite_however_small_the_tag_and_far_aside(rng):
    for _ in range(2000):
        points = 10.0 ** rng.uniform(-6, 0) * SQUARE + rng.uniform(-10.0, 10.0, 3)
        points[:, 2] = 10.0 ** rng.uniform(-2.9, 1)
        wanted = rng.uniform(-1.0, 1.0, (4, 2)) * 10.0 ** rng.uniform(-3, 3)
        T = Pose.identity()
        assert np.isfinite(view_error(ViewGoal(T, T, picture=Picture(points, wanted)), T)).all()


def test_the_source_takes_the_picture_in_place_of_the_pose_with_gains_bounds_and_lever(rng):
    T_world_lens = displaced(rng, 0.5, 1.0)
    stored = TARGET @ displaced(rng, 0.02, 0.2)
    target = T_world_lens @ TARGET @ displaced(rng, 0.02, 0.2)
    goal, here = before_carried(T_world_lens, target, stored)
    misled = ViewGoal(T_world_lens, Pose.identity(), picture=goal.picture)
    gain = np.array([1.0, 0.5, 0.0, 2.0, 1.0, 1.5])
    p_mrf = here.p + np.array([0.02, -0.1, 0.2])
    found = []
    for speed, turn in ((5.0, 10.0), (0.02, 10.0), (5.0, 0.05)):
        source, state = (
            Vision(VisionSection(speed=speed, angular_speed=turn), SHAPING),
            VisionState.idle(),
        )
        for _ in range(300):
            rate, state = source.rate(
                shown(view=misled, T_world_wrist=Pose.identity(),
                      T_world_mrf=Pose(np.eye(3), p_mrf), speed_factor=1.0), state, gain,
            )  # fmt: skip
        found.append(twist_at(rate, here.p - p_mrf))
    error = view_error(goal, here)
    axes = here.R
    wanted = gain * np.concatenate([axes.T @ error[:3], axes.T @ error[3:]])
    free, slow, still = (np.concatenate([axes.T @ t[:3], axes.T @ t[3:]]) for t in found)
    np.testing.assert_allclose(free, wanted, atol=1e-9)
    np.testing.assert_allclose(slow, wanted * 0.02 / np.linalg.norm(wanted[:3]), atol=1e-9)
    np.testing.assert_allclose(still, wanted * 0.05 / np.linalg.norm(wanted[3:]), atol=1e-9)
