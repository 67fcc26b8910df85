"""The field of a point charge on a link, against quadrature, finite differences and the paper."""

from typing import NamedTuple

import numpy as np
import pytest
from laboratory.papers.around import acting, points
from telerobot.server.control.mechanism.potentials import by_charge, direction, push


class Pairs(NamedTuple):
    """What unit charges do to links: force and moment about the first end (m, c, 3), potential."""

    force: np.ndarray
    moment: np.ndarray
    potential: np.ndarray


def pairs(p1, p2, charges, least=0.0):
    found = Pairs(*(np.empty((p1.shape[1], charges.shape[1], *x)) for x in ((3,), (3,), ())))
    for i, (a, b) in enumerate(zip(p1.T, p2.T, strict=True)):
        u, length = direction(tuple(a), tuple(b))
        for j, charge in enumerate(charges.T):
            force, lever, potential = by_charge(tuple(a), u, length, tuple(charge), least)
            found.force[i, j], found.potential[i, j] = force, potential
            found.moment[i, j] = np.cross(u, lever)
    return found


def column(*points):
    return np.array(points, dtype=float).T


def quadrature(p1, p2, charge, panels=64):
    """Force, moment about p1 and potential by Gauss–Legendre.

    Along s = c sinh(w) from the foot of the perpendicular, on which the integrands are smooth
    however small c is.
    """
    along = p2 - p1
    L = np.linalg.norm(along)
    u = along / L
    foot = (charge - p1) @ u
    away = p1 + foot * u - charge
    c = np.linalg.norm(away)
    edges = np.linspace(np.arcsinh(-foot / c), np.arcsinh((L - foot) / c), panels + 1)
    x, weight = np.polynomial.legendre.leggauss(20)
    half = 0.5 * np.diff(edges)
    w = (0.5 * (edges[1:] + edges[:-1])[:, None] + half[:, None] * x).ravel()
    dw = (half[:, None] * weight).ravel()
    s, ds, r = c * np.sinh(w), c * np.cosh(w) * dw, c * np.cosh(w)
    pull = (away[:, None] + s * u[:, None]) / r**3 * ds
    arm = (s + foot) * u[:, None]
    return pull.sum(axis=1), np.cross(arm, pull, axis=0).sum(axis=1), (ds / r).sum()


def hard_places():
    """A link, and charges where the printed formulas lose their digits or divide by nothing."""
    p1, u = np.array([0.3, -0.2, 0.5]), np.array([2.0, 1.0, -2.0]) / 3.0
    aside = np.array([1.0, 0.0, 1.0]) / np.sqrt(2.0)
    for c in (1.0, 1e-3, 1e-6, 1e-9):
        for along in (-0.4, 0.35, 1.1):
            yield pytest.param(p1, p1 + 0.7 * u, p1 + along * u + c * aside, c, id=f"{along}-{c}")


@pytest.mark.parametrize(("p1", "p2", "charge", "c"), [*hard_places()])
def test_force_moment_and_potential_are_the_integrals_over_the_link(p1, p2, charge, c):
    found = pairs(column(p1), column(p2), column(charge))
    force, moment, potential = quadrature(p1, p2, charge)
    # Of the place itself only 1e-16 is known, and c is made of it.
    tolerance = max(1e-11, 4e-16 / c)
    np.testing.assert_allclose(found.force[0, 0], force, atol=tolerance * np.linalg.norm(force))
    np.testing.assert_allclose(found.moment[0, 0], moment, atol=tolerance * np.linalg.norm(moment))
    assert found.potential[0, 0] == pytest.approx(potential, rel=max(1e-12, tolerance))


