"""Load shares are the least weighted squares that carry the payload (Williams 1997, section 3)."""

import numpy as np
import pytest
from telerobot.server.control.grasps.load_shares import grasp_maps, internal, load_shares, total

CASES = [(arms, equal, seed) for arms in (2, 3) for equal in (True, False) for seed in range(5)]


def least_squares(G, weights, wrench):
    """Solve the optimality conditions as one dense system: 2 W h + Gᵀλ = 0, Σ G h = w."""
    k = 6 * len(G)
    across = np.concatenate(list(G), axis=1)
    conditions = np.block([[np.diag(weights.ravel()), across.T], [across, np.zeros((6, 6))]])
    found = np.linalg.lstsq(conditions, np.concatenate([np.zeros(k), wrench]), rcond=None)[0]
    return found[:k].reshape(-1, 6)


@pytest.mark.parametrize(("arms", "equal", "seed"), CASES)
def test_shares_carry_the_payload_at_the_least_cost(arms, equal, seed):
    rng = np.random.default_rng(seed)
    p, wrench = rng.uniform(-1, 1, (arms, 3)), rng.uniform(-50, 50, 6)
    weights = np.ones((arms, 6)) if equal else rng.uniform(0.2, 5, (arms, 6))
    G = grasp_maps(p)
    shares = load_shares(G, weights, wrench)
    np.testing.assert_allclose(total(G, shares), wrench, atol=1e-5)
    np.testing.assert_allclose(shares, least_squares(G, weights, wrench), atol=1e-5)


def test_a_moment_at_the_mrf_is_the_lever_times_the_force_at_the_grasp():
    G = grasp_maps(np.array([[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]]))
    up = np.array([[0, 0, 10, 0, 0, 0], [0, 0, 30, 0, 0, 0.0]])
    # 30 N at +0.5 m and 10 N at -0.5 m along y: x moment of 10 N·m
    np.testing.assert_allclose(total(G, up), [0, 0, 40, 10, 0, 0])


@pytest.mark.parametrize("arms", [2, 3])
def test_internal_forces_move_nothing_and_are_all_that_shares_lack(arms):
    rng = np.random.default_rng(arms)
    G = grasp_maps(rng.uniform(-1, 1, (arms, 3)))
    exerted = rng.uniform(-20, 20, (arms, 6))
    found = internal(G, exerted)
    np.testing.assert_allclose(total(G, found), np.zeros(6), atol=1e-9)
    np.testing.assert_allclose(
        exerted - found, load_shares(G, np.ones((arms, 6)), total(G, exerted)), atol=1e-9
    )
    np.testing.assert_allclose(internal(G, exerted - found), 0, atol=1e-9)


def test_a_squeeze_is_internal_and_a_dear_arm_carries_less():
    G = grasp_maps(np.array([[0.0, -0.5, 0.0], [0.0, 0.5, 0.0]]))
    squeeze = np.array([[0, 40, 0, 0, 0, 0], [0, -40, 0, 0, 0, 0.0]])
    np.testing.assert_allclose(internal(G, squeeze), squeeze)
    along = np.array([0, 30.0, 0, 0, 0, 0])
    shares = load_shares(G, np.array([[2.0] * 6, [1.0] * 6]), along)
    np.testing.assert_allclose(shares[:, 1], [10.0, 20.0])
