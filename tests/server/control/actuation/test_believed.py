"""Which part of the measured wrench is left out: by figures, without an arm."""

import math

import numpy as np
import pytest
from telerobot.server.control.actuation.believed import (
    ANGLE,
    FORCE,
    LEVER,
    MOMENT,
    NOTHING_LEFT_OUT,
    Believed,
    believed,
    may_be_weight,
    without_what_is_there,
)
from telerobot.server.control.spatial import GRAVITY, rotation_exp

G = abs(GRAVITY[2])
DOWN, UP, ALONG_X = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0]), np.array([1.0, 0, 0])
UNKNOWN = np.zeros(3)
ZERO = np.zeros(6)


def wrench(fx=0.0, fy=0.0, fz=0.0, mx=0.0, my=0.0, mz=0.0):
    return np.array([fx, fy, fz, mx, my, mz])


def hangs(mass, at):
    """Return the wrench of a load [kg] that hangs at (3,) [m] from the sensor."""
    force = mass * G * DOWN
    return np.concatenate([force, np.cross(at, force)])


# --- what is left out ---------------------------------------------------------------------------


def test_a_bias_that_is_told_later_is_left_out_by_what_it_adds_to_the_reading():
    # The offset that is taken off falls by 3 N, so that the wrench on the arm falls by 3 N, too.
    state = Believed(ZERO, wrench(fx=5.0), True, True, True)
    found = believed(state, wrench(fx=-3.0), wrench(fx=2.0), True, False, False, 0.1)
    np.testing.assert_allclose(found.left_out, wrench(fx=-3.0))
    again = believed(found, wrench(fx=-3.0), wrench(fx=2.0), True, False, False, 0.1)
    np.testing.assert_allclose(again.left_out, wrench(fx=-3.0), err_msg="once, not in every tick")


def test_a_bias_that_is_told_while_the_sensor_is_silent_counts_as_well():
    state = Believed(wrench(fy=1.0), wrench(fx=5.0), True, True, True)
    found = believed(state, None, wrench(fx=7.0), True, False, False, 0.1)
    np.testing.assert_allclose(found.left_out, wrench(fx=2.0, fy=1.0))


def test_what_was_read_by_a_sensor_that_was_silent_is_left_out_whole():
    state = Believed(ZERO, ZERO, False, True, True)
    found = believed(state, wrench(fz=-9.0), ZERO, True, False, False, 0.1)
    np.testing.assert_allclose(found.left_out, wrench(fz=-9.0))


def test_before_drives_were_on_what_is_no_weight_is_left_out_and_a_weight_is_not():
    read = wrench(fx=8.0)
    first = believed(NOTHING_LEFT_OUT, read, ZERO, False, True, True, 0.1)
    np.testing.assert_allclose(first.left_out, read)
    then = believed(first, read, ZERO, True, True, True, 0.1)
    np.testing.assert_allclose(then.left_out, 0.9 * read, err_msg="a part in each tick")


def test_before_the_first_tick_nothing_is_left_out_and_drives_have_not_been_on():
    first = Believed(ZERO)
    assert (first.offset, first.heard, first.driven, first.judged) == (None, True, False, False)
    found = believed(first, wrench(fx=8.0), ZERO, False, True, False, 0.1)
    np.testing.assert_array_equal(found.left_out, wrench(fx=8.0), err_msg="all of it, at once")
    np.testing.assert_array_equal(found.offset, ZERO)


def test_from_the_moment_that_drives_are_on_no_reading_is_taken_over_any_more():
    read, state = wrench(fx=8.0), Believed(wrench(fz=1.0), ZERO)
    for settled in (False, False, True, True):  # on, and off again
        state = believed(state, read, ZERO, False, settled, True, 0.5)
        np.testing.assert_array_equal(state.left_out, wrench(fz=1.0))
        assert state.judged
        assert state.driven is not settled
        assert state.heard


@pytest.mark.parametrize("settled", [True, False])
def test_a_silence_is_remembered_and_takes_nothing_over(settled):
    state = Believed(wrench(fz=1.0), ZERO)
    found = believed(state, None, ZERO, False, settled, True, 0.5)
    np.testing.assert_array_equal(found.left_out, wrench(fz=1.0))
    assert (found.heard, found.driven, found.judged) == (False, not settled, not settled)


