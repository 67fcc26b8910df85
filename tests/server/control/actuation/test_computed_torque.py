"""The law in the tool's space against matrices written out, and against finite differences."""

import numpy as np
import pytest
from telerobot.server.control.actuation.torque import acceleration, computed_torque, damped, drift
from telerobot.server.control.spatial import pose_error

T = 0.01
REGION, DAMPING = 0.02, 0.01
GAINS = {"damping": 17.0, "stiffness": 90.0, "null_damping": 11.0, "null_stiffness": 70.0}


def kinematics(arm, q):
    return arm.mechanism.kinematics(q, arm.settings.T_wrist_mrf)


def drift_by_differences(arm, q, dq):
    step = 1e-6
    ahead, behind = (kinematics(arm, q + s * step * dq).J @ dq for s in (1.0, -1.0))
    return (ahead - behind) / (2.0 * step)


def inertia(arm, q):
    return arm.mechanism.mass_matrix(q) + 0.4 * np.eye(arm.p.n)


def test_the_tools_drift_is_the_change_of_its_velocity_at_constant_rates(arm, rng) -> None:
    for _ in range(20):
        q, dq = arm.random_posture(rng), rng.normal(size=arm.p.n)
        expected = drift_by_differences(arm, q, dq)
        np.testing.assert_allclose(drift(kinematics(arm, q).J, dq), expected, atol=1e-6)


def mobilities(rng):
    """Yield symmetric matrices (6, 6), and their own values and axes: all sizes, equal ones, 0."""
    for values in (
        np.geomspace(1e-3, 2.0, 6),
        np.geomspace(1e-12, 2.0, 6),
        np.array([0.0, 0.0, 0.01, 0.01, 0.5, 0.5]),
        np.ones(6),
        np.zeros(6),
    ):
        for axes in (np.eye(6), np.linalg.qr(rng.normal(size=(6, 6)))[0]):
            yield axes * values @ axes.T, values, axes


def test_a_mobility_is_inverted_along_its_axes_and_damped_where_it_is_small(rng) -> None:
    for mobility, values, axes in mobilities(rng):
        wanted = rng.normal(size=6)
        short = np.maximum(0.0, 1.0 - values / REGION)
        share = values / (values**2 + (DAMPING * short) ** 2)
        expected = axes @ (share * (axes.T @ wanted))
        found = damped(0.5 * (mobility + mobility.T), wanted, REGION, DAMPING)
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)


def test_where_there_is_mobility_the_push_gives_what_is_wanted(rng) -> None:
    for _ in range(20):
        A = rng.normal(size=(6, 9))
        mobility, wanted = A @ A.T + 0.1 * np.eye(6), rng.normal(size=6)
        push = damped(mobility, wanted, REGION, DAMPING)
        np.testing.assert_allclose(mobility @ push, wanted, atol=1e-10)


def test_what_is_no_number_ends_and_stays_none(rng) -> None:
    assert np.isnan(damped(np.full((6, 6), np.nan), rng.normal(size=6), REGION, DAMPING)).all()
    assert np.isnan(damped(np.eye(6), np.full(6, np.nan), REGION, DAMPING)).all()


@pytest.fixture
def moving(arm, rng):
    """Return an arm's inertia (n, n), and what `acceleration` is told of its motion."""
    n, q_c = arm.p.n, arm.random_posture(rng)
    q, dq, dq_c = q_c + rng.normal(0.0, 0.01, n), *rng.normal(0.0, 0.1, (2, n))
    M, c, here = inertia(arm, q), kinematics(arm, q_c), kinematics(arm, q)
    error = pose_error(c.T_world_mrf, here.T_world_mrf)
    dq_ahead = dq_c + rng.normal(0.0, 0.01, n)
    weight = np.array([1.0, 1.0, 1.0, 0.3, 0.3, 0.3])
    return M, (np.linalg.inv(M), c.J, here.J, error, q_c, dq_c, dq_ahead, q, dq, weight)


def test_the_law_is_that_of_the_page_away_from_singularities(arm, moving):
    """q̈* = q̈_0 + J̄ (ẍ* − J q̈_0), with J̄ = M⁻¹ Jᵀ (J M⁻¹ Jᵀ)⁻¹, written out."""
    M, others = moving
    inverse, J_c, J, error, q_c, dq_c, dq_ahead, q, dq, _ = others
    found = acceleration(*others, T, *GAINS.values(), 1e-9, DAMPING)
    ahead = (dq_ahead - dq_c) / T
    own = ahead + 11.0 * (dq_c - dq) + 70.0 * (q_c - q)
    tool = J_c @ ahead + drift_by_differences(arm, q_c, dq_c) - drift_by_differences(arm, q, dq)
    tool = tool + 17.0 * (J_c @ dq_c - J @ dq) + 90.0 * error
    J_bar = np.linalg.solve(J @ np.linalg.solve(M, J.T), J @ inverse).T
    np.testing.assert_allclose(found, own + J_bar @ (tool - J @ own), rtol=1e-6, atol=1e-7)


def test_without_any_mobility_the_joints_go_their_own_way(moving):
    _, (inverse, J_c, J, error, q_c, dq_c, dq_ahead, q, dq, weight) = moving
    stuck = (inverse, J_c, np.zeros_like(J), error, q_c, dq_c, dq_ahead, q, dq, weight)
    own = (dq_ahead - dq_c) / T + 11.0 * (dq_c - dq) + 70.0 * (q_c - q)
    found = acceleration(*stuck, T, *GAINS.values(), REGION, DAMPING)
    np.testing.assert_allclose(found, own, rtol=1e-12)


def test_the_torque_is_that_of_the_acceleration_and_what_is_given_beside(moving, rng):
    M, others = moving
    h, beside = rng.normal(0.0, 10.0, (2, len(M)))
    gains = (T, *GAINS.values(), REGION, DAMPING)
    expected = M @ acceleration(*others, *gains) + h + beside
    np.testing.assert_allclose(computed_torque(M, h, beside, *others, *gains), expected, rtol=1e-9)
