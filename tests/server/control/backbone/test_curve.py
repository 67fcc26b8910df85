"""A backbone's curve is the one of the paper's integrals, and its rates are its own derivative."""

import numpy as np
import pytest
from laboratory.papers.maze import ENTRANCE, FED, MAZE, S1, SPACE, X, Y
from telerobot.server.control.backbone.curve import Modal, bessel, bow_parameter
from telerobot.server.control.backbone.tunnels import Arcs, Turn, off_centre, passages_meet
from telerobot.server.control.spatial import Pose

STATIONS = np.linspace(0.0, 1.0, 61)

MODES = np.array([1.0, -0.5])
OTHER = MAZE._replace(exterior=Modal(MAZE.exterior.chord, MODES))
"""The same maze with another exterior, whose curvature begins and ends with 0."""


def integral(values, width):
    """Simpson's rule over evenly spaced values (odd number, ...)."""
    return (
        width / 3 * (values[0] + 4 * values[1:-1:2].sum(0) + 2 * values[2:-2:2].sum(0) + values[-1])
    )


def bessel_functions(x):
    J = np.empty(25)
    bessel(x, J)
    return J


@pytest.mark.parametrize("order", range(6))
def test_bessel_functions_are_those_of_their_integral(order):
    t = np.linspace(0.0, np.pi, 2001)
    for x in (0.0, 0.3, 1.2, 2.404, 4.0):
        expected = integral(np.cos(order * t - x * np.sin(t)), t[1]) / np.pi
        assert bessel_functions(x)[order] == pytest.approx(expected, abs=1e-12)


def test_the_bow_s_parameter_solves_equation_20_on_its_branch():
    for ratio in (0.9999999, 0.9, 0.5, 0.4, 1e-3):
        mu = bow_parameter(ratio)
        assert 0.0 < mu < 2.404826
        assert bessel_functions(mu)[0] == pytest.approx(ratio, abs=1e-14)


@pytest.mark.parametrize("s1", S1)
def test_the_exterior_is_the_curve_of_equations_2_and_22(s1):
    a = 2 * np.pi / s1 * bow_parameter(0.4 / s1)
    found = MAZE.exterior.at(s1, STATIONS * s1)[0]
    for station, point in zip(STATIONS * s1, found, strict=True):
        s = np.linspace(0.0, station, 2001)
        theta = a * s1 / (2 * np.pi) * np.sin(2 * np.pi * s / s1)
        x = integral(np.sin(theta), s[1]), integral(np.cos(theta), s[1])
        assert point == pytest.approx([*x, 0.0], abs=1e-11)
    assert found[-1] == pytest.approx([0.0, 0.4, 0.0], abs=1e-14)


@pytest.mark.parametrize("s1", S1)
def test_a_modal_exterior_of_one_mode_is_the_paper_s(s1):
    stations = np.linspace(0.0, s1, 31)
    one = Modal(MAZE.exterior.chord, np.array([1.7]))
    for found, expected in zip(one.at(s1, stations), MAZE.exterior.at(s1, stations), strict=True):
        assert found == pytest.approx(expected, abs=2e-8)


@pytest.mark.parametrize("s1", S1)
def test_a_modal_exterior_meets_the_entrance_and_begins_and_ends_without_curvature(s1):
    dense = np.linspace(0.0, s1, 4001)
    points = OTHER.exterior.at(s1, dense)[0]
    assert points[-1] == pytest.approx([0.0, 0.4, 0.0], abs=1e-7)
    ways = np.diff(points, axis=0)
    assert np.linalg.norm(ways, axis=1) == pytest.approx(dense[1], rel=1e-5)
    angle = np.arctan2(ways[:, 0], ways[:, 1])
    middle = (dense[1:] + dense[:-1]) / (2 * s1)
    shape = np.sin(2 * np.pi * middle) - 0.5 * np.sin(4 * np.pi * middle)
    assert angle == pytest.approx(shape * (angle @ shape / (shape @ shape)), abs=1e-5)
    assert abs(angle[1] - angle[0]) < 1e-4 * np.abs(angle).max()


def test_modes_that_do_not_bow_out_so_far_are_refused():
    far = MAZE.exterior.chord._replace(h=0.05)
    with pytest.raises(ValueError, match="the modes bow out by less than that"):
        Modal(far, np.ones(6)).at(1.4, STATIONS)


