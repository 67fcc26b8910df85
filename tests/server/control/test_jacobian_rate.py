import numpy as np
from telerobot.server.control.jacobian_rate import bent


def jacobian(arm, q):
    return arm.mechanism.kinematics(q, arm.settings.T_wrist_mrf).J


def test_the_change_of_the_jacobian_agrees_with_finite_differences(arm, rng):
    for _ in range(20):
        q, dq = arm.random_posture(rng), rng.normal(size=arm.p.n)
        step = 1e-6 * dq
        difference = (jacobian(arm, q + step) - jacobian(arm, q - step)) / 2e-6
        np.testing.assert_allclose(bent(jacobian(arm, q), dq), difference, atol=1e-8)
