"""The joints' fit is the least-squares solution, whatever the chain, and so are its rates."""

import numpy as np
import pytest
from laboratory.papers.maze import (
    FED,
    MAZE,
    S1,
    SPACE,
    alternating,
    descended,
    fed,
    planar,
    planar_points,
    universal,
)
from telerobot.server.control.backbone.tunnels import off_centre

KINDS = [(planar, MAZE), (alternating, SPACE), (universal, SPACE), (fed, FED)]


def fitted(chain, curve, s1):
    points, rates = curve.at(s1, chain.stations)
    return chain.settled(chain.guess(points), points, rates), points, rates


def jacobian(chain, q, step=1e-3):
    """Of all points that count (3 n, n), by differences of fourth order.

    Those of second order round to 1e-9, which a chain of 100 makes 2e-5 of a rate.
    """

    def apart(times):
        ways = times * step * np.eye(chain.n)
        return chain.points(q + ways)[:, 1:] - chain.points(q - ways)[:, 1:]

    slope = (8.0 * apart(1.0) - apart(2.0)) / (12.0 * step)
    return slope[:, chain.links.counts].reshape(chain.n, -1).T


def cost(chain, q, points):
    off = (chain.points(q[None])[0, 1:] - points)[chain.links.counts]
    return 0.5 * float((off**2).sum())


@pytest.mark.parametrize(("make", "curve"), KINDS)
@pytest.mark.parametrize("n", [10, 30, 100])
def test_a_step_and_the_rates_are_those_of_a_dense_least_squares_solver(make, curve, n):
    chain = make(n)
    q = fitted(chain, curve, 0.68)[0].q + np.random.default_rng(n).normal(0.0, 0.2 / n, n)
    points, rates = curve.at(0.7, chain.stations)
    found = chain.fitted(q, points, rates, 1)
    J, counts = jacobian(chain, q), chain.links.counts
    off = (points - chain.points(q[None])[0, 1:])[counts].ravel()
    dense = np.linalg.lstsq(J, np.column_stack((off, rates[counts].ravel())), rcond=None)[0]
    assert found.q - q == pytest.approx(dense[:, 0], abs=2e-9)
    assert found.rates == pytest.approx(dense[:, 1], abs=2e-7)


@pytest.mark.parametrize(("make", "curve"), KINDS)
def test_with_weights_and_joints_that_stand_a_step_is_that_of_a_dense_solver(make, curve):
    chain, rng = make(30), np.random.default_rng(7)
    q = fitted(chain, curve, 0.68)[0].q + rng.normal(0.0, 0.005, 30)
    points, rates = curve.at(0.7, chain.stations)
    weights, free = rng.uniform(0.5, 20.0, 30), np.ones(30, dtype=bool)
    free[[4, 17, 18]] = False
    found = chain.fitted(q, points, rates, 1, weights, free)
    J, counts = jacobian(chain, q), chain.links.counts
    root = np.repeat(np.sqrt(weights[counts]), 3)[:, None]
    off = (points - chain.points(q[None])[0, 1:])[counts].ravel()
    sides = np.column_stack((off, rates[counts].ravel()))
    dense = np.zeros((30, 2))
    dense[free] = np.linalg.lstsq(root * J[:, free], root * sides, rcond=None)[0]
    assert found.q - q == pytest.approx(dense[:, 0], abs=2e-9)
    assert found.rates == pytest.approx(dense[:, 1], abs=2e-7)
    assert (found.q[~free] == q[~free]).all()


@pytest.mark.parametrize(("make", "curve"), KINDS[:3])
def test_a_general_optimiser_finds_nothing_better(make, curve):
    chain = make(6)
    best, points, _ = fitted(chain, curve, 0.83)
    least = cost(chain, best.q, points)
    rng = np.random.default_rng(1)
    for _ in range(3):
        q, scale = best.q + rng.normal(0.0, 0.05, 6), 0.05
        for _ in range(6000):  # random descent, which knows no derivative and no structure
            tried = q + rng.normal(0.0, scale, 6)
            if cost(chain, tried, points) < cost(chain, q, points):
                q, scale = tried, 1.5 * scale
            else:
                scale = max(0.97 * scale, 1e-8)
        assert cost(chain, q, points) >= least - 1e-12
        assert q == pytest.approx(best.q, abs=1e-3)


@pytest.mark.parametrize(("make", "curve"), KINDS)
def test_the_fit_s_rates_are_close_to_its_derivative(make, curve):
    chain, step = make(30), 1e-5
    found = fitted(chain, curve, 0.7)[0]
    near = [chain.settled(found.q, *curve.at(0.7 + by, chain.stations)).q for by in (-step, step)]
    slope = (near[1] - near[0]) / (2 * step)
    # They leave out the second derivative of the points times what is left of the distance.
    assert np.abs(slope - found.rates).max() < 0.12 * np.abs(slope).max()