@pytest.mark.parametrize("curve", [MAZE, SPACE, OTHER, FED, OTHER._replace(fed=0.3, longest=1.0)])
@pytest.mark.parametrize("s1", [0.97, 0.8, 0.6, 0.44, 0.41])
def test_rates_are_the_derivative_of_the_curve(curve, s1):
    step = 1e-6
    stations = 0.0013 + 0.9974 * STATIONS  # off the jumps of curvature
    before, after = (curve.at(s1 + by, stations).points for by in (-step, step))
    assert curve.at(s1, stations).rates == pytest.approx((after - before) / (2 * step), abs=2e-7)


@pytest.mark.parametrize("exterior", [MAZE.exterior, OTHER.exterior])
@pytest.mark.parametrize("s1", [0.97, 0.8, 0.6, 0.3])
def test_a_base_that_is_fed_advances_along_the_chord_and_the_tunnel_stays(exterior, s1):
    curve = FED._replace(exterior=exterior)
    dense = np.linspace(0.0, 1.0, 4001)
    points = curve.at(s1, dense).points
    base = np.array([0.0, 0.3 * (1.0 - s1), 0.0])
    assert points[0] == pytest.approx(base, abs=1e-15)
    ways = np.diff(points, axis=0)
    assert np.linalg.norm(ways, axis=1) == pytest.approx(dense[1], rel=1e-5)
    inside = dense[dense > s1] - s1
    assert points[dense > s1] == pytest.approx(MAZE.arcs.at(inside)[0], abs=1e-15)
    # One that stands there is where it is at that free length.
    assert curve.from_foot(base).at(s1, dense).points == pytest.approx(points, abs=1e-15)


def test_along_the_bow_s_parameter_rates_stay_finite_where_the_exterior_is_straight():
    bow, stations, step = MAZE.exterior, STATIONS * 0.4, 1e-6
    points, rates, ds1 = bow.along(0.0, stations)
    assert points == pytest.approx(np.outer(stations, Y), abs=1e-15)
    assert ds1 == 0.0
    assert rates == pytest.approx((bow.along(step, stations)[0] - points) / step, abs=1e-6)
    assert np.abs(rates).max() < 0.4
    assert np.abs(bow.at(0.4 + 1e-9, stations)[1]).max() > 100.0


def test_an_exterior_shorter_than_its_chord_is_refused():
    with pytest.raises(ValueError, match=r"free length 0\.39 m: must be above 0\.4 m"):
        MAZE.at(0.39, STATIONS)


def test_arcs_end_where_semicircles_do():
    radius = 0.2 / np.pi
    points, tangents = MAZE.arcs.at(np.array([0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 0.7]))
    across = [0, -radius, -2 * radius, -3 * radius, -4 * radius, -6 * radius, -6 * radius]
    ahead = [0.4, 0.4 + radius, 0.4, 0.4 - radius, 0.4, 0.4, 0.3]
    assert points == pytest.approx(np.column_stack((across, ahead, np.zeros(7))), abs=1e-14)
    assert tangents[[0, 2, 4, 6]] == pytest.approx(np.array([Y, -Y, Y, -Y]), abs=1e-14)
    assert tangents[1] == pytest.approx(-X, abs=1e-14)


def test_a_tunnel_may_climb_straight_up_where_the_paper_s_torsion_is_singular():
    arcs = Arcs.from_entrance(Pose.identity(), [Turn(0.3, 0.0, np.pi / 2), Turn(0.2, np.pi / 2)])
    points, tangents = arcs.at(np.array([0.3, 0.5]))
    r, s = 0.6 / np.pi, 0.4 / np.pi
    assert points == pytest.approx(np.array([[r, 0, r], [r, s, r + s]]), abs=1e-14)
    assert tangents == pytest.approx(np.array([[0, 0, 1], [0, 1, 0]]), abs=1e-14)