def test_random_pairs_are_the_integrals_over_the_link():
    rng = np.random.default_rng(3)
    p1, p2, charges = (rng.normal(size=(3, n)) for n in (4, 4, 6))
    found = pairs(p1, p2, charges)
    for link in range(4):
        for charge in range(6):
            force, moment, potential = quadrature(p1[:, link], p2[:, link], charges[:, charge])
            np.testing.assert_allclose(found.force[link, charge], force, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(found.moment[link, charge], moment, rtol=1e-9, atol=1e-12)
            assert found.potential[link, charge] == pytest.approx(potential, rel=1e-11)


def test_beyond_the_end_of_a_link_the_sideways_force_is_not_lost():
    """At c = 1e-9 the printed difference (13) is nought; the integral is not."""
    c = 1e-9
    found = pairs(column([0, 0, 0]), column([1, 0, 0]), column([1.5, c, 0])).force[0, 0]
    # To first order in c: −c ∫ ds/s³ from 1/2 to 3/2, and ∫ ds/s² along the link.
    assert found[1] == pytest.approx(-c * (0.5 / 0.25 - 0.5 / 2.25), rel=1e-12)
    assert found[1] == pytest.approx(-1.7777777777777778e-9, rel=1e-12)
    assert found[0] == pytest.approx(-(1.0 / 0.5 - 1.0 / 1.5), rel=1e-12)


def test_beside_a_link_the_push_grows_as_two_over_the_distance():
    for c in (1e-4, 1e-9):
        found = pairs(column([0, 0, 0]), column([1, 0, 0]), column([0.4, c, 0])).force[0, 0]
        assert found[1] == pytest.approx(-2.0 / c, rel=1e-6)
        # Along the link it stays what it is; in one vector sum it would drown.
        assert found[0] == pytest.approx(1.0 / 0.4 - 1.0 / 0.6, rel=1e-6)


@pytest.mark.parametrize("least", [0.0, 0.05])
def test_a_charge_on_the_line_of_a_link_pushes_along_it_only(least):
    found = pairs(column([0, 0, 0]), column([1, 0, 0]), column([-0.5, 0, 0]), least)
    np.testing.assert_allclose(found.force[0, 0, 1:], 0.0, atol=1e-300)
    assert found.force[0, 0, 0] == pytest.approx(
        1.0 / 0.5 - 1.0 / 1.5, rel=1e-2 if least else 1e-14
    )
    assert np.isfinite(found.potential).all()


def test_on_a_link_a_least_distance_keeps_the_push_finite_and_the_potential_smooth():
    p1, p2, least = column([0, 0, 0]), column([1, 0, 0]), 0.02
    y = np.linspace(-0.1, 0.1, 2001)
    charges = np.stack([np.full_like(y, 0.4), y, np.zeros_like(y)])
    found = pairs(p1, p2, charges, least)
    push = found.force[0, :, 1]
    assert np.abs(push).max() < 1.0 / least
    assert push[1000] == pytest.approx(0.0, abs=1e-9)
    slope = np.gradient(found.potential[0], y)
    np.testing.assert_allclose(slope[1:-1], push[1:-1], atol=2e-3 / least)


@pytest.mark.parametrize("least", [0.0, 0.03])
def test_the_force_is_the_slope_of_the_potential(least):
    rng = np.random.default_rng(5)
    h = 1e-6
    for _ in range(20):
        p1, p2, charge = rng.normal(size=(3, 3, 1))
        force = pairs(p1, p2, charge, least).force[0, 0]
        for axis in range(3):
            step = np.zeros((3, 1))
            step[axis] = h
            ahead = pairs(p1 + step, p2 + step, charge, least).potential[0, 0]
            back = pairs(p1 - step, p2 - step, charge, least).potential[0, 0]
            assert force[axis] == pytest.approx(-(ahead - back) / (2 * h), rel=1e-5, abs=1e-7)


@pytest.mark.parametrize("least", [0.0, 0.03])
def test_the_moment_is_the_slope_of_the_potential_in_a_turn(least):
    rng = np.random.default_rng(6)
    h = 1e-6
    for _ in range(20):
        p1, p2, charge = rng.normal(size=(3, 3, 1))
        moment = pairs(p1, p2, charge, least).moment[0, 0]
        for axis in range(3):
            e = np.eye(3)[axis]
            turn = h * np.cross(e, (p2 - p1)[:, 0])[:, None]
            ahead = pairs(p1, p2 + turn, charge, least).potential[0, 0]
            back = pairs(p1, p2 - turn, charge, least).potential[0, 0]
            assert moment[axis] == pytest.approx(-(ahead - back) / (2 * h), rel=1e-4, abs=1e-6)


def test_the_torques_are_those_of_all_pairs_about_the_worlds_origin():
    """Joints that are the six unit twists there feel the wrench of the links outboard of them."""
    rng = np.random.default_rng(7)
    p1, p2, charges = (rng.normal(size=(3, n)) for n in (3, 3, 5))
    k, least, body = 0.7, 0.01, np.array([0, 4, 6])
    each, scene = pairs(p1, p2, charges, least), points(charges.T)
    force = k * each.force.sum(axis=1)
    moment = k * each.moment.sum(axis=1) + np.cross(p1.T, force)
    wrench, moves = np.hstack([force, moment]), np.arange(6) < body[:, None]
    around = (scene.solids, k, 0.0, least, True)
    torque, potential = push(np.eye(6), np.stack([p1.T, p2.T], axis=1), body, *around)
    np.testing.assert_allclose(torque, (wrench * moves).sum(axis=0), rtol=1e-12)
    assert potential == pytest.approx(k * each.potential.sum(), rel=1e-12)


def test_a_link_without_length_feels_nothing():
    p = np.array([0.1, 0.2, 0.3])
    scene = points(np.array([[0.1, 0.2, 0.3], [1.0, 0.0, 0.0]]))
    force, moment, potential = acting(scene, p, p, 0.01)
    assert not force.any()
    assert not moment.any()
    assert potential == 0.0
