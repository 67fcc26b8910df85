"""The potential of the paper's planar arm, and its curvature along the self-motion manifold."""

import numpy as np
import pytest
from laboratory.papers import planar
from laboratory.papers.around import acting, points
from laboratory.papers.search import search
from telerobot.server.control.mechanism.potentials import curvature, weighed


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


def test_a_search_downhill_ends_at_a_minimum_with_the_tool_where_it_was():
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
