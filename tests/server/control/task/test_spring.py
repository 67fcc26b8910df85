"""A virtual fixture: where it pulls to in closed form, and what it leaves free."""

from dataclasses import replace

import numpy as np
import pytest
from telerobot.config.schema.sources import SpringSection
from telerobot.server.control.arm import Arm as ArmControl
from telerobot.server.control.inputs import StickCommand
from telerobot.server.control.scene import Body, Moved
from telerobot.server.control.spatial import Pose, rotation_exp, rotation_rpy, twist_at
from telerobot.server.control.task.sources import Spring
from telerobot.server.control.tick import Control

from .shown import SHAPING, A, J, T, shown

POINT, DIRECTION = np.array([0.4, -0.1, 0.3]), np.array([1.0, 2.0, -2.0])
UNIT = DIRECTION / 3.0
GAIN = np.array([2.0, 2.0, 2.0, 1.5, 1.5, 1.5])
WIDE = {"speed": 5.0, "angular_speed": 10.0}


def spring(**section):
    given = {"point": tuple(POINT), "direction": tuple(DIRECTION), **WIDE}
    return Spring(SpringSection(**{**given, **section}), SHAPING)


def settled(source, pose, gain=GAIN, **said):
    """Return what the source asks for once its shaping is through."""
    state = source.idle()
    for _ in range(300):
        rate, state = source.rate(shown(T_world_mrf=pose, **said), state, gain)
    return rate


def test_a_line_pulls_across_itself_and_leaves_its_direction_free(rng, random_pose):
    for _ in range(10):
        pose = random_pose(0.5)
        rate = settled(spring(), pose)
        along = (pose.p - POINT) @ UNIT
        np.testing.assert_allclose(rate[:3], 2.0 * (POINT + along * UNIT - pose.p), atol=1e-9)
        assert abs(rate[:3] @ UNIT) < 1e-9
        assert not rate[3:].any()


def test_a_plane_pulls_along_its_normal_alone(random_pose):
    for _ in range(10):
        pose = random_pose(0.5)
        rate = settled(spring(shape="plane"), pose)
        np.testing.assert_allclose(rate[:3], -2.0 * ((pose.p - POINT) @ UNIT) * UNIT, atol=1e-9)


def test_the_tools_axis_is_turned_into_the_direction_by_the_shortest_arc(random_pose):
    axis = np.array([0.0, 0.0, 1.0])
    for _ in range(20):
        pose = random_pose(0.5)
        rate = settled(spring(tool_axis=tuple(axis)), pose)
        turn = rate[3:] / 1.5
        np.testing.assert_allclose(rotation_exp(turn) @ pose.R @ axis, UNIT, atol=1e-8)
        assert np.linalg.norm(turn) == pytest.approx(np.arccos(UNIT @ pose.R @ axis), abs=1e-8)


@pytest.mark.parametrize("axis", [(0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0)])
def test_a_tool_that_points_the_other_way_is_turned_around_and_not_left_so(axis):
    source = spring(direction=tuple(-x for x in axis), tool_axis=axis)
    turn = settled(source, Pose(np.eye(3), POINT))[3:] / 1.5
    assert np.linalg.norm(turn) == pytest.approx(np.pi)
    assert abs(turn @ axis) < 1e-9


def test_inside_the_deadband_nothing_pulls_and_beyond_it_what_is_beyond():
    source = spring(shape="plane", deadband=0.01)
    assert not settled(source, Pose(np.eye(3), POINT + 0.009 * UNIT)).any()
    rate = settled(source, Pose(np.eye(3), POINT + 0.03 * UNIT))
    np.testing.assert_allclose(rate[:3], -2.0 * 0.02 * UNIT, atol=1e-9)


def test_from_far_it_pulls_at_its_speed_and_reduced_speed_slows_it():
    source = spring(shape="plane", speed=0.05)
    far = Pose(np.eye(3), POINT + 0.5 * UNIT)
    np.testing.assert_allclose(settled(source, far)[:3], -0.05 * UNIT, atol=1e-9)
    np.testing.assert_allclose(settled(source, far, speed_factor=0.2)[:3], -0.01 * UNIT, atol=1e-9)