def test_what_is_read_after_a_silence_while_drives_are_off_is_not_what_the_observer_found():
    state = Believed(wrench(fz=1.0), ZERO, False, False, True)
    found = believed(state, wrench(fx=8.0), ZERO, False, True, True, 0.5)
    np.testing.assert_array_equal(found.left_out, wrench(fz=1.0))
    # Before drives were ever on it is taken over whole, as at first.
    state = Believed(wrench(fz=1.0), ZERO, False, False, False)
    found = believed(state, wrench(fx=8.0), ZERO, False, True, True, 0.5)
    np.testing.assert_array_equal(found.left_out, wrench(fx=8.0))


def test_while_joints_move_in_their_brakes_nothing_is_taken_over():
    state = Believed(wrench(fz=1.0), ZERO)
    found = believed(state, wrench(fx=8.0), ZERO, False, True, False, 0.5)
    np.testing.assert_array_equal(found.left_out, wrench(fz=1.0))


def test_the_share_that_the_observer_found_is_taken_off_what_is_left_out():
    J = np.eye(6)[:, :3]
    state = Believed(wrench(fx=4.0, fy=2.0))
    quarter = without_what_is_there(state, J, 0.25 * np.array([4.0, 2.0, 0.0]))
    np.testing.assert_allclose(quarter.left_out, 0.75 * state.left_out)
    all_of_it = without_what_is_there(state, J, 3.0 * np.array([4.0, 2.0, 0.0]))
    np.testing.assert_allclose(all_of_it.left_out, ZERO)
    other_way = without_what_is_there(state, J, -np.array([4.0, 2.0, 0.0]))
    np.testing.assert_allclose(other_way.left_out, state.left_out)


def test_what_no_joint_feels_stays_left_out():
    state = Believed(wrench(mz=1.0))
    assert without_what_is_there(state, np.eye(6)[:, :3], np.ones(3)) is state


# --- what may be a weight -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("newtons", "may"),
    [
        ((10.0 - 2.0) * G + 0.99 * FORCE, True),
        ((10.0 - 2.0) * G + 1.01 * FORCE, False),
        (-2.0 * G - 0.99 * FORCE, True),
        (-2.0 * G - 1.01 * FORCE, False),
    ],
)
def test_a_weight_is_at_most_what_is_rated_more_and_what_is_carried_less(newtons, may):
    assert may_be_weight(wrench(fz=-newtons), DOWN, UNKNOWN, 2.0, 10.0) == may


def test_a_weight_pulls_down_as_far_as_the_sensor_may_be_mounted_wrong():
    down = 40.0
    aside = FORCE / (1.0 - math.sin(ANGLE)) + down * math.sin(ANGLE)
    assert may_be_weight(wrench(fx=0.9 * aside, fz=-down), DOWN, UNKNOWN, 0.0, 10.0)
    assert not may_be_weight(wrench(fx=1.3 * aside, fz=-down), DOWN, UNKNOWN, 0.0, 10.0)


def test_a_weight_turns_nothing_about_the_vertical():
    assert may_be_weight(wrench(fz=-30.0, mz=0.9 * MOMENT), DOWN, UNKNOWN, 0.0, 10.0)
    assert not may_be_weight(wrench(fz=-30.0, mz=1.3 * MOMENT), DOWN, UNKNOWN, 0.0, 10.0)


@pytest.mark.parametrize("carried", [0.0, 2.0])
def test_a_weight_has_no_longer_lever_than_a_tool(carried):
    most = MOMENT + LEVER * (30.0 + carried * G)
    assert may_be_weight(wrench(fz=-30.0, mx=0.99 * most), DOWN, UNKNOWN, carried, 10.0)
    assert not may_be_weight(wrench(fz=-30.0, mx=1.01 * most), DOWN, UNKNOWN, carried, 10.0)


def test_a_load_hangs_outboard_of_the_sensor_and_not_behind_it():
    assert may_be_weight(hangs(3.0, 0.1 * ALONG_X), DOWN, ALONG_X, 0.0, 10.0)
    assert not may_be_weight(hangs(3.0, -0.1 * ALONG_X), DOWN, ALONG_X, 0.0, 10.0)
    # Upright, a tool does not tell where on it a weight is.
    assert may_be_weight(hangs(3.0, -0.1 * UP), DOWN, UP, 0.0, 10.0)
    # A load that was told too heavy pulls up where it hangs, and still turns as one outboard.
    assert may_be_weight(-hangs(3.0, 0.1 * ALONG_X), DOWN, ALONG_X, 5.0, 10.0)
    assert not may_be_weight(-hangs(3.0, -0.1 * ALONG_X), DOWN, ALONG_X, 5.0, 10.0)


