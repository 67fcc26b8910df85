"""The oracle's arms of a cell against the physics' geometry."""

import math

import numpy as np
import pytest
from laboratory.oracle.arm import OracleArm
from laboratory.oracle.several import Arms
from telerobot.config.load import load_cell
from telerobot.drivers.rig.physics.world import World


@pytest.fixture
def pair(two_arms):
    turned = "xyz = [0.1, -0.40, 0.0], rpy = [0.0, 0.0, 0.5]"
    return load_cell(two_arms(bases=(0.45, turned)))


def test_arms_are_as_far_apart_as_the_physics_has_them(pair):
    arms, world, rng = Arms.of(pair), World(pair), np.random.default_rng(5)
    low, high = np.maximum(arms.lower, -2.5), np.minimum(arms.upper, 2.5)
    near = 0
    for _ in range(200):
        q = rng.uniform(low, high)
        world.q[:] = q
        true = world.distances.between_arms()
        found = arms.between(q)
        assert found.arms == ("left", "right")
        if 0.0 < true < 0.9:
            near += 1
            # Rows of balls leave out the rims of cylinders, and stick out of their flat ends.
            assert found.distance == pytest.approx(true, abs=0.02)
    assert near > 50


def test_bounds_are_those_of_all_joints_in_order(pair):
    arms, left, right = Arms.of(pair), *(Arms.of(part) for part in pair.parts)
    assert arms.names == ("left", "right")
    assert [(s.start, s.stop) for s in arms.slices] == [(0, 7), (7, 13)]
    for name in ("lower", "upper", "velocity", "acceleration", "jerk"):
        both = np.concatenate([getattr(left, name), getattr(right, name)])
        np.testing.assert_array_equal(getattr(arms, name), both)


def test_a_single_arm_is_near_no_other():
    cell = load_cell("pa10")
    arms, arm = Arms.of(cell), OracleArm.of(cell)
    q = np.random.default_rng(6).uniform(-0.5, 0.5, 7)
    assert arms.between(q).distance == math.inf
    assert arms.clearance(q) == arm.clearance(q)