def test_the_paper_s_spatial_curve_is_met_by_short_segments():
    # Eqs. 5 and 6 with constant quasi-curvature and quasi-torsion.
    kappa, torsion, length, n = 3.0, 2.0, 0.6, 500
    s = np.linspace(0.0, length, 4001)
    K, T = kappa * s, torsion * s
    x = np.stack((np.sin(K) * np.cos(T), np.cos(K) * np.cos(T), np.sin(T)), axis=1)
    expected = integral(x, s[1])
    turns, R = [], Pose.from_xyz_rpy((0, 0, 0), (0, 0, np.pi / 2)).R
    for tangent in x[8::8]:
        towards = R.T @ tangent
        angle = np.arctan2(np.hypot(*towards[1:]), towards[0]) / np.hypot(*towards[1:])
        turns.append(Turn(length / n, angle * towards[1], angle * towards[2]))
        R = Arcs.from_entrance(Pose(R, np.zeros(3)), turns[-1:]).end.R
    arcs = Arcs.from_entrance(Pose.from_xyz_rpy((0, 0, 0), (0, 0, np.pi / 2)), turns)
    assert arcs.at(np.array([length]))[0][0] == pytest.approx(expected, abs=1e-6)


def helix(kappa, tau, length):
    return Turn(length, kappa * length, 0.0, tau * length)


@pytest.mark.parametrize("tau", [2.5, -2.5, 1e-7, 0.0])
def test_a_segment_with_torsion_is_a_circular_helix(tau):
    kappa, length = 4.0, 0.75
    s = np.linspace(0.0, length, 9)
    points, tangents = Arcs.from_entrance(Pose.identity(), [helix(kappa, tau, length)]).at(s)
    w = np.hypot(kappa, tau)
    r, c = kappa / w**2, tau / w**2
    # Circular helix whose first tangent is x and first normal y.
    axis = np.array([tau, 0.0, kappa]) / w
    round_ = np.array([kappa, 0.0, -tau]) / w
    expected = (
        np.outer(r * np.sin(w * s), round_)
        + np.outer(r * (1 - np.cos(w * s)), Y)
        + np.outer(c * w * s, axis)
    )
    assert points == pytest.approx(expected, abs=1e-14)
    assert tangents[0] == pytest.approx(X, abs=1e-14)


def test_curvature_and_torsion_are_those_of_the_frenet_formulas():
    # Climbs while it bends, and begins where another piece has ended.
    first, kappa, tau, length = Turn(0.2, 0.7, -0.4, 0.9), 5.0, -3.0, 0.6
    turn = Turn(length, kappa * length * 0.6, kappa * length * 0.8, tau * length)
    arcs = Arcs.from_entrance(Pose.from_xyz_rpy((0.1, 0.4, -0.2), (0.3, -0.9, 1.4)), [first, turn])
    s = 0.2 + 0.5 * length * (1.0 - np.cos(np.pi * (np.arange(24) + 0.5) / 24))
    points, tangents = arcs.at(s)
    x, t = (np.polynomial.Chebyshev.fit(s, of, 23) for of in (points[:, 0], tangents[:, 0]))
    assert x.deriv()(s) == pytest.approx(t(s), abs=1e-12)
    along = [np.polynomial.Chebyshev.fit(s, of, 23) for of in tangents.T]
    middle = np.linspace(0.25, 0.75, 11)
    T, dT, ddT = (np.array([f.deriv(m)(middle) for f in along]).T for m in (0, 1, 2))
    curvature = np.linalg.norm(dT, axis=1)
    torsion = np.sum(np.cross(T, dT) * ddT, axis=1) / curvature**2
    assert curvature == pytest.approx(np.full(11, kappa), abs=1e-9)
    assert torsion == pytest.approx(np.full(11, tau), abs=1e-9)


def test_a_helix_in_pieces_is_the_whole_one():
    whole, part = helix(4.0, 2.5, 0.75), helix(4.0, 2.5, 0.25)
    s = np.linspace(0.0, 0.9, 31)  # and the straight line beyond
    one, three = (Arcs.from_entrance(ENTRANCE, turns).at(s) for turns in ([whole], [part] * 3))
    for found, expected in zip(one, three, strict=True):
        assert found == pytest.approx(expected, abs=1e-14)


def test_many_short_arcs_whose_planes_turn_come_to_the_helix_with_the_square_of_their_number():
    # Arcs carry their frame along without a turn about the tangent; the normal turns against it.
    kappa, tau, length = 4.2, 2.0, 0.6
    (end,), _ = Arcs.from_entrance(ENTRANCE, [helix(kappa, tau, length)]).at(np.array([length]))
    off = []
    for n in (50, 100, 200, 400):
        ds = length / n
        angles = tau * ds * (np.arange(n) + 0.5)
        bends, climbs = kappa * ds * np.cos(angles), kappa * ds * np.sin(angles)
        turns = [Turn(ds, bend, climb) for bend, climb in zip(bends, climbs, strict=True)]
        off.append(np.linalg.norm(Arcs.from_entrance(ENTRANCE, turns).end.p - end))
    assert np.array(off[:-1]) / off[1:] == pytest.approx(np.full(3, 4.0), rel=1e-3)
    assert 1e-9 < off[-1] < 1e-6


