"""Joints that mean something only together stop together, along a straight line."""

import numpy as np
import pytest
from telerobot.server.control.spatial import Motion
from telerobot.server.control.stop.profile import stopping, stopping_in_proportion
from telerobot.server.control.stop.trajectory import VelocityPlanner

N = 4


@pytest.fixture
def planner():
    """Four joints; the first three stop in proportion, the second is by far the slowest."""
    return VelocityPlanner(np.array([8.0, 2.0, 8.0, 8.0]), np.full(N, 100.0), groups=((0, 1, 2),))


def test_a_group_stops_in_proportion_and_as_quickly_as_its_slowest_joint_can(planner):
    start = Motion(np.zeros(N), np.array([0.5, -0.4, 0.2, 0.5]), np.zeros(N))
    stop = planner.stop(start)
    for t in np.linspace(0.0, stop.to_go_s, 50):
        left = stop.at(t).dq / start.dq
        np.testing.assert_allclose(left[:3], left[1], atol=1e-9)
    # The jerk of the first joint decides with the acceleration of the second: a little later than
    # the second alone.
    alone = VelocityPlanner(np.array([2.0]), np.array([100.0])).stop(
        Motion(np.zeros(1), start.dq[1:2], np.zeros(1))
    )
    assert alone.to_go_s <= stop.to_go_s < 1.15 * alone.to_go_s
    # The fourth belongs to nobody, and is at rest long before.
    late = stop.at(0.8 * stop.to_go_s).dq
    assert abs(late[3]) < 1e-12 < abs(late[0])


def test_where_joints_of_a_group_already_change_apart_they_stop_inside_their_bounds(planner):
    rng = np.random.default_rng(3)
    A, J = np.array([8.0, 2.0, 8.0, 8.0]), np.full(N, 100.0)
    for _ in range(200):
        start = Motion(np.zeros(N), rng.uniform(-1, 1, N), rng.uniform(-A, A))
        stop = planner.stop(start)
        times = np.linspace(0.0, stop.to_go_s, 200)
        ddq = np.array([stop.at(t).ddq for t in times])
        assert (np.abs(ddq) <= A * (1 + 1e-8)).all()
        assert (np.abs(np.diff(ddq, axis=0)) <= J * np.diff(times)[:, None] + 1e-7).all()
        assert stop.at(stop.to_go_s).stands(1e-9)


def test_a_joint_belongs_to_one_group_at_most():
    ones = np.ones(3)
    with pytest.raises(ValueError, match="in two"):
        VelocityPlanner(ones, ones, groups=((0, 1), (1, 2)))
    with pytest.raises(ValueError, match="there are 3"):
        VelocityPlanner(ones, ones, groups=((0, 3),))


def lasts(phases):
    return float(phases[0].sum(axis=0).max())


def drawn_groups(count, n=3):
    rng = np.random.default_rng(8)
    for _ in range(count):
        A, J = rng.uniform(0.5, 5.0, n), rng.uniform(5.0, 100.0, n)
        dq, ddq = rng.normal(size=n), A * rng.uniform(-1.0, 1.0, n) * rng.choice([0.0, 1.0])
        yield dq, ddq, A, J, stopping(dq, ddq, A, J)


def test_of_the_stops_that_have_the_shape_of_one_joints_the_shortest_is_taken():
    differ = 0
    for dq, ddq, A, J, own in drawn_groups(60):
        best = lasts(stopping_in_proportion(dq, ddq, A, J, own))
        each = [
            lasts(stopping_in_proportion(dq, ddq, A, J, np.repeat(own[:, :, k : k + 1], 3, axis=2)))
            for k in range(3)
        ]
        assert best == pytest.approx(min(each), rel=1e-12)
        differ += max(each) > 1.05 * min(each)
    assert differ > 20


def test_the_stop_is_no_longer_than_its_shape_needs():
    """Where it is stretched: a thousandth shorter, some joint would exceed a bound."""
    stretched = 0
    for dq, ddq, A, J, own in drawn_groups(60):
        phases = stopping_in_proportion(dq, ddq, A, J, own)
        assert phases[0].sum(axis=0).min() == pytest.approx(lasts(phases), rel=1e-12)
        longer = lasts(phases) > 1.11 * lasts(own)  # than with ramps for all
        stretched += longer
        for part, inside in ((1.0, True), (0.999, False)) if longer else ((1.0, True),):
            up, hold, down = part * phases[0, 1:, 0]
            # The velocity's end: dq + up (ddq + held) / 2 + hold held + down held / 2 = 0.
            held = -(dq + 0.5 * up * ddq) / (0.5 * up + hold + 0.5 * down)
            kept = (np.abs(held) <= np.maximum(A, np.abs(ddq)) * (1.0 + 1e-8)).all()
            kept &= (np.abs(held - ddq) <= J * up * (1.0 + 1e-8)).all()
            kept &= (np.abs(held) <= J * down * (1.0 + 1e-8)).all()
            assert kept == inside
    assert stretched > 8