def test_gains_act_along_the_axes_of_its_frame_and_it_rides_on_a_carrier(random_pose):
    carrier, pose = random_pose(0.4), random_pose(0.4)
    moved = Moved(
        Body.standing(Pose.identity()), Body.standing(carrier), T_world_base_measured=carrier
    )
    gain = np.array([1.0, 0.0, 2.0, 0.0, 0.0, 0.0])
    rate = settled(spring(relative_to="carrier"), pose, gain, moved=moved)
    seen = carrier.R.T @ (pose.p - carrier.p)
    way = POINT + ((seen - POINT) @ UNIT) * UNIT - seen
    np.testing.assert_allclose(carrier.R.T @ rate[:3], gain[:3] * way, atol=1e-9)


def test_where_it_is_told_at_another_point_of_the_tool_it_is_the_same_motion(random_pose):
    pose, lever = random_pose(0.4), np.array([0.1, -0.2, 0.05])
    source = spring(tool_axis=(1.0, 0.0, 0.0))
    there = settled(source, pose, lever=lever)
    np.testing.assert_allclose(there, settled(source, pose), atol=1e-9)
    assert np.abs(twist_at(there, lever) - there).max() > 1e-3


def test_however_the_fixture_jumps_its_rate_is_inside_the_shaping(rng):
    source, state, rates = spring(relative_to="carrier"), None, [np.zeros(6)] * 2
    state = source.idle()
    for _ in range(20):
        carrier = Body.standing(Pose(np.eye(3), rng.uniform(-0.3, 0.3, 3)))
        moved = Moved(Body.standing(Pose.identity()), carrier, Pose.identity())
        for _ in range(rng.integers(1, 30)):
            rate, state = source.rate(shown(moved=moved), state, GAIN)
            rates.append(rate)
    assert (np.abs(np.diff(rates, axis=0)) <= A * T * (1 + 1e-6)).all()
    assert (np.abs(np.diff(rates, 2, axis=0)) <= J * T**2 * (1 + 1e-6)).all()


def fixed(pa10, start, **section):
    """Return a run of the arm with a fixture through where its tool is, and its gain at 2 /s."""
    p = pa10.p
    at = start(pa10, "ready").pose.p
    given = {"point": tuple(at), "shape": "plane", "direction": (1.0, 0.0, 0.0), **section}
    sources = p.sources.model_copy(update={"spring": SpringSection(**given)})
    arm = replace(pa10, control=Control([ArmControl(replace(p, sources=sources), pa10.mechanism)]))
    run = start(arm, "ready")
    run.set(gains=pa10.gains(spring=2.0, position=0.0))
    return run, at


def test_on_the_arm_a_distance_dies_out_as_the_gain_says(pa10, start):
    run, at = fixed(pa10, start)
    run.set(gains={**run.settings.gains, "spring": np.zeros(6)})
    push = StickCommand(np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0]), np.eye(3))
    run.go(1.0, stick=push)
    run.go(1.0)
    run.set(gains=pa10.gains(spring=2.0, position=0.0))
    run.go(0.6)  # the gain is ramped, and the rate is shaped
    before = run.pose.p[0] - at[0]
    assert before > 0.01
    for k in range(1, 11):
        run.go(0.1)
        assert run.pose.p[0] - at[0] == pytest.approx(before * np.exp(-0.2 * k), rel=0.02)
    run.observe()


def test_on_the_arm_a_stick_glides_in_the_plane_and_stands_off_by_its_rate_over_the_gain(
    pa10, start
):
    run, at = fixed(pa10, start)
    push = StickCommand(np.array([0.02, 0.04, 0.0, 0.0, 0.0, 0.0]), np.eye(3))
    run.go(4.0, stick=push)
    x, y, _ = run.pose.p - at
    assert x == pytest.approx(0.02 / 2.0, rel=0.01)
    assert y == pytest.approx(0.04 * 4.0, rel=0.03)
    assert run.outputs[-1].twists["spring"][0] == pytest.approx(-0.02, rel=0.01)
    run.go(4.0)
    assert abs(run.pose.p[0] - at[0]) < 1e-4
    run.observe()


def test_a_new_mrf_makes_no_jump(pa10, start):
    run, _ = fixed(pa10, start, tool_axis=(0.0, 0.0, 1.0), direction=(1.0, 0.5, -1.0))
    run.go(0.5)
    mrf = run.settings.T_wrist_mrf
    shift = Pose(rotation_rpy(0.0, 0.0, 0.3), np.array([0.05, 0.0, 0.1]))
    run.set(T_wrist_mrf=mrf @ shift, redefined=1)
    run.go(1.0)
    run.observe()
