import numpy as np
import pytest
from telerobot.server.control.jacobian_rate import bent, curvatures


def jacobian(arm, q):
    return arm.mechanism.kinematics(q, arm.settings.T_wrist_mrf).J


def test_the_change_of_the_jacobian_agrees_with_finite_differences(arm, rng):
    for _ in range(20):
        q, dq = arm.random_posture(rng), rng.normal(size=arm.p.n)
        step = 1e-6 * dq
        difference = (jacobian(arm, q + step) - jacobian(arm, q - step)) / 2e-6
        np.testing.assert_allclose(bent(jacobian(arm, q), dq), difference, atol=1e-8)


def test_curvatures_are_those_of_second_differences_of_the_way(arm, rng):
    """Along joint rates v, the tool's velocity J v changes by uᵀ (∂J/∂q · v) v."""
    for _ in range(20):
        q, u, basis = arm.random_posture(rng), rng.normal(size=6), rng.normal(size=(2, arm.p.n))
        found = curvatures(jacobian(arm, q), basis, u)
        np.testing.assert_array_equal(found, found.T)
        for mix in rng.normal(size=(3, 2)):
            v = mix @ basis
            step = 1e-6 * v
            difference = (jacobian(arm, q + step) - jacobian(arm, q - step)) @ v / 2e-6
            assert mix @ found @ mix == pytest.approx(u @ difference, abs=1e-6)
