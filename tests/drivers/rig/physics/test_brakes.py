"""Brakes that take their time, slip, and hold; by the physics."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.drivers.rig.physics.world import World

S1 = 0
TORQUE, CLOSES_S = 60.0, 0.02
SPEED = 0.5


@pytest.fixture
def world_with():
    """Return a PA-10 of which s1 turns, and all other joints are held; its brakes may be told."""

    def make(**brakes):
        world = World(altered(load_cell("pa10"), brakes, "rig.drive"))
        world.set_brake(S1, closed=False)
        world.dq[S1] = SPEED
        return world

    return make


def speeds(world, steps=300):
    """Return the speed of s1 after each step without torque, its brake told to close before."""
    world.set_brake(S1, closed=True)
    found = []
    for _ in range(steps):
        world.step(np.zeros(world.n))
        found.append(float(world.dq[S1]))
    return np.array(found)


def test_a_brake_that_takes_its_time_stops_nothing_before(world_with):
    friction = 4.0  # slows it by itself, on the whole arm's inertia
    speed = speeds(world_with(brake_closes_s=CLOSES_S, brake_torque=(TORQUE,)))
    assert speed[18] > 0.9 * SPEED
    slowing = -np.diff(speed[22:26]) / 1e-3
    before = -np.diff(speed[10:14]) / 1e-3
    np.testing.assert_allclose(slowing / before, (TORQUE + friction) / friction, rtol=0.1)


def test_a_brake_slips_until_the_joint_stands_and_then_holds_it(world_with):
    world = world_with(brake_closes_s=CLOSES_S, brake_torque=(TORQUE,))
    speed = speeds(world)
    assert 0.01 < np.argmax(speed < 1e-3) * 1e-3 - CLOSES_S < 0.2
    held = float(world.q[S1])
    for _ in range(200):
        world.step(np.full(world.n, 0.9 * TORQUE) * (np.arange(world.n) == S1))
    assert world.q[S1] == pytest.approx(held, abs=1e-4)


def test_a_brake_without_a_torque_locks_at_once_when_it_has_closed(world_with):
    speed = speeds(world_with(brake_closes_s=CLOSES_S))
    assert speed[18] > 0.9 * SPEED
    assert abs(speed[25]) < 0.02
    assert abs(speeds(world_with())[5]) < 0.02


def test_a_brake_that_is_opened_again_lets_the_joint_go(world_with):
    world = world_with(brake_closes_s=CLOSES_S, brake_torque=(TORQUE,))
    speeds(world, steps=25)
    world.set_brake(S1, closed=False)
    before = float(world.dq[S1])
    for _ in range(10):
        world.step(np.zeros(world.n))
    assert world.dq[S1] > 0.9 * before > 0.0


def test_torques_for_some_joints_only_are_refused(world_with):
    with pytest.raises(ValueError, match="brake_torque: 2 values for 7 joints; give 1 or 7"):
        world_with(brake_torque=(1.0, 2.0))
