import numpy as np
from telerobot.server.control.mechanism.resolution import bend


def jacobian(arm, q):
    return arm.mechanism.kinematics(q, arm.settings.T_wrist_mrf).J


def test_the_bend_of_a_way_agrees_with_second_differences(arm, rng):
    """Along joint rates a, the tool's velocity J b changes by (∂J/∂q · a) b."""
    weight = np.array([1.0, 1.0, 1.0, 0.3, 0.3, 0.3])
    for _ in range(20):
        q, a, b = arm.random_posture(rng), *rng.normal(size=(2, arm.p.n))
        step = 1e-6 * a
        difference = (jacobian(arm, q + step) - jacobian(arm, q - step)) @ b / 2e-6
        np.testing.assert_allclose(
            bend(jacobian(arm, q), a, b, 0.3), weight * difference, atol=1e-8
        )
