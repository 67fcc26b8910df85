import numpy as np
import pytest
from telerobot.server.control.objectives.manipulability import slope

STEP = 1e-6


def jacobian(arm, q):
    return arm.mechanism.kinematics(q, arm.settings.T_wrist_mrf).J


def manipulability(J):
    return np.sqrt(max(0.0, np.linalg.det(J @ J.T)))


def test_the_rate_is_the_slope_of_the_manipulability(arm, rng):
    for _ in range(10):
        q = arm.random_posture(rng)
        J = jacobian(arm, q)
        w, found = slope(J)
        assert w == pytest.approx(manipulability(J), rel=1e-9, abs=1e-10)
        for k in range(arm.p.n):
            aside = STEP * np.eye(arm.p.n)[k]
            ahead, behind = (manipulability(jacobian(arm, q + a)) for a in (aside, -aside))
            assert found[k] == pytest.approx((ahead - behind) / (2 * STEP), abs=1e-6)


def test_at_a_singularity_the_slope_is_finite(pa10):
    J = jacobian(pa10, np.zeros(7))
    w, found = slope(J)
    assert w == pytest.approx(0.0, abs=1e-6)
    assert np.abs(found).max() < 1.0


def test_two_sliding_and_one_turning_joint_have_the_slope_of_their_closed_form():
    # A gantry x, y, z with a wrist of three crossing axes, roll pitch roll: w = |sin(pitch)|.
    pitch, R = 0.7, np.eye(3)
    z, y = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    tip = np.array([np.sin(pitch), 0.0, np.cos(pitch)])
    J = np.zeros((6, 6))
    J[:3, :3], J[3:, 3:] = R, np.column_stack([z, y, tip])
    w, found = slope(J)
    assert w == pytest.approx(np.sin(pitch))
    expected = [0.0, 0.0, 0.0, 0.0, np.cos(pitch), 0.0]
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_the_slope_holds_for_a_tool_anywhere(pa10, rng, random_pose):
    tool, q = random_pose(0.3), pa10.random_posture(rng)

    def w(aside):
        return manipulability(pa10.mechanism.kinematics(q + aside, tool).J)

    found = slope(pa10.mechanism.kinematics(q, tool).J)[1]
    slopes = [(w(a) - w(-a)) / (2 * STEP) for a in STEP * np.eye(7)]
    np.testing.assert_allclose(found, slopes, atol=1e-6)
