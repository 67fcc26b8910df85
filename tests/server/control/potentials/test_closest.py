"""The points of lines that are closest to links, and the jump that they make."""

import numpy as np
from telerobot.server.control.potentials.charged_link import load
from telerobot.server.control.potentials.closest import closest_points


def test_closest_points_are_those_of_a_dense_search():
    rng = np.random.default_rng(31)
    p1, p2, start, end = (rng.normal(size=(3, n)) for n in (5, 5, 4, 4))
    found = closest_points(p1, p2, start, end)
    part = np.linspace(0.0, 1.0, 801)
    for m in range(5):
        link = p1[:, m, None] + (p2 - p1)[:, m, None] * part
        for o in range(4):
            line = start[:, o, None] + (end - start)[:, o, None] * part
            apart = np.linalg.norm(line[:, :, None] - link[:, None, :], axis=0)
            least = np.linalg.norm(found[:, m, o][:, None] - link, axis=0).min()
            assert abs(least - apart.min()) < 5e-3


def test_a_line_parallel_to_a_link_stands_at_its_middle():
    start, end = np.array([[-1.0], [0.2], [0.0]]), np.array([[3.0], [0.2], [0.0]])
    found = closest_points(np.zeros((3, 1)), np.array([[1.0], [0.0], [0.0]]), start, end)
    np.testing.assert_allclose(found[:, 0, 0], [1.0, 0.2, 0.0])


def test_the_moment_jumps_where_line_and_link_pass_through_parallel():
    """What the paper reports, and why the smooth line is the default."""
    start, end = np.array([[-0.4], [0.0], [0.3]]), np.array([[0.4], [0.0], [0.3]])

    def moment(angle):
        along = np.array([[np.cos(angle)], [0.0], [np.sin(angle)]])
        p1, p2 = -0.5 * along, 0.5 * along
        nearest = closest_points(p1, p2, start, end)
        return load(p1, p2, nearest, np.array([0.1]), 0.0).wrench[4, 0]

    assert abs(moment(1e-5) - moment(-1e-5)) > 0.05
