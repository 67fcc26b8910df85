import numpy as np
import pytest
from telerobot.server.control.spatial import cross
from telerobot.server.control.task.task import Feedforward, FeedforwardState

T = 0.01
A, J = np.repeat([2.0, 6.0], 3), np.repeat([40.0, 120.0], 3)
MOST = (0.5, 1.5)
HERE = np.zeros(3)
CARRIED = np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.05])
JUMP = np.array([0.1, 0.0, -0.04, 0.2, 0.4, -0.2])


@pytest.fixture
def frames():
    return Feedforward(A, J, MOST, T)


def settled(frames, carried):
    state = FeedforwardState()
    for _ in range(200):
        twist, state = frames.rate(state, carried, None, HERE)
    return twist, state


def test_where_nothing_moves_and_nothing_is_redefined_it_asks_for_nothing(frames):
    twist, _ = settled(frames, None)
    assert not twist.any()


def test_the_grounds_motion_is_passed_on_whole_once_it_was_taken_up(frames):
    first, _ = frames.rate(FeedforwardState(), CARRIED, None, HERE)
    np.testing.assert_allclose(first, 0.0, atol=1e-15)
    twist, _ = settled(frames, CARRIED)
    np.testing.assert_array_equal(twist, CARRIED)


def test_what_the_sum_would_jump_by_is_added_whichever_point_of_the_tool_is_the_mrf(frames):
    """It is the same motion of the rigid body, so that it fades alike for every MRF."""
    _, state = settled(frames, None)
    lever = np.array([0.05, -0.02, 0.3])
    twist, owed = frames.rate(state, None, JUMP, lever)
    np.testing.assert_allclose(twist, JUMP, atol=1e-15)
    for _ in range(5):
        at_mrf, _ = frames.rate(owed, None, None, HERE)
        elsewhere, owed = frames.rate(owed, None, None, lever)
        at_mrf[:3] -= cross(at_mrf[3:], lever)
        np.testing.assert_allclose(at_mrf, elsewhere, atol=1e-15)


def test_a_redefinition_is_paid_back_inside_acceleration_and_jerk(frames):
    _, state = settled(frames, CARRIED)
    totals = [CARRIED + JUMP]
    for tick in range(100):
        twist, state = frames.rate(state, CARRIED, JUMP if tick == 0 else None, HERE)
        totals.append(twist)
    np.testing.assert_allclose(totals[1], totals[0], atol=1e-15)
    np.testing.assert_array_equal(totals[-1], CARRIED)
    rate = np.diff(totals, axis=0) / T
    assert (np.abs(rate) <= A * 1.001).all()
    assert (np.abs(np.diff(rate[1:], axis=0)) / T <= J * 1.001).all()


def test_no_more_is_owed_than_the_tools_speed_however_often_frames_are_redefined(frames, rng):
    _, state = settled(frames, None)
    for tick in range(300):
        jump = 3.0 * JUMP * rng.uniform(0.0, 1.0, 6) if tick % 3 == 0 else None
        twist, state = frames.rate(state, None, jump, HERE)
        assert np.linalg.norm(twist[:3]) <= MOST[0] * 1.001
        assert np.linalg.norm(twist[3:]) <= MOST[1] * 1.001
    for _ in range(60):
        twist, state = frames.rate(state, None, None, HERE)
    assert not twist.any()
