"""Motions of one rigid body at another of its points, against a body that is placed in time."""

import numpy as np
import pytest
from telerobot.server.control.spatial import Motion, motion_at, rotation_exp, slowed_at

LEVER = np.array([0.3, -0.2, 0.5])
FAR, FREE = (1e3, 1e3), np.full(6, 1e3)


def turning(w, alpha):
    return Motion(np.zeros(6), np.array([0, 0, 0, *w], dtype=float), np.array([0, 0, 0, *alpha]))


def test_a_point_of_a_body_that_turns_is_drawn_to_its_axis():
    found = motion_at(turning([0.0, 0.0, 2.0], [0.0, 0.0, 0.0]), np.array([0.5, 0, 0]), FAR, FREE)
    np.testing.assert_allclose(found.dq[:3], [0.0, 1.0, 0.0])
    np.testing.assert_allclose(found.ddq[:3], [-2.0, 0.0, 0.0])


@pytest.mark.parametrize("seed", range(4))
def test_speed_and_acceleration_of_a_point_are_those_of_its_way(seed):
    rng, h = np.random.default_rng(seed), 1e-4
    w, alpha = rng.normal(size=(2, 3))

    def place(t):
        """Where the lever is after t, with a rotation whose rate begins at w and changes by α."""
        return rotation_exp(alpha * t**2 / 2) @ rotation_exp(w * t) @ LEVER

    found = motion_at(turning(w, alpha), LEVER, FAR, FREE)
    before, now, after = (place(t) for t in (-h, 0.0, h))
    np.testing.assert_allclose(found.dq[:3], (after - before) / (2 * h), atol=1e-5)
    np.testing.assert_allclose(found.ddq[:3], (after - 2 * now + before) / h**2, atol=1e-5)


def test_a_far_points_acceleration_is_bounded_as_a_whole():
    motion = turning([0.0, 0.0, 2.0], [0.0, 0.0, 1.0])
    lever, bound = np.array([0.5, 0, 0]), np.array([0.5, 0.5, 0.5, 9.0, 9.0, 9.0])
    free = motion_at(motion, lever, FAR, FREE)
    found = motion_at(motion, lever, FAR, bound)
    np.testing.assert_allclose(found.ddq, free.ddq * 0.5 / 2.0)
    np.testing.assert_allclose(found.dq, free.dq)


def test_an_acceleration_that_was_beyond_its_bound_before_stays_as_it_is():
    motion = Motion(np.zeros(6), np.zeros(6), np.array([3.0, 0, 0, 0, 0, 0]))
    found = motion_at(motion, np.zeros(3), FAR, np.ones(6))
    np.testing.assert_array_equal(found.ddq, motion.ddq)


def test_a_far_point_is_slowed_to_the_bounds_and_no_further_than_it_was_beyond_them_before():
    most = (0.2, 1.0)
    quick = slowed_at(np.array([0, 0, 0, 0, 0, 0.8]), np.array([0.5, 0, 0]), most)
    np.testing.assert_allclose(quick, np.array([0, 0.4, 0, 0, 0, 0.8]) * 0.5)
    # Its speed was 0.3 m/s where it was told, and its turning 2 rad/s: that much is left to it.
    fast = np.array([0.3, 0, 0, 0, 0, 2.0])
    np.testing.assert_allclose(slowed_at(fast, np.zeros(3), most), fast)
    there = slowed_at(fast, np.array([0.0, -0.15, 0]), most)
    np.testing.assert_allclose(there, np.array([0.6, 0, 0, 0, 0, 2.0]) * 0.5)