def kept(dq, ddq, A, J, up, hold, down):
    """Whether ramps and a hold of these times bring all to rest inside their bounds."""
    held = -(dq + 0.5 * up * ddq) / (0.5 * up + hold + 0.5 * down)
    slack = 1.0 + 1e-9
    return (
        (np.abs(held) <= np.maximum(A, np.abs(ddq)) * slack).all()
        and (np.abs(held - ddq) <= J * up * slack).all()
        and (np.abs(held) <= J * down * slack).all()
    )


def shapes_that_fit(dq, ddq, A, J, own):
    """The times of the stops that have the shape of each of the three slowest, to rounding."""
    every = own[0].sum(axis=0)
    for k in np.argsort(-every, kind="stable")[:3]:
        if every[k] < 1e-12:
            return
        least = 0.05 * every[k]
        shape = np.array([max(own[0, :2, k].sum(), least), own[0, 2, k], max(own[0, 3, k], least)])
        long = next(2.0**i for i in range(20) if kept(dq, ddq, A, J, *2.0**i * shape))
        short = 0.5 * long if long > 1.0 else 1.0
        for _ in range(60):
            middle = 0.5 * (short + long)
            fits = kept(dq, ddq, A, J, *middle * shape)
            short, long = (short, middle) if fits else (middle, long)
        yield long * shape


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_the_stop_is_the_shortest_shape_that_fits_to_a_ten_thousandth(n):
    rng = np.random.default_rng(12)
    stretched = 0
    for _ in range(60):
        A, J = rng.uniform(0.5, 5.0, n), rng.uniform(5.0, 100.0, n)
        dq = rng.normal(size=n) * rng.choice([0.0, 1.0, 1.0], n)
        ddq = A * rng.uniform(-1.5, 1.5, n) * rng.choice([0.0, 1.0])
        if not (dq.any() or ddq.any()):
            continue
        own = stopping(dq, ddq, A, J)
        phases = stopping_in_proportion(dq, ddq, A, J, own)
        assert (phases[0, 0] == 0.0).all()
        assert (phases[0] == phases[0, :, :1]).all()
        fitting = list(shapes_that_fit(dq, ddq, A, J, own))
        found = phases[0, 1:, 0]
        assert found.sum() <= min(map(sum, fitting)) * (1.0 + 1.001 * 2.0**-14)  # fourteen halvings
        scales = [found.sum() / each.sum() for each in fitting]
        near = zip(scales, fitting, strict=True)
        assert any(np.allclose(found, x * each, rtol=1e-9, atol=1e-12) for x, each in near)
        scale = max(scales)
        assert scale >= 1.0 - 1e-9
        stretched += scale > 1.0 + 1e-9
        v, a = dq, ddq
        for seconds, jerk in zip(phases[0, :, 0], phases[1], strict=True):
            v, a = v + seconds * (a + 0.5 * seconds * jerk), a + seconds * jerk
        np.testing.assert_allclose(v, 0.0, atol=1e-9)
        np.testing.assert_allclose(a, 0.0, atol=1e-9)
    assert stretched > 5 or n == 1


@pytest.mark.parametrize(
    ("up", "down", "A", "J"), [(1.0, 1.0, 2.0, 90.0), (1.0, 2.0, 90.0, 2.0), (2.0, 1.0, 90.0, 2.0)]
)
def test_a_bound_is_kept_to_rounding_and_what_lies_beyond_is_not(up, down, A, J):
    """The greatest acceleration, and the jerk of either ramp; all numbers are whole in binary."""
    own = np.zeros((2, 4, 1))
    own[0, 1:, 0] = up, 4.0 - 0.5 * (up + down), down  # so that held is a quarter of the velocity
    for beyond, stretched in ((1.0 + 1e-9, False), (np.nextafter(1.0 + 1e-9, 2.0), True)):
        dq = np.array([4.0 * 2.0 * beyond])
        phases = stopping_in_proportion(dq, np.zeros(1), np.array([A]), np.array([J]), own)
        assert (lasts(phases) > lasts(own)) == stretched


