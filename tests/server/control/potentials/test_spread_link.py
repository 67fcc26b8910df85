"""Links in the field of lines and solids: against quadrature and finite differences."""

import numpy as np
import pytest
from telerobot.server.control.potentials import solid, spread_link
from telerobot.server.control.potentials.charged_link import load

LEAST = 0.02


def random_links(rng, m=3):
    p1 = rng.normal(size=(3, m))
    return p1, p1 + 0.5 * rng.normal(size=(3, m))


def line_load(p1, p2, start, end, k):
    return spread_link.lines(spread_link.points(p1, p2), start, end, k, LEAST)


def round_load(p1, p2, start, end, radius, k):
    at = spread_link.points(p1, p2)
    return spread_link.solids(at, *solid.round_solids(at.x, start, end, radius), k, LEAST)


def box_load(p1, p2, centre, R, half, k):
    at = spread_link.points(p1, p2)
    return spread_link.solids(at, *solid.boxes(at.x, centre, R, half), k, LEAST)


def rotations(rng, n):
    return np.stack([np.linalg.qr(rng.normal(size=(3, 3)))[0] for _ in range(n)])


def cases():
    rng = np.random.default_rng(11)
    p1, p2 = random_links(rng)
    start, end = rng.normal(size=(2, 3, 4))
    k = rng.uniform(0.1, 1.0, size=4)
    radius, half = rng.uniform(0.05, 0.3, size=4), rng.uniform(0.05, 0.4, size=(3, 4))
    R = rotations(rng, 4)
    return {
        "lines": (p1, p2, lambda a, b: line_load(a, b, start, end, k)),
        "round": (p1, p2, lambda a, b: round_load(a, b, start, end, radius, k)),
        "boxes": (p1, p2, lambda a, b: box_load(a, b, start, R, half, k)),
    }


@pytest.mark.parametrize("what", ["lines", "round", "boxes"])
def test_forces_and_moments_are_the_slope_of_the_potential(what):
    p1, p2, act = cases()[what]
    found, h = act(p1, p2), 1e-6
    for link in range(p1.shape[1]):
        for axis in range(6):

            def moved(sign, link=link, axis=axis):
                a, b = p1.copy(), p2.copy()
                e = sign * h * np.eye(3)[axis % 3]
                if axis < 3:
                    a[:, link] += e
                    b[:, link] += e
                else:  # a turn about World's origin
                    a[:, link] += np.cross(e, a[:, link])
                    b[:, link] += np.cross(e, b[:, link])
                return act(a, b).potential.sum()

            slope = -(moved(1.0) - moved(-1.0)) / (2 * h)
            assert found.wrench[axis, link] == pytest.approx(slope, rel=1e-4, abs=1e-6)


def test_a_line_is_a_row_of_many_charges():
    rng = np.random.default_rng(12)
    p1, p2 = random_links(rng)
    start, end = np.array([[1.5], [0.2], [0.4]]), np.array([[1.0], [2.5], [-0.5]])
    n = 4000
    part = (np.arange(n) + 0.5) / n
    charges = start + (end - start) * part
    k = np.full(n, 0.3 * np.linalg.norm(end - start) / n)
    row = load(p1, p2, charges, k, LEAST)
    found = line_load(p1, p2, start, end, np.array([0.3]))
    assert found.potential.sum() == pytest.approx(row.potential.sum(), rel=2e-3)
    np.testing.assert_allclose(found.wrench, row.wrench, rtol=2e-2, atol=2e-3)


def test_the_push_of_a_line_does_not_jump_where_it_passes_through_parallel():
    """Closest points jump from end to end there; the moment of the whole line goes smoothly."""
    start, end = np.array([[-1.0], [0.0], [0.3]]), np.array([[1.0], [0.0], [0.3]])

    def moment(angle):
        along = np.array([[np.cos(angle)], [0.0], [np.sin(angle)]])
        return line_load(-0.3 * along, 0.3 * along, start, end, np.array([1.0])).wrench[4, 0]

    angles = np.linspace(-1e-6, 1e-6, 9)
    slopes = np.diff([moment(a) for a in angles]) / np.diff(angles)
    assert np.abs(slopes).max() < 2.0
    np.testing.assert_allclose(slopes, slopes[0], rtol=1e-3)


def test_distances_to_solids_are_those_to_their_nearest_surface_point():
    rng = np.random.default_rng(13)
    x = rng.normal(size=(3, 200))
    centre, half, R = rng.normal(size=(3, 1)), np.array([[0.5], [0.3], [0.2]]), rotations(rng, 1)
    distance, normal = solid.boxes(x, centre, R, half)
    # A dense net on the box's surface, some points on each face.
    net = []
    for axis in range(3):
        for side in (-1, 1):
            u, v = np.meshgrid(*[np.linspace(-1, 1, 81)] * 2)
            face = np.empty((3, u.size))
            face[axis], face[(axis + 1) % 3], face[(axis + 2) % 3] = side, u.ravel(), v.ravel()
            net.append(centre + R[0] @ (half * face))
    net = np.hstack(net)
    nearest = np.sqrt(((x[:, :, None] - net[:, None, :]) ** 2).sum(axis=0).min(axis=1))
    np.testing.assert_allclose(np.abs(distance[0]), nearest, atol=2e-2)
    inside = (np.abs(R[0].T @ (x - centre)) < half).all(axis=0)
    np.testing.assert_array_equal(distance[0] < 0, inside)
    np.testing.assert_allclose((normal[:, 0] ** 2).sum(axis=0), 1.0, rtol=1e-9)


def test_solids_push_outwards_and_never_without_bound():
    box = (np.zeros((3, 1)), np.eye(3)[None], np.full((3, 1), 0.2), np.array([0.1]))
    pushes = []
    for x in np.linspace(0.05, 0.6, 200):
        p1, p2 = np.array([[x], [-0.05], [0.0]]), np.array([[x], [0.05], [0.0]])
        pushes.append(box_load(p1, p2, *box).wrench[0, 0])
    pushes = np.array(pushes)
    assert (pushes > 0.0).all()
    assert pushes.max() <= 0.1 * 0.1 / LEAST**2
    outside = np.linspace(0.05, 0.6, 200) > 0.2
    assert (np.diff(pushes[outside]) < 0.0).all()
