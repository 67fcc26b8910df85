"""Joints that mean something only together stop together, along a straight line."""

import numpy as np
import pytest
from telerobot.server.control.stop.motion import Motion
from telerobot.server.control.stop.trajectory import VelocityPlanner

N = 4


@pytest.fixture
def planner():
    """Four joints; the first three stop in proportion, the second is by far the slowest."""
    return VelocityPlanner(np.array([8.0, 2.0, 8.0, 8.0]), np.full(N, 100.0), groups=((0, 1, 2),))


def test_a_group_stops_in_proportion_and_as_quickly_as_its_slowest_joint_can(planner):
    start = Motion(np.zeros(N), np.array([0.5, -0.4, 0.2, 0.5]), np.zeros(N))
    stop = planner.stop(start)
    for t in np.linspace(0.0, stop.to_go_s, 50):
        left = stop.at(t).dq / start.dq
        np.testing.assert_allclose(left[:3], left[1], atol=1e-9)
    # The jerk of the first joint decides with the acceleration of the second: a little later than
    # the second alone.
    alone = VelocityPlanner(np.array([2.0]), np.array([100.0])).stop(
        Motion(np.zeros(1), start.dq[1:2], np.zeros(1))
    )
    assert alone.to_go_s <= stop.to_go_s < 1.15 * alone.to_go_s
    # The fourth belongs to nobody, and is at rest long before.
    late = stop.at(0.8 * stop.to_go_s).dq
    assert abs(late[3]) < 1e-12 < abs(late[0])


def test_where_joints_of_a_group_already_change_apart_they_stop_inside_their_bounds(planner):
    rng = np.random.default_rng(3)
    A, J = np.array([8.0, 2.0, 8.0, 8.0]), np.full(N, 100.0)
    for _ in range(200):
        start = Motion(np.zeros(N), rng.uniform(-1, 1, N), rng.uniform(-A, A))
        stop = planner.stop(start)
        times = np.linspace(0.0, stop.to_go_s, 200)
        ddq = np.array([stop.at(t).ddq for t in times])
        assert (np.abs(ddq) <= A * (1 + 1e-8)).all()
        assert (np.abs(np.diff(ddq, axis=0)) <= J * np.diff(times)[:, None] + 1e-7).all()
        assert stop.at(stop.to_go_s).stands(1e-9)


def test_a_joint_belongs_to_one_group_at_most():
    ones = np.ones(3)
    with pytest.raises(ValueError, match="in two"):
        VelocityPlanner(ones, ones, groups=((0, 1), (1, 2)))
    with pytest.raises(ValueError, match="there are 3"):
        VelocityPlanner(ones, ones, groups=((0, 3),))