def test_a_group_that_stands_has_no_way_to_go():
    for dq, ddq, stands in ((0.0, 0.0, True), (1.0, 0.0, False), (0.0, 1.0, False)):
        planner = VelocityPlanner(np.full(2, 5.0), np.full(2, 50.0), groups=((0, 1),))
        stop = planner.stop(Motion(np.ones(2), np.array([0.0, dq]), np.array([0.0, ddq])))
        assert (stop.duration_s == 0.0) == stands
        assert np.isfinite(stop.phases).all()


def test_one_that_stands_in_a_group_stays_where_it_is():
    planner = VelocityPlanner(np.full(3, 5.0), np.full(3, 50.0), groups=((0, 1, 2),))
    stop = planner.stop(Motion(np.ones(3), np.array([0.0, 0.5, 0.0]), np.zeros(3)))
    for joint in (0, 2):
        assert stop.low[joint] == stop.high[joint] == 1.0
    alone = VelocityPlanner(np.full(1, 5.0), np.full(1, 50.0)).stop(
        Motion(np.ones(1), np.array([0.5]), np.zeros(1))
    )
    assert stop.duration_s == pytest.approx(alone.duration_s)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_acceleration_beyond_its_bound_is_its_bound(side):
    """As after the speed was reduced: the stop may go on with it, and not with more."""
    dq, ddq = side * np.array([-2.0, 0.1]), side * np.array([4.0, 0.0])
    A, J = np.array([2.0, 2.0]), np.array([50.0, 50.0])
    phases = stopping_in_proportion(dq, ddq, A, J, stopping(dq, ddq, A, J))
    held = ddq + phases[1, 1] * phases[0, 1]
    assert (np.abs(held) <= np.maximum(A, np.abs(ddq)) * (1 + 1e-8)).all()
    other = stopping_in_proportion(-dq, -ddq, A, J, stopping(-dq, -ddq, A, J))
    np.testing.assert_allclose(other * [[[1.0]], [[-1.0]]], phases, rtol=1e-9)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_there_is_no_stop_of_what_is_no_number_nor_under_a_bound_of_nothing(value):
    dq, A, J = np.array([0.5, 0.4]), np.ones(2), np.full(2, 20.0)
    own = stopping(dq, np.zeros(2), A, J)
    with pytest.raises(ValueError, match="no stop in proportion"):
        stopping_in_proportion(np.array([0.5, value]), np.zeros(2), A, J, own)
    with pytest.raises(ValueError, match="no stop in proportion"):
        stopping_in_proportion(dq, np.zeros(2), np.array([1.0, 1e-9]), J, own)


def test_a_stretch_is_halved_fourteen_times_and_no_more():
    """Each halving is time of the tick; whole numbers of 2⁻¹⁴, and the least above four thirds."""
    own = np.zeros((2, 4, 1))
    own[0, 1:, 0] = 1.0, 3.0, 1.0  # held is a quarter of the velocity
    dq = np.array([4.0 / 3.0 * 4.0 * 2.0])
    phases = stopping_in_proportion(dq, np.zeros(1), np.array([2.0]), np.array([90.0]), own)
    assert lasts(phases) == pytest.approx(5.0 * 21846 / 2**14, rel=1e-12)


@pytest.mark.parametrize(("seconds", "found"), [(1e-12, True), (0.99e-12, False)])
def test_a_stop_that_lasts_less_than_rounding_lends_no_shape(seconds, found):
    own = np.zeros((2, 4, 1))
    own[0, 1, 0] = seconds
    given = np.array([1e-13]), np.zeros(1), np.ones(1), np.array([1e14]), own
    if found:
        assert lasts(stopping_in_proportion(*given)) == pytest.approx(1.05e-12)
    else:
        with pytest.raises(ValueError, match="no stop in proportion"):
            stopping_in_proportion(*given)


@pytest.mark.parametrize(("times", "found"), [(5e5, True), (1.04e6, False)])
def test_a_stop_in_proportion_lasts_at_most_a_million_times_longer(times, found):
    """Of the first joint's shape, by a bound of the second, at a stretch that is halved to."""
    dq, A, J = np.array([0.5, 0.5]), np.ones(2), np.full(2, 20.0)
    own = np.repeat(stopping(dq, np.zeros(2), A, J)[:, :, :1], 2, axis=2)
    up, hold, down = own[0, 1:, 0]
    A[1] = 0.5 / (0.5 * up + hold + 0.5 * down) / times
    if found:
        phases = stopping_in_proportion(dq, np.zeros(2), A, J, own)
        assert lasts(phases) == pytest.approx(times * lasts(own), rel=1e-4)
    else:
        with pytest.raises(ValueError, match="no stop in proportion"):
            stopping_in_proportion(dq, np.zeros(2), A, J, own)
