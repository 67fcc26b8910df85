"""The search on the self-motion manifold ends where the potential is stationary on it."""

import numpy as np
import pytest
from telerobot.server.control.mechanism.null_space.potentials.curvature import curvature, weighed
from telerobot.server.control.mechanism.null_space.potentials.search import Place, search

from ....potentials import planar
from ....potentials.around import acting, points


def test_table_ii_of_the_paper_to_its_four_digits():
    q = planar.START
    at = planar.joints(q)
    links = zip(at[:, :3].T, at[:, 1:].T, strict=True)
    obstacle = [acting(points(planar.OBSTACLE), *link, least=0.0)[2] for link in links]
    only = planar.value(q, k_limits=0.0)
    np.testing.assert_array_equal(np.round(only.torque, 4), [-0.9161, -0.2268, -0.2858])
    assert only.parts["obstacles"] == pytest.approx(planar.K * sum(obstacle))
    limits = planar.value(q).torque - only.torque
    np.testing.assert_array_equal(np.round(limits, 4), [0.0, -0.0250, 0.0250])
    slope = planar.K * planar.slope_of_manipulability(q)
    np.testing.assert_allclose(slope, 0.0, atol=5e-5)
    total = planar.value(q).torque + slope
    np.testing.assert_array_equal(np.round(total, 4), [-0.9161, -0.2518, -0.2608])


def test_the_search_ends_stationary_with_the_tool_where_it_was():
    found = search(planar.START, planar.look, planar.LOWER, planar.UPPER, 1e-8)
    assert found.stationary
    assert np.linalg.norm(planar.projected(found.q)) < 1e-8
    assert np.abs(planar.look(found.q).error).max() < 1e-10
    assert found.potential < planar.look(planar.START).potential
    # A minimum: whichever way the elbow goes from there, the potential rises.
    for sense in (-1e-3, 1e-3):
        null = np.linalg.svd(planar.look(found.q).J)[2][2]
        aside = search(found.q + sense * null, planar.look, planar.LOWER, planar.UPPER, 1.0, 0)
        assert aside.potential > found.potential


def test_the_printed_minimum_is_none():
    assert np.linalg.norm(planar.projected(planar.PRINTED_MINIMUM)) > 0.1
    found = search(planar.PRINTED_MINIMUM, planar.look, planar.LOWER, planar.UPPER, 1e-8)
    assert np.linalg.norm(found.q - planar.PRINTED_MINIMUM) > 0.5


def test_a_bounded_search_stops_after_its_steps_and_never_rises():
    before = planar.look(planar.START).potential
    for steps in (0, 1, 3, 10):
        found = search(planar.START, planar.look, planar.LOWER, planar.UPPER, 1e-9, steps)
        assert found.steps <= steps
        assert found.potential <= before + 1e-12
        before = found.potential
        assert np.abs(planar.look(found.q).error).max() < 1e-10


def test_a_small_step_is_not_taken_for_the_end():
    """With the strengths a thousandth, steps by slope times a gain would be tiny at once."""

    def weak(q):
        here = planar.look(q)
        return here._replace(torque=1e-3 * here.torque, potential=1e-3 * here.potential)

    strong = search(planar.START, planar.look, planar.LOWER, planar.UPPER, 1e-8)
    found = search(planar.START, weak, planar.LOWER, planar.UPPER, 1e-11)
    assert found.stationary
    np.testing.assert_allclose(found.q, strong.q, atol=1e-6)


def test_a_joint_at_its_bound_stays_there_and_ends_the_search():
    upper = np.array([np.pi, np.pi, -0.5])
    found = search(planar.START, planar.look, planar.LOWER, upper, 1e-8)
    assert found.stationary
    assert (found.q <= upper + 1e-12).all()
    assert found.q[2] == pytest.approx(-0.5, abs=1e-9)


def test_the_curvature_is_that_of_the_potential_along_the_manifold():
    q = search(planar.START, planar.look, planar.LOWER, planar.UPPER, 1e-9, 4).q
    here = planar.look(q)
    way = np.linalg.svd(here.J)[2][2]
    ahead = planar.look(q + 1e-5 * way)
    found = curvature(way, here.J, here.torque, ahead.J, ahead.torque, 1e-5)

    def along(s):
        """V where the self-motion has gone a length s, the tool kept."""
        return search(q + s * way, planar.look, planar.LOWER, planar.UPPER, 1.0, 0)

    s = 1e-3
    ahead, back = along(s), along(-s)
    second = (ahead.potential - 2.0 * here.potential + back.potential) / s**2
    assert found == pytest.approx(second, rel=1e-3)


def test_the_force_that_holds_the_tool_is_that_of_the_pseudo_inverse(rng):
    for rows, joints in ((6, 7), (6, 10), (2, 3), (6, 6)):
        J, torque = rng.normal(size=(rows, joints)), rng.normal(size=joints)
        np.testing.assert_allclose(
            weighed(J, J @ torque), np.linalg.pinv(J).T @ torque, rtol=1e-6, atol=1e-6
        )


def test_at_a_singularity_what_holds_the_tool_is_finite():
    J = np.zeros((6, 3))
    J[:2] = planar.jacobian(np.zeros(3))[:2]
    assert np.isfinite(weighed(J, J @ np.ones(3))).all()


def test_a_pose_out_of_reach_is_told():
    def far(q):
        here = planar.look(q)
        return here._replace(error=here.error + np.array([3.0, 0.0]))

    with pytest.raises(ValueError, match="tool's pose"):
        search(planar.START, far, planar.LOWER, planar.UPPER, 1e-8)


def test_a_place_without_slope_is_its_own_answer():
    q = np.array([0.1, 0.9, 0.4])
    J = planar.jacobian(q)[:2]

    def flat(q):
        return Place(np.zeros(2), J, np.zeros(3), 0.0)

    found = search(q, flat, planar.LOWER, planar.UPPER, 1e-8)
    assert found.steps == 0
    np.testing.assert_array_equal(found.q, q)
