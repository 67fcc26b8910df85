import numpy as np
import pytest
from telerobot.server.control.mechanism.potentials import (
    Potential,
    Strengths,
    ahead,
    manipulability_slope,
    shape,
)
from telerobot.server.control.spatial import Pose

from ..chains import CHAINS

STEP = 1e-6


def jacobian(arm, q):
    return arm.mechanism.kinematics(q, arm.settings.T_wrist_mrf).J


def manipulability(J):
    return np.sqrt(max(0.0, np.linalg.det(J @ J.T)))


def test_the_rate_is_the_slope_of_the_manipulability(arm, rng):
    for _ in range(10):
        q = arm.random_posture(rng)
        J = jacobian(arm, q)
        w, found = manipulability_slope(J)
        assert w == pytest.approx(manipulability(J), rel=1e-9, abs=1e-10)
        for k in range(arm.p.n):
            aside = STEP * np.eye(arm.p.n)[k]
            ahead, behind = (manipulability(jacobian(arm, q + a)) for a in (aside, -aside))
            assert found[k] == pytest.approx((ahead - behind) / (2 * STEP), abs=1e-6)


def test_at_a_singularity_the_slope_is_finite(pa10):
    J = jacobian(pa10, np.zeros(7))
    w, found = manipulability_slope(J)
    assert w == pytest.approx(0.0, abs=1e-6)
    assert np.abs(found).max() < 1.0


def test_two_sliding_and_one_turning_joint_have_the_slope_of_their_closed_form():
    # A gantry x, y, z with a wrist of three crossing axes, roll pitch roll: w = |sin(pitch)|.
    pitch, R = 0.7, np.eye(3)
    z, y = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
    tip = np.array([np.sin(pitch), 0.0, np.cos(pitch)])
    J = np.zeros((6, 6))
    J[:3, :3], J[3:, 3:] = R, np.column_stack([z, y, tip])
    w, found = manipulability_slope(J)
    assert w == pytest.approx(np.sin(pitch))
    expected = [0.0, 0.0, 0.0, 0.0, np.cos(pitch), 0.0]
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_the_slope_holds_for_a_tool_anywhere(pa10, rng, random_pose):
    tool, q = random_pose(0.3), pa10.random_posture(rng)

    def w(aside):
        return manipulability(pa10.mechanism.kinematics(q + aside, tool).J)

    found = manipulability_slope(pa10.mechanism.kinematics(q, tool).J)[1]
    slopes = [(w(a) - w(-a)) / (2 * STEP) for a in STEP * np.eye(7)]
    np.testing.assert_allclose(found, slopes, atol=1e-6)


@pytest.mark.parametrize("name", CHAINS)
def test_an_arm_that_does_not_reach_all_axes_has_it_on_those_that_it_does(name, rng):
    """Independently: the product of singular values by numpy, and its finite differences."""
    mechanism, rank = CHAINS[name]

    def of(q):
        J = mechanism.kinematics(q, Pose.identity()).J
        return np.prod(np.linalg.svd(J, compute_uv=False)[:rank])

    for _ in range(10):
        q = rng.uniform(-2.5, 2.5, mechanism.n)
        w, found = manipulability_slope(mechanism.kinematics(q, Pose.identity()).J, rank)
        assert w == pytest.approx(of(q), rel=1e-6)
        assert w > 1e-6
        aside = STEP * np.eye(mechanism.n)
        expected = [(of(q + a) - of(q - a)) / (2 * STEP) for a in aside]
        np.testing.assert_allclose(found, expected, atol=1e-6)


@pytest.mark.parametrize("name", CHAINS)
def test_so_does_the_potential(name, rng):
    mechanism, rank = CHAINS[name]
    n, none = mechanism.n, np.zeros((0, 2, 3))
    wide, body = 3.0 * np.ones(n), np.zeros(0, dtype=np.int64)
    of = Potential(-wide, wide, body, Strengths(0.0, 0.0, 0.0, 0.4), 0.0, rank=rank)

    def at(q):
        k = mechanism.kinematics(q, Pose.identity())
        return shape(q, k.J, k.T_world_mrf.p, none)

    for _ in range(10):
        q = rng.uniform(-2.5, 2.5, n)
        found = of.at(at(q), None)
        J = mechanism.kinematics(q, Pose.identity()).J
        w = np.prod(np.linalg.svd(J, compute_uv=False)[:rank])
        assert found.parts["manipulability"] == pytest.approx(-0.4 * w, rel=1e-6)
        aside = STEP * np.eye(n)
        slopes = [(of.at(at(q + a), None).total - of.at(at(q - a), None).total) for a in aside]
        np.testing.assert_allclose(found.torque, -np.array(slopes) / (2 * STEP), atol=1e-6)
        # A small way ahead, the tool is where its own kinematics has it.
        way = rng.normal(size=n)
        there = ahead(at(q), body, way, STEP)
        expected = mechanism.kinematics(q + STEP * way, Pose.identity()).T_world_mrf.p
        np.testing.assert_allclose(there.tool, expected, atol=1e-10)
