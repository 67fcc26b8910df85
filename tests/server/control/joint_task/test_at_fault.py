"""The speed of a payload that a fault's force bounds: the model by itself."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.drivers import device as servo_status
from telerobot.server.control.arm import Arm
from telerobot.server.control.joint_task.forces import AWAITED, pads
from telerobot.server.control.joint_task.joint_task import JointTask
from telerobot.server.control.spatial import skew
from telerobot.tools.checks.loops import _moving

K, TURNING = 50_000.0, 1000.0


@pytest.fixture(scope="module")
def pair():
    """Return how arms move the payload of the pair by a twist at start, and their bound."""
    cell = load_cell("pa10_pair")
    section = cell.joint_tasks[0]
    task = JointTask(cell, section, [Arm.of(part) for part in cell.parts])
    start = [np.array(part.config.mechanism.postures["start"]) for part in cell.parts]
    return task, lambda twist: _moving(section, task, start, np.array(twist, dtype=float))


def test_a_silent_drive_is_waited_for_as_long_as_the_driver_waits():
    assert AWAITED == servo_status.MOST_MISSED_SYNCS + 1


def test_pads_of_two_grasps_are_stiff_in_series_along_the_payload():
    held = pads(np.array([[0.0, 0.5, 0.0], [0.0, -0.5, 0.0]]), K, TURNING)
    along = held @ np.array([0, 1e-3, 0, 0, 0, 0] + [0.0] * 6)
    assert along[[1, 7]] == pytest.approx([0.5 * K * 1e-3, -0.5 * K * 1e-3])
    # Across, it turns about its middle: two springs at half a metre, beside those that turn.
    across = held @ np.array([1e-3, 0, 0, 0, 0, 0] + [0.0] * 6)
    turns = 1e-3 * K * 0.5 / (2 * (K * 0.25 + TURNING))
    assert across[0] == pytest.approx(K * (0.5e-3 - 0.5 * turns))
    assert across[0] == pytest.approx(-across[6])


def test_what_moves_all_grasps_alike_presses_nothing():
    p = np.array([[0.3, 0.5, 0.1], [0.0, -0.5, 0.0], [-0.4, 0.1, 0.2]])
    held, twist = pads(p, K, TURNING), np.array([0.1, -0.2, 0.3, 0.4, -0.5, 0.6])
    moved = np.concatenate([[*(twist[:3] - skew(at) @ twist[3:]), *twist[3:]] for at in p])
    assert np.abs(held @ moved).max() < 1e-9 * K
    assert np.allclose(held, held.T)
    wrenches = (held @ np.random.default_rng(1).normal(size=18)).reshape(3, 6)
    moments = wrenches[:, 3:] + np.cross(p, wrenches[:, :3])
    assert np.abs(wrenches[:, :3].sum(axis=0)).max() < 1e-6
    assert np.abs(moments.sum(axis=0)).max() < 1e-6


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_speed_that_is_left_is_the_same_however_much_faster_is_asked(pair, axis):
    task, moving = pair
    left = []
    for speed in (0.3, 0.6):
        twist = np.zeros(6)
        twist[axis] = -speed
        arms, R = moving(twist)
        left.append(speed * task.at_fault.slowed(arms, R).share)
    assert left[1] == pytest.approx(left[0], rel=0.05)


def test_slow_motions_are_left_alone_and_fast_ones_named_by_the_joint(pair):
    task, moving = pair
    arms, R = moving([0.0, 0.04, 0.0, 0.0, 0.0, 0.0])
    assert task.at_fault.slowed(arms, R) == (1.0, "")
    arms, R = moving([0.0] * 6)
    assert task.at_fault.slowed(arms, R) == (1.0, "")
    arms, R = moving([0.0, 0.25, 0.0, 0.0, 0.0, 0.0])
    slowed = task.at_fault.slowed(arms, R)
    assert 0.3 < slowed.share < 0.6
    assert slowed.by == "left.s1"
