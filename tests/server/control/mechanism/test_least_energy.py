import numpy as np
from telerobot.server.control.mechanism.objectives import saving


def weighted_solution(J, M, twist):
    """The rates of least kinetic energy that do the task: M⁻¹Jᵀ(J M⁻¹ Jᵀ)⁻¹ ẋ."""
    Mi = np.linalg.inv(M)
    return Mi @ J.T @ np.linalg.solve(J @ Mi @ J.T, twist)


def test_the_rates_become_those_of_the_inertia_weighted_inverse(pa10, rng):
    for _ in range(20):
        q = pa10.random_posture(rng)
        J = pa10.mechanism.kinematics(q, pa10.settings.T_wrist_mrf).J
        if np.linalg.svd(J, compute_uv=False)[-1] < 0.02:
            continue
        M, twist = pa10.mechanism.mass_matrix(q), rng.normal(size=6)
        plain = np.linalg.pinv(J) @ twist
        null = np.linalg.svd(J)[2][6:]
        dq = plain + saving(plain, null, M)
        expected = weighted_solution(J, M, twist)
        np.testing.assert_allclose(dq, expected, atol=1e-6 * np.abs(expected).max())
        np.testing.assert_allclose(J @ dq, twist, atol=1e-9)
        assert dq @ M @ dq <= plain @ M @ plain + 1e-12


def test_with_several_spare_motions_all_that_can_be_is_saved(rng):
    for _ in range(20):
        J, twist = rng.normal(size=(6, 9)), rng.normal(size=6)
        A = rng.normal(size=(9, 9))
        M = A @ A.T + 0.1 * np.eye(9)
        plain, null = np.linalg.pinv(J) @ twist, np.linalg.svd(J)[2][6:]
        dq = plain + saving(plain, null, M)
        np.testing.assert_allclose(dq, weighted_solution(J, M, twist), rtol=1e-5, atol=1e-6)


def test_the_mass_matrix_is_that_of_its_kinetic_energy(pa10, rng):
    M = pa10.mechanism.mass_matrix(pa10.random_posture(rng))
    np.testing.assert_allclose(M, M.T, atol=1e-12)
    assert (np.linalg.eigvalsh(M) > 0).all()


def test_a_chain_without_inertia_asks_for_nothing():
    null = np.array([[1.0, 0.0, 0.0]])
    assert not saving(np.ones(3), null, np.zeros((3, 3))).any()