def test_a_roll_of_a_straight_piece_turns_what_comes_after_it():
    arcs = Arcs.from_entrance(
        Pose.identity(), [Turn(0.3, roll=np.pi / 2), Turn(0.2, bend=np.pi / 2)]
    )
    points, tangents = arcs.at(np.array([0.15, 0.3, 0.5]))
    assert points[:2] == pytest.approx(np.outer([0.15, 0.3], X), abs=1e-15)
    assert tangents[2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-14)


def test_distance_to_the_centre_line_is_that_of_a_dense_search():
    rng = np.random.default_rng(3)
    wound = [helix(kappa, tau, 0.6) for kappa, tau in ((5.0, 3.0), (2.0, -5.0))]
    for arcs in (MAZE.arcs, SPACE.arcs, Arcs.from_entrance(ENTRANCE, wound)):
        end = arcs.length
        dense = arcs.at(np.linspace(0.0, end, 200_001))[0]
        for depth in rng.uniform(0.05, end - 0.05, 20):
            point = arcs.at(np.array([depth]))[0][0] + rng.normal(0.0, 0.008, 3)
            upto = np.array([len(arcs.turning) - 1])
            off, which = off_centre(arcs[:], point[None], np.array([depth]), 0.05, upto)
            assert which == 0
            assert off == pytest.approx(np.linalg.norm(dense - point, axis=1).min(), abs=1e-6)


def test_a_foot_on_a_helix_is_the_nearest_of_all_of_its_turns():
    # Seen from its axis, a flat helix is nearly as near everywhere: many feet, of which one counts.
    arcs = Arcs.from_entrance(ENTRANCE, [helix(7.0, 0.8, 0.44)] * 4)
    dense, upto = arcs.at(np.linspace(0.0, arcs.length, 400_001))[0], np.array([4])
    centre = dense.mean(axis=0)
    for aside in np.random.default_rng(5).normal(0.0, 0.08, (40, 3)):
        point = centre + aside
        off, _ = off_centre(arcs[:], point[None], np.array([0.88]), 0.88, upto)
        assert off == pytest.approx(np.linalg.norm(dense - point, axis=1).min(), abs=1e-6)


def test_passages_that_meet_are_those_of_a_dense_search():
    rng, bound, step = np.random.default_rng(7), 0.06, 1e-3
    found = []
    for _ in range(60):
        turns = [
            Turn(length, *(rng.uniform(-1.0, 1.0, 3) * (3.1, 3.1, 1.5)))
            for length in rng.uniform(0.15, 0.4, 4)
        ]
        arcs = Arcs.from_entrance(ENTRANCE, turns)
        s = np.arange(0.0, arcs.length, step)
        points = arcs.at(s)[0]
        apart = np.linalg.norm(points[:, None] - points, axis=2)
        apart[np.abs(np.subtract.outer(s, s)) < np.pi * 0.03 + step] = np.inf
        off, *at = passages_meet(arcs[:], np.array([[0.0, arcs.length]]), np.pi * 0.03, bound, 6e-4)
        if apart.min() > bound + step:
            assert off == np.inf
        elif apart.min() < bound - step:
            assert off == pytest.approx(apart.min(), abs=step)
            assert np.linalg.norm(np.subtract(*arcs.at(np.array(at))[0])) == pytest.approx(off)
        found.append(off < np.inf)
    assert 10 < sum(found) < 50


def test_points_in_the_open_are_not_held_against_the_tunnel():
    upto = np.array([len(MAZE.arcs.turning) - 1])
    before = ENTRANCE.p - 0.01 * Y + 0.05 * X
    assert off_centre(MAZE.arcs[:], before[None], np.array([-0.01]), 0.05, upto)[1] == -1
    beyond = MAZE.arcs.at(np.array([0.65]))[0]
    assert off_centre(MAZE.arcs[:], beyond, np.array([0.65]), 0.05, upto - 1)[1] == -1
