"""Several arms in one world: each is the arm that it would be alone, and they can touch."""

import numpy as np
import pytest
from telerobot.config.load import load_cell
from telerobot.drivers.rig.physics.world import World

LEFT, RIGHT = slice(0, 7), slice(7, 14)


@pytest.fixture
def pair(two_arms):
    turned = "xyz = [0.1, -0.70, 0.0], rpy = [0.0, 0.0, 0.5]"
    return load_cell(two_arms(like=("pa10", "pa10"), bases=(0.55, turned)))


def fall(world, seconds):
    """Open all brakes and let the arms fall."""
    for joint in range(world.n):
        world.set_brake(joint, closed=False)
    for _ in range(round(seconds / world.dt)):
        world.step(np.zeros(world.n))


def test_each_arm_moves_as_it_does_alone(pair):
    both, alone = World(pair), [World(part) for part in pair.parts]
    for world in (both, *alone):
        fall(world, 0.1)
    for arm, (part, single) in enumerate(zip((LEFT, RIGHT), alone, strict=True)):
        np.testing.assert_allclose(both.q[part], single.q, atol=1e-9)
        np.testing.assert_allclose(both.sensor_wrench(arm), single.sensor_wrench(), atol=1e-6)
        np.testing.assert_allclose(both.mrf_pose(arm)[0], single.mrf_pose()[0], atol=1e-9)
    assert np.abs(both.q[LEFT] - pair.parts[0].config.mechanism.postures["start"]).max() > 1e-3


def test_what_is_done_to_one_arm_leaves_the_other_alone(pair):
    world = World(pair)
    before = world.sensor_wrench(0)
    world.push_tool(np.array([0.0, 0.0, 50.0]), arm=1)
    world.step(np.zeros(world.n))
    pushed, left = world.sensor_wrench(1), world.sensor_wrench(0)
    assert np.linalg.norm(pushed[:3] - left[:3]) > 30.0
    np.testing.assert_allclose(left, before, atol=0.5)


def test_the_distance_between_arms_is_told_and_arms_collide(pair):
    world = World(pair)
    assert world.distances.between_arms() > 0.3
    assert World(load_cell("pa10")).distances.between_arms() is None
    # Turned at the shoulder they reach out for each other.
    world.q[0], world.q[7] = -1.57, 1.07
    world.q[1] = world.q[8] = 1.2
    world.q[3] = world.q[10] = 0.5
    assert world.distances.between_arms() < 0.0
    world.step(np.zeros(world.n))
    assert world.contacts.own() > 10.0


def test_links_of_two_arms_that_the_cell_lets_overlap_neither_touch_nor_count(two_arms):
    """Shoulders that one torso carries are built into each other."""
    links = load_cell("pa10").robot.links()[:8]
    pairs = "".join(
        f'[[avoidance.allowed_contacts]]\nlink = "left.{a}"\nother = "right.{b}"\n'
        for a in links
        for b in links
    )
    near = ("xyz = [0.0, 0.05, 0.0]", "xyz = [0.0, -0.05, 0.0]")
    apart, overlapping = (
        World(load_cell(two_arms(like=("pa10", "pa10"), bases=near, more=more)))
        for more in (pairs, "")
    )
    for world in (apart, overlapping):
        world.step(np.zeros(world.n))
    assert overlapping.distances.between_arms() < 0.0
    assert overlapping.contacts.own() > 10.0
    assert apart.contacts.own() == 0.0
    assert apart.distances.between_arms() > 0.0
