import numpy as np
import pytest
from telerobot.config.schema.sources import VisionSection
from telerobot.server.control.inputs import ViewGoal
from telerobot.server.control.spatial import (
    Pose,
    pose_error,
    rotation_exp,
    rotation_log,
    rotation_rpy,
    twist_at,
)
from telerobot.server.control.task.sources import Vision, VisionState

from .shown import SHAPING, A, J, T, shown

SPEED = np.array([0.2] * 3 + [0.5] * 3)
ONE = np.ones(6)
LENS = Pose(rotation_rpy(0.1, -0.2, 1.5), np.array([-0.07, 0.02, 0.03]))
WRIST = Pose(rotation_rpy(0.3, 1.4, -0.2), np.array([0.6, 0.1, 0.4]))
P_MRF = WRIST.p + WRIST.R @ np.array([0.0, 0.0, 0.12])


def source():
    return Vision(VisionSection(speed=SPEED[0], angular_speed=SPEED[3]), SHAPING)


def seen(view, wrist, p_mrf, factor=1.0):
    """Return what the source is shown with the MRF at p_mrf (3,) of World."""
    T_world_mrf = Pose(wrist.R, p_mrf)
    return shown(view=view, T_world_wrist=wrist, T_world_mrf=T_world_mrf, speed_factor=factor)


def moved(pose, twist, seconds):
    """Move a pose by a constant twist in World axes at its own origin."""
    return Pose(rotation_exp(twist[3:] * seconds) @ pose.R, pose.p + twist[:3] * seconds)


def settled(goal, wrist=WRIST, gain=ONE, factor=1.0):
    """Return what the source asks for once its shaping is through."""
    vision, state = source(), VisionState.idle()
    for _ in range(200):
        rate, state = vision.rate(seen(goal, wrist, P_MRF, factor), state, gain)
    return rate


def lens_rate(rate):
    """Return the Lens's twist for one of the MRF, both in World axes."""
    p_lens_mrf = P_MRF - (WRIST @ LENS).p
    return twist_at(rate, -p_lens_mrf)


def small(rng):
    """A displacement small enough that no speed bound is met."""
    return Pose(rotation_exp(rng.uniform(-0.1, 0.1, 3)), rng.uniform(-0.05, 0.05, 3))


def test_the_lens_is_asked_for_gain_times_the_pose_error(rng):
    for _ in range(20):
        goal = WRIST @ LENS @ small(rng)
        rate = settled(ViewGoal(LENS, goal), gain=1.3 * ONE)
        expected = 1.3 * pose_error(goal, WRIST @ LENS)
        np.testing.assert_allclose(lens_rate(rate), expected, atol=1e-9)


def test_gains_act_along_the_axes_of_the_lens(rng):
    goal = WRIST @ LENS @ small(rng)
    gain = np.array([2.0, 0, 0, 0, 0, 0.5])
    R = (WRIST @ LENS).R
    rate = lens_rate(settled(ViewGoal(LENS, goal), gain=gain))
    error = pose_error(goal, WRIST @ LENS)
    expected = gain * np.concatenate([R.T @ error[:3], R.T @ error[3:]])
    np.testing.assert_allclose(R.T @ rate[:3], expected[:3], atol=1e-9)
    np.testing.assert_allclose(R.T @ rate[3:], expected[3:], atol=1e-9)


def test_of_a_camera_beside_the_arm_gains_act_along_its_own_axes(rng):
    standing = rotation_rpy(-1.8, 0.2, 0.4)
    point = Pose(rotation_rpy(0.5, 0.5, 0.0), np.array([0.0, -0.06, 0.02]))
    goal = Pose((WRIST @ point).R, (WRIST @ point).p + standing @ np.array([0.03, 0.02, 0.04]))
    lens = Pose(standing, np.array([0.6, -1.1, 0.5]))
    rate = settled(ViewGoal(point, goal, lens), gain=np.array([1.0, 0, 0, 1, 1, 1]))
    np.testing.assert_allclose(standing.T @ rate[:3], [0.03, 0, 0], atol=1e-9)


def test_a_long_way_is_gone_at_the_speed_bound_and_keeps_its_direction(rng):
    goal = WRIST @ LENS @ Pose(rotation_exp(np.array([0.3, 0.2, 0.1])), np.array([0.3, 0.1, 0.4]))
    rate = lens_rate(settled(ViewGoal(LENS, goal), gain=2.0 * ONE))
    error = 2.0 * pose_error(goal, WRIST @ LENS)
    ratio = np.linalg.norm(rate) / np.linalg.norm(error)
    np.testing.assert_allclose(rate, ratio * error, atol=1e-9)
    v, w = np.linalg.norm(rate[:3]), np.linalg.norm(rate[3:])
    assert max(v / SPEED[0], w / SPEED[3]) == pytest.approx(1.0)
    slow = lens_rate(settled(ViewGoal(LENS, goal), gain=2.0 * ONE, factor=0.1))
    np.testing.assert_allclose(slow, 0.1 * rate, atol=1e-9)


def drive(goals, gain=ONE, wrist=WRIST):
    """Let an arm that follows at once be driven; return rates and the last Wrist pose."""
    vision, state, rates, p_mrf = source(), VisionState.idle(), [], P_MRF
    for goal in goals:
        rate, state = vision.rate(seen(goal, wrist, p_mrf), state, gain)
        rates.append(rate)
        arm = p_mrf - wrist.p
        at_wrist = rate.copy()
        at_wrist[:3] -= np.cross(rate[3:], arm)
        wrist = moved(wrist, at_wrist, T)
        p_mrf = wrist.p + rotation_exp(rate[3:] * T) @ arm
    return np.array(rates), wrist


def in_bounds(rates):
    rates = np.vstack([np.zeros((2, 6)), rates])
    assert (np.abs(np.diff(rates, axis=0)) <= A * T * (1 + 1e-6)).all()
    assert (np.abs(np.diff(rates, 2, axis=0)) <= J * T**2 * (1 + 1e-6)).all()


def test_the_desired_view_is_reached_from_anywhere(rng):
    for _ in range(10):
        far = Pose(rotation_exp(rng.uniform(-1, 1, 3)), rng.uniform(-0.3, 0.3, 3))
        goal = ViewGoal(LENS, WRIST @ LENS @ far)
        rates, wrist = drive([goal] * 1500, gain=2.0 * ONE)
        in_bounds(rates)
        reached = wrist @ LENS
        assert np.linalg.norm(reached.p - goal.T_world_goal.p) < 1e-5
        assert np.linalg.norm(rotation_log(reached.R.T @ goal.T_world_goal.R)) < 1e-5


def test_a_view_that_is_lost_fades_to_exactly_nothing_and_one_found_again_goes_on(rng):
    goal = ViewGoal(LENS, WRIST @ LENS @ Pose(np.eye(3), np.array([0.2, 0.1, 0.3])))
    rates, _ = drive([goal] * 80 + [None] * 100 + [goal] * 80)
    in_bounds(rates)
    assert np.abs(rates[79]).max() > 0.05
    assert not rates[179].any()
    assert np.abs(rates[-1]).max() > 0.05


def test_without_a_gain_nothing_is_asked_for():
    goal = ViewGoal(LENS, WRIST @ LENS @ Pose(np.eye(3), np.array([0.2, 0.1, 0.3])))
    assert not settled(goal, gain=np.zeros(6)).any()
