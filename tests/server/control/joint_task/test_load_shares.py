"""Load shares are the least weighted squares that carry the payload (Williams 1997, section 3)."""

import numpy as np
import pytest
from laboratory.papers.williams import grasp_maps, least_squares
from telerobot.server.control.joint_task.load_shares import (
    greatest,
    internal,
    load_shares,
    total,
)

CASES = [(arms, equal, seed) for arms in (2, 3) for equal in (True, False) for seed in range(5)]


@pytest.mark.parametrize(("arms", "equal", "seed"), CASES)
def test_shares_carry_the_payload_at_the_least_cost(arms, equal, seed):
    rng = np.random.default_rng(seed)
    p, wrench = rng.uniform(-1, 1, (arms, 3)), rng.uniform(-50, 50, 6)
    weights = np.ones((arms, 6)) if equal else rng.uniform(0.2, 5, (arms, 6))
    shares = load_shares(p, weights, wrench)
    np.testing.assert_allclose(total(p, shares), wrench, atol=1e-9)
    np.testing.assert_allclose(shares, least_squares(grasp_maps(p), weights, wrench), atol=1e-5)


def test_a_moment_at_the_mrf_is_the_lever_times_the_force_at_the_grasp():
    p = np.array([[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]])
    up = np.array([[0, 0, 10, 0, 0, 0], [0, 0, 30, 0, 0, 0.0]])
    # 30 N at +0.5 m and 10 N at -0.5 m along y: x moment of 10 N·m
    np.testing.assert_allclose(total(p, up), [0, 0, 40, 10, 0, 0])


@pytest.mark.parametrize("arms", [2, 3])
def test_internal_forces_move_nothing_and_are_all_that_shares_lack(arms):
    rng = np.random.default_rng(arms)
    p = rng.uniform(-1, 1, (arms, 3))
    exerted = rng.uniform(-20, 20, (arms, 6))
    found = internal(p, exerted)
    np.testing.assert_allclose(total(p, found), np.zeros(6), atol=1e-9)
    np.testing.assert_allclose(
        exerted - found, load_shares(p, np.ones((arms, 6)), total(p, exerted)), atol=1e-9
    )
    np.testing.assert_allclose(internal(p, exerted - found), 0, atol=1e-9)


def test_a_squeeze_is_internal_and_a_dear_arm_carries_less():
    p = np.array([[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]])
    squeeze = np.array([[0, 40, 0, 0, 0, 0], [0, -40, 0, 0, 0, 0.0]])
    np.testing.assert_allclose(internal(p, squeeze), squeeze, atol=1e-12)
    assert greatest(squeeze[:, :3]) == pytest.approx(40.0)
    along = np.array([0, 30.0, 0, 0, 0, 0])
    shares = load_shares(p, np.array([[2.0] * 6, [1.0] * 6]), along)
    np.testing.assert_allclose(shares[:, 1], [10.0, 20.0])


def test_the_greatest_of_some_vectors_is_the_longest_one_whatever_its_place_and_way():
    vectors = np.array([[1.0, 2.0, 2.0], [0.0, -3.0, -4.0], [3.9, 0.0, 0.0]])
    for turned in range(3):
        for order in ([0, 1, 2], [1, 2, 0], [2, 0, 1]):
            assert greatest(np.roll(vectors, turned, axis=1)[order]) == pytest.approx(5.0)
    assert greatest(np.zeros((2, 3))) == 0.0
