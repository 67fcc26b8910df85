from itertools import pairwise

import numpy as np
import pytest
from telerobot.server.control.mechanism.resolution import resolve


def jacobian(arm, q):
    return arm.mechanism.kinematics(q, arm.settings.T_wrist_mrf).J


def solve(arm, q, twist):
    return resolve(jacobian(arm, q), twist, arm.p.resolve)


def weight(arm):
    return np.diag([1.0] * 3 + [arm.p.resolve.characteristic_length] * 3)


def regular_postures(arm, rng, count=40):
    """Random postures that are neither damped nor near enough to a boundary to be braked."""
    found = []
    while len(found) < count:
        q = arm.random_posture(rng)
        sigma = np.linalg.svd(weight(arm) @ jacobian(arm, q), compute_uv=False)[-1]
        if sigma > 2 * arm.p.resolve.singular_region:
            found.append(q)
    return found


def test_away_from_singularities_the_tool_does_exactly_what_is_asked(arm, rng):
    for q in regular_postures(arm, rng):
        twist = rng.normal(size=6)
        found = solve(arm, q, twist)
        np.testing.assert_allclose(jacobian(arm, q) @ found.dq, twist, atol=1e-9)
        assert not found.singular


def test_no_other_exact_solution_has_smaller_joint_rates(arm, rng):
    for q in regular_postures(arm, rng):
        twist = rng.normal(size=6)
        least = np.linalg.lstsq(jacobian(arm, q), twist, rcond=None)[0]
        np.testing.assert_allclose(solve(arm, q, twist).dq, least, atol=1e-9)


def test_self_motion_leaves_the_tool_alone_even_at_a_singularity(arm, rng):
    stretched = np.zeros(arm.p.n)
    for q in [*regular_postures(arm, rng, 10), arm.posture("ready"), stretched]:
        J, null = jacobian(arm, q), solve(arm, q, np.zeros(6)).null
        assert null.shape == (arm.p.n - 6, arm.p.n)
        np.testing.assert_allclose(J @ null.T, 0.0, atol=1e-9)
        np.testing.assert_allclose(null @ null.T, np.eye(arm.p.n - 6), atol=1e-12)


def test_the_least_singular_value_is_the_weighted_jacobians(arm, rng):
    for _ in range(10):
        q = arm.random_posture(rng)
        expected = np.sqrt(
            np.linalg.eigvalsh((lambda A: A @ A.T)(weight(arm) @ jacobian(arm, q)))[0]
        )
        assert solve(arm, q, np.zeros(6)).sigma_min == pytest.approx(expected, abs=1e-7)


def singular_postures(arm):
    """Postures at the stretched elbow, at the wrist's singularity, and close to them."""
    elbow, wrist = (3, 5) if arm.p.n == 7 else (2, 4)
    for angle in (0.0, 1e-9, 1e-4, 1e-2, 0.03, 0.1, 0.3):
        for joint in (elbow, wrist):
            q = arm.posture("ready").copy()
            q[joint] = angle
            if arm.p.n == 7 and joint == wrist:
                q[2] = 0.4
            yield q


def test_joint_rates_stay_below_the_bound_of_the_damping(arm, rng):
    p, W = arm.p.resolve, weight(arm)
    ratio = p.damping / p.singular_region
    bound = 1.0 / (2.0 * p.damping * np.sqrt(1.0 - ratio**2))
    worst = 0.0
    for q in [*singular_postures(arm), *(arm.random_posture(rng) for _ in range(50))]:
        U = np.linalg.svd(W @ jacobian(arm, q))[0]
        # Ask along each weak direction, where the bound is met, and along any.
        for direction in (*U.T, *-U.T, *rng.normal(size=(6, 6))):
            twist = np.linalg.solve(W, direction)
            rates = np.linalg.norm(solve(arm, q, twist).dq)
            worst = max(worst, rates / (bound * np.linalg.norm(direction)))
    assert 0.9 < worst <= 1.0 + 1e-9


def biggest_step(arm, way, twist, count):
    rates = [solve(arm, q, twist).dq for q in way(np.linspace(0.0, 1.0, count))]
    return max(np.linalg.norm(b - a) for a, b in pairwise(rates))


@pytest.mark.parametrize("seed", range(4))
def test_joint_rates_change_smoothly_across_the_edge_of_the_singular_region(arm, seed):
    """Where a jump were hidden, finer steps would not make it smaller."""
    rng = np.random.default_rng(seed)
    elbow = 3 if arm.p.n == 7 else 2
    twist = np.array([0.1, 0.1, 0.1, 0.3, 0.3, 0.3]) * rng.uniform(-1, 1, 6)

    def straightening(shares):
        for share in shares:
            q = arm.posture("ready").copy()
            q[elbow] = 1.2 + (0.15 - 1.2) * share
            yield q

    regular = solve(arm, next(straightening([0.0])), twist)
    nearly_straight = solve(arm, next(straightening([1.0])), twist)
    assert not regular.singular
    assert nearly_straight.singular
    coarse, fine = (biggest_step(arm, straightening, twist, n) for n in (301, 2401))
    assert fine <= 0.5 * coarse


def test_no_command_is_held_off_at_a_singularity_that_bounds_no_workspace(ur5e):
    """Just beside the wrist's singularity both ways along the weak direction are answered alike."""
    q = ur5e.posture("ready").copy()
    q[4] = 0.01
    W, J = weight(ur5e), jacobian(ur5e, q)
    U, s, _ = np.linalg.svd(W @ J)
    assert s[-1] < ur5e.p.resolve.floor
    twist = 0.05 * np.linalg.solve(W, U[:, -1])
    one, other = solve(ur5e, q, twist).dq, solve(ur5e, q, -twist).dq
    assert np.linalg.norm(one) > 0.1
    np.testing.assert_allclose(one, -other, rtol=0.02, atol=1e-3)


@pytest.mark.parametrize("seed", range(4))
def test_the_wrist_passes_its_singularity_without_a_jump(ur5e, seed):
    rng = np.random.default_rng(seed)
    twist = np.array([0.1, 0.1, 0.1, 0.3, 0.3, 0.3]) * rng.uniform(-1, 1, 6)

    def passing(shares):
        for share in shares:
            q = ur5e.posture("ready").copy()
            q[4] = 0.3 - 0.6 * share
            yield q

    coarse, fine = (biggest_step(ur5e, passing, twist, n) for n in (301, 2401))
    assert fine <= 0.5 * coarse


@pytest.mark.parametrize("bend", [1e-9, 1e-6, 1e-4, 1e-3])
def test_however_straight_the_arm_a_command_home_is_answered_in_full_and_one_outward_not(arm, bend):
    q = arm.posture("ready").copy()
    q[3 if arm.p.n == 7 else 2] = bend
    p, W = arm.p.resolve, weight(arm)
    U, s, Vt = np.linalg.svd(W @ jacobian(arm, q))
    assert s[5] < p.floor
    # Which way the boundary bends: where the weak direction's speed goes as joints move on.
    step = 1e-3 * Vt[5]
    bent = U[:, 5] @ (W @ (jacobian(arm, q + step) - jacobian(arm, q - step)) @ Vt[5])
    home = 0.05 * np.sign(bent) * np.linalg.solve(W, U[:, 5])
    full = 0.05 * p.damping / (p.damping**2 * (2 - (p.damping / p.singular_region) ** 2))
    assert np.linalg.norm(solve(arm, q, home).dq) >= 0.9 * full
    assert np.linalg.norm(solve(arm, q, -home).dq) <= 1e-9
