"""The points of lines that are closest to links, and the jump that they make."""

import numpy as np
from laboratory.papers.around import acting, lines
from telerobot.server.control.mechanism.potentials import closest


def test_closest_points_are_those_of_a_dense_search():
    rng = np.random.default_rng(31)
    part = np.linspace(0.0, 1.0, 801)[:, None]
    for _ in range(20):
        p1, p2, start, end = rng.normal(size=(4, 3))
        found = closest(tuple(p1), tuple(p2), tuple(start), tuple(end))
        link, line = p1 + (p2 - p1) * part, start + (end - start) * part
        apart = np.linalg.norm(line[:, None] - link, axis=2)
        least = np.linalg.norm(found - link, axis=1).min()
        assert abs(least - apart.min()) < 5e-3


def test_a_line_parallel_to_a_link_stands_at_its_middle():
    found = closest((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (-1.0, 0.2, 0.0), (3.0, 0.2, 0.0))
    np.testing.assert_allclose(found, [1.0, 0.2, 0.0])


def test_the_moment_jumps_where_line_and_link_pass_through_parallel():
    """What the paper reports, and why the smooth line is the default."""
    scene = lines([-0.4, 0.0, 0.3], [0.4, 0.0, 0.3])

    def moment(angle):
        along = np.array([np.cos(angle), 0.0, np.sin(angle)])
        return acting(scene, -0.5 * along, 0.5 * along, 0.0, smooth=False)[1][1]

    assert 0.1 * abs(moment(1e-5) - moment(-1e-5)) > 0.05
