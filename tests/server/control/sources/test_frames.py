import numpy as np
import pytest
from telerobot.server.control.frames import Pose, cross, rotation_rpy
from telerobot.server.control.sources.frames import Frames, FramesState

T = 0.01
A, J = np.repeat([2.0, 6.0], 3), np.repeat([40.0, 120.0], 3)
MRF = Pose(np.eye(3), np.array([0.0, 0.0, 0.121]))
R = rotation_rpy(0.3, -0.4, 0.9)
OTHERS = np.array([0.05, 0.0, -0.02, 0.1, 0.2, -0.1])


@pytest.fixture
def frames():
    return Frames(A, J, T)


def settled(frames, carried, others=OTHERS, definition=(MRF, 0, "world")):
    state = FramesState()
    for _ in range(200):
        twist, state = frames.rate(state, others, carried, definition, R)
    return twist, state


def test_where_nothing_moves_and_nothing_is_redefined_it_asks_for_nothing(frames):
    twist, _ = settled(frames, None)
    assert not twist.any()


def test_the_grounds_motion_is_passed_on_whole_once_it_was_taken_up(frames):
    carried = np.array([0.0, 0.1, 0.0, 0.0, 0.0, 0.05])
    first, _ = frames.rate(FramesState(), OTHERS, carried, (MRF, 0, "carrier"), R)
    np.testing.assert_allclose(first, 0.0, atol=1e-15)
    twist, _ = settled(frames, carried, definition=(MRF, 0, "carrier"))
    np.testing.assert_array_equal(twist, carried)


def test_a_new_mrf_leaves_the_motion_of_the_rigid_body_as_it_is(frames):
    _, state = settled(frames, None)
    new = Pose(rotation_rpy(0.5, 0.0, 0.0), np.array([0.05, -0.02, 0.3]))
    others = np.array([0.0, 0.0, 0.0, -0.1, 0.0, 0.0])  # what sources ask of the new one
    twist, _ = frames.rate(state, others, None, (new, 1, "world"), R)
    total = others + twist
    np.testing.assert_allclose(total[3:], OTHERS[3:], atol=1e-15)
    expected = OTHERS[:3] + cross(OTHERS[3:], R @ (new.p - MRF.p))
    np.testing.assert_allclose(total[:3], expected, atol=1e-15)


@pytest.mark.parametrize("definition", [(MRF, 1, "world"), (MRF, 0, "carrier")])
def test_a_redefinition_is_paid_back_inside_acceleration_and_jerk(frames, definition):
    _, state = settled(frames, None)
    carried = np.array([0.0, 0.2, 0.0, 0.0, 0.0, 0.3])
    others, totals = -OTHERS, [OTHERS]
    for _ in range(100):
        twist, state = frames.rate(state, others, carried, definition, R)
        totals.append(others + twist)
    np.testing.assert_allclose(totals[1], totals[0], atol=1e-15)
    np.testing.assert_array_equal(totals[-1], others + carried)
    rate = np.diff(totals, axis=0) / T
    assert (np.abs(rate) <= A * 1.001).all()
    assert (np.abs(np.diff(rate[1:], axis=0)) / T <= J * 1.001).all()
