"""Links in the field of lines and solids: against quadrature and finite differences."""

import numpy as np
import pytest
from laboratory.papers.around import acting, boxes, lines, points, rounds

LEAST = 0.02


def rotations(rng, n):
    return np.stack([np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(n)])


def scenes():
    rng = np.random.default_rng(11)
    start, end = rng.normal(size=(2, 4, 3))
    radius, half = rng.uniform(0.05, 0.3, size=4), rng.uniform(0.05, 0.4, size=(4, 3))
    return {
        "lines": lines(start, end),
        "round": rounds(start, end, radius),
        "spheres": rounds(start, start, radius),
        "thin": rounds(start, end, 0.0),
        "boxes": boxes(rotations(rng, 4), start, half),
    }


@pytest.mark.parametrize("what", [*scenes()])
def test_forces_and_moments_are_the_slope_of_the_potential(what):
    scene, rng, h = scenes()[what], np.random.default_rng(11), 1e-6
    for _ in range(3):
        p1 = rng.normal(size=3)
        p2 = p1 + 0.5 * rng.normal(size=3)
        force, moment, _ = acting(scene, p1, p2, LEAST)

        def potential(shift, turn, p1=p1, p2=p2):
            """Of the link after a small step, and a turn about World's origin."""
            ends = (x + shift + np.cross(turn, x) for x in (p1, p2))
            return acting(scene, *ends, LEAST)[2]

        for axis, e in enumerate(h * np.eye(3)):
            slope = -(potential(e, 0.0 * e) - potential(-e, 0.0 * e)) / (2 * h)
            assert force[axis] == pytest.approx(slope, rel=1e-4, abs=1e-6)
            slope = -(potential(0.0 * e, e) - potential(0.0 * e, -e)) / (2 * h)
            assert moment[axis] == pytest.approx(slope, rel=1e-4, abs=1e-6)


def test_a_line_is_a_row_of_many_charges():
    rng = np.random.default_rng(12)
    start, end = np.array([1.5, 0.2, 0.4]), np.array([1.0, 2.5, -0.5])
    n = 4000
    part = (np.arange(n)[:, None] + 0.5) / n
    row, line, each = points(start + (end - start) * part), lines(start, end), 1.0 / n
    each *= np.linalg.norm(end - start)
    for _ in range(3):
        p1 = rng.normal(size=3)
        p2 = p1 + 0.5 * rng.normal(size=3)
        force, moment, potential = acting(line, p1, p2, LEAST)
        expected = acting(row, p1, p2, LEAST)
        assert potential == pytest.approx(each * expected[2], rel=2e-3)
        np.testing.assert_allclose(force, each * expected[0], rtol=2e-2, atol=6e-3)
        np.testing.assert_allclose(moment, each * expected[1], rtol=2e-2, atol=6e-3)


def test_the_push_of_a_line_does_not_jump_where_it_passes_through_parallel():
    """Closest points jump from end to end there; the moment of the whole line goes smoothly."""
    line = lines([-1.0, 0.0, 0.3], [1.0, 0.0, 0.3])

    def moment(angle):
        along = np.array([np.cos(angle), 0.0, np.sin(angle)])
        return acting(line, -0.3 * along, 0.3 * along, LEAST)[1][1]

    angles = np.linspace(-1e-6, 1e-6, 9)
    slopes = np.diff([moment(a) for a in angles]) / np.diff(angles)
    assert np.abs(slopes).max() < 2.0
    np.testing.assert_allclose(slopes, slopes[0], rtol=1e-3)


def distance(scene, x):
    """Return what distance a very short link at x (3,) finds, and the way that it is pushed."""
    short = np.array([0.0, 0.0, 5e-8])
    force, _, potential = acting(scene, x - short, x + short, LEAST)
    bounded = 1e-7 / potential
    return bounded - LEAST**2 / bounded, force / np.linalg.norm(force)


def test_distances_to_boxes_are_those_to_their_nearest_surface_point():
    rng = np.random.default_rng(13)
    centre, half, R = rng.normal(size=3), np.array([0.5, 0.3, 0.2]), rotations(rng, 1)
    box = boxes(R, centre[None], half[None])
    # A dense net on the box's surface, some points on each face.
    net = []
    for axis in range(3):
        for side in (-1, 1):
            u, v = np.meshgrid(*[np.linspace(-1, 1, 81)] * 2)
            face = np.empty((u.size, 3))
            face[:, axis] = side
            face[:, (axis + 1) % 3], face[:, (axis + 2) % 3] = u.ravel(), v.ravel()
            net.append(centre + (half * face) @ R[0].T)
    net = np.vstack(net)
    for x in rng.normal(size=(200, 3)):
        found, normal = distance(box, x)
        away = x - net
        size = np.linalg.norm(away, axis=1)
        assert abs(found) == pytest.approx(size.min(), abs=2e-2)
        inside = (np.abs(R[0].T @ (x - centre)) < half).all()
        assert (found < 0.0) == inside
        np.testing.assert_allclose(x - found * normal, net[size.argmin()], atol=2e-2)


def test_distances_to_rounds_are_those_to_their_nearest_surface_point():
    rng = np.random.default_rng(14)
    start, end = np.array([0.2, -0.3, 0.1]), np.array([0.6, 0.4, -0.5])
    capsule, axis = (
        rounds(start, end, 0.25),
        start + (end - start) * np.linspace(0, 1, 2001)[:, None],
    )
    for x in rng.normal(size=(200, 3)):
        found, normal = distance(capsule, x)
        away = x - axis
        size = np.linalg.norm(away, axis=1)
        assert found == pytest.approx(size.min() - 0.25, abs=1e-6)
        np.testing.assert_allclose(normal, away[size.argmin()] / size.min(), atol=2e-3)


def test_the_push_of_a_solid_is_the_integral_along_the_link():
    """A ball beside a link: k/d' and its slope, summed over a thousand places."""
    centre, radius = np.array([0.1, 0.5, -0.2]), 0.1
    p1, p2 = np.array([-0.2, 0.0, 0.1]), np.array([0.3, 0.1, -0.2])
    at = p1 + (p2 - p1) * ((np.arange(1000) + 0.5) / 1000)[:, None]
    away = at - centre
    d = np.linalg.norm(away, axis=1) - radius
    bounded = 0.5 * d + np.sqrt(0.25 * d * d + LEAST**2)
    pull = 1.0 / (bounded**2 + LEAST**2) / (d + radius)
    each = np.linalg.norm(p2 - p1) / 1000
    force, moment, potential = acting(rounds(centre, centre, radius), p1, p2, LEAST)
    assert potential == pytest.approx(each * (1.0 / bounded).sum(), rel=1e-4)
    np.testing.assert_allclose(force, each * pull @ away, atol=1e-4 * np.linalg.norm(force))
    np.testing.assert_allclose(moment, each * pull @ np.cross(at, away), atol=5e-4)


def test_solids_push_outwards_and_never_without_bound():
    box = boxes(np.eye(3)[None], np.zeros((1, 3)), np.full((1, 3), 0.2))
    at = np.linspace(0.05, 0.6, 200)
    forces = [acting(box, [x, -0.05, 0.0], [x, 0.05, 0.0], LEAST)[0] for x in at]
    pushes = np.array(forces)[:, 0]
    assert (pushes > 0.0).all()
    assert pushes.max() <= 0.1 / LEAST**2
    outside = at > 0.2
    assert (np.diff(pushes[outside]) < 0.0).all()