def attitudes(count=10):
    rng = np.random.default_rng(5)
    return [rotation_exp(r) for r in rng.uniform(-2.0, 2.0, (count, 3))]


@pytest.mark.parametrize("carried", [0.0, 2.0])
def test_a_weight_is_judged_alike_in_whatever_axes(carried):
    rng = np.random.default_rng(6)
    judged = []
    for R in attitudes(100):
        force = rng.uniform(0.0, 60.0) * DOWN + rng.normal(0.0, 3.0, 3)
        read = np.concatenate([force, rng.normal(0.0, 1.0, 3)])
        tool = rotation_exp(rng.normal(size=3)) @ ALONG_X
        may = may_be_weight(read, DOWN, tool, carried, 10.0)
        turned = np.concatenate([R @ read[:3], R @ read[3:]])
        assert may_be_weight(turned, R @ DOWN, R @ tool, carried, 10.0) == may
        judged.append(may)
    assert 10 < sum(judged) < 90


@pytest.mark.parametrize("down", [0.0, 20.0, 60.0])
def test_what_pulls_aside_is_the_sensors_error_and_its_mountings_and_no_more(down):
    """A pull a aside is just allowed where a = 5 N + sin 6° √(a² + down²)."""
    s2 = math.sin(math.radians(6.0)) ** 2
    aside = (5.0 + math.sqrt(25.0 - (1.0 - s2) * (25.0 - s2 * down**2))) / (1.0 - s2)
    for way in ([1.0, 0.0], [0.0, -1.0], [0.6, 0.8]):
        for part, may in ((1.0 - 1e-9, True), (1.0 + 1e-9, False)):
            x, y = part * aside * np.array(way)
            assert may_be_weight(wrench(x, y, -down), DOWN, UNKNOWN, 0.0, 10.0) == may


def test_what_turns_about_the_vertical_is_the_sensors_error_and_its_mountings_and_no_more():
    about = 0.5 / (1.0 - math.sin(math.radians(6.0)))
    for part, may in ((1.0 - 1e-9, True), (1.0 + 1e-9, False)):
        for sign in (-1.0, 1.0):
            read = wrench(fz=-30.0, mz=sign * part * about)
            assert may_be_weight(read, DOWN, UNKNOWN, 0.0, 10.0) == may


def test_each_bound_of_a_weight_may_be_reached():
    assert may_be_weight(wrench(fz=5.0), DOWN, UNKNOWN, 0.0, 10.0)
    assert may_be_weight(wrench(fz=-5.0), DOWN, UNKNOWN, 10.0, 10.0)
    assert may_be_weight(wrench(fz=-8.0, mx=4.5), DOWN, UNKNOWN, 0.0, 10.0)
    # What is no more than a sensor's error does not tell where it hangs.
    assert may_be_weight(wrench(fz=-5.0, my=-1.0), DOWN, ALONG_X, 0.0, 10.0)
    assert not may_be_weight(wrench(fz=-5.0 - 1e-9, my=-1.0), DOWN, ALONG_X, 0.0, 10.0)


@pytest.mark.parametrize("sine2", [0.11, 0.5, 1.0])
def test_on_a_tool_that_is_not_upright_a_load_is_a_centimetre_outboard_at_least(sine2):
    tilted = np.array([math.sqrt(sine2), 0.0, math.sqrt(1.0 - sine2)])
    for R in attitudes():
        for sign in (-1.0, 1.0):
            tool = R @ (sign * tilted)
            for at, may in ((-0.1, False), (0.0099, False), (0.0101, True), (0.1, True)):
                load = hangs(3.0, at * R.T @ tool)
                load = np.concatenate([R @ load[:3], R @ load[3:]])
                assert may_be_weight(load, R @ DOWN, tool, 0.0, 10.0) == may


def test_on_a_tool_that_is_nearly_upright_a_load_may_hang_anywhere():
    tool = np.array([math.sqrt(0.09), 0.0, math.sqrt(0.91)])
    assert may_be_weight(hangs(3.0, -0.1 * tool), DOWN, tool, 0.0, 10.0)