def off_the_centre_line(chain, curve, s1, placed):
    """The farthest that a point of the links inside the tunnel is from its centre line."""
    share = np.linspace(0.0, 1.0, 11)
    links = placed[:-1, None] + share[:, None] * (placed[1:] - placed[:-1])[:, None]
    begin = np.concatenate(([0.0], chain.stations[:-1]))
    depths = begin[:, None] + share * (chain.stations - begin)[:, None] - s1
    upto = np.array([len(curve.arcs.turning) - 1])
    return off_centre(curve.arcs[:], links.reshape(-1, 3), depths.ravel(), 0.06, upto)[0]


def accuracy(n, s1):
    """How far joints are off the curve, and links off the centre line, at most."""
    chain = planar(n)
    found, points, _ = fitted(chain, MAZE, s1)
    assert np.abs(found.q).max() < 1.7
    placed = chain.points(found.q[None])[0]
    off = np.linalg.norm(placed[1:] - points, axis=1).max()
    return off, off_the_centre_line(chain, MAZE, s1, placed)


@pytest.mark.parametrize(
    ("n", "off", "off_link"), [(10, 0.0074, 0.0170), (20, 0.0021, 0.0042), (30, 0.0009, 0.0022)]
)
def test_planar_joints_follow_the_last_of_the_paper_s_figure_5(n, off, off_link):
    assert (np.array(accuracy(n, S1[-1])) <= (off, off_link)).all()


@pytest.mark.parametrize(
    # On the way there the least sum of squares leaves more: at s1 = 0.68, and at 0.94 and 0.54.
    ("n", "off", "off_link"),
    [(10, 0.0098, 0.0170), (20, 0.0021, 0.0046), (30, 0.0009, 0.0022)],
)
def test_planar_joints_follow_all_of_the_paper_s_figure_5(n, off, off_link):
    found = np.array([accuracy(n, s1) for s1 in S1])
    assert (found.max(axis=0) <= (off, off_link)).all()


def test_what_ten_joints_leave_on_the_way_is_the_least_sum_s_own():
    chain, n = planar(10), 10
    best, points, _ = fitted(chain, MAZE, 0.68)
    goal, least = points[:, :2], 2.0 * cost(chain, best.q, points)
    starts = best.q + np.random.default_rng(4).normal(0.0, 0.8, (200, n))
    found, sums = descended(starts, goal, np.ones(n), 150)
    assert sums.min() == pytest.approx(least, rel=1e-9)
    nearest = found[int(sums.argmin())]
    assert np.abs(np.angle(np.exp(1j * (nearest - best.q)))).max() < 1e-4
    off = np.linalg.norm(planar_points(nearest[None])[0][0] - goal, axis=1).max()
    assert off == pytest.approx(0.0097, abs=1e-4)

    # Where the farthest point counts alone (Lawson's weights), joints come nearer, links do not.
    q, weights = best.q[None], np.full(n, 1.0 / n)
    for _ in range(150):
        q, _ = descended(q, goal, weights, 6)
        weights = weights * np.linalg.norm(planar_points(q)[0][0] - goal, axis=1)
        weights /= weights.sum()
    placed = chain.points(q)[0]
    assert np.linalg.norm(placed[1:] - points, axis=1).max() < 0.0072
    assert cost(chain, q[0], points) > 1.05 * cost(chain, best.q, points)
    assert off_the_centre_line(chain, MAZE, 0.68, placed) > 0.0170


def test_alternating_joints_follow_a_spatial_tunnel():
    chain = alternating(30)
    for s1 in S1:
        found, _, _ = fitted(chain, SPACE, s1)
        placed = chain.points(found.q[None])[0]
        assert off_the_centre_line(chain, SPACE, s1, placed) <= 0.0038
        assert np.abs(found.q).max() < np.radians(36)


def test_one_step_a_tick_keeps_up_with_a_curve_that_slides():
    chain = planar(30)
    found = fitted(chain, MAZE, 0.9)[0]
    by = -0.05 / 1.5 * 0.01  # 50 mm/s at 1.5 m, 10 ms
    s1, q, rates, lag = 0.9, found.q, found.rates, 0.0
    while s1 > 0.45:
        s1 += by
        sampled = MAZE.at(s1, chain.stations)
        q, rates = chain.fitted(q + by * rates, *sampled, 1)
        if round((0.9 - s1) / -by) % 100 == 0:
            lag = max(lag, np.abs(chain.settled(q, *sampled).q - q).max())
    assert lag < 3e-4


def test_a_straight_chain_in_a_straight_line_is_no_singularity():
    chain = planar(30)
    straight = np.outer(chain.stations, [0.0, 1.0, 0.0])
    found = chain.fitted(np.zeros(30), straight, np.zeros((30, 3)), 1)
    assert found.q == pytest.approx(np.zeros(30), abs=1e-12)
