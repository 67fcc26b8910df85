import numpy as np
import pytest
from telerobot.server.control.spatial import Motion, arriving
from telerobot.server.control.stop.profile import Stop
from telerobot.server.control.stop.trajectory import (
    PositionPlanner,
    TrajectoryError,
    VelocityPlanner,
)

TWO, THREE = slice(0, 2), slice(2, 5)


@pytest.mark.parametrize("value", [1e-8, -1e-8, np.nan, np.inf])
@pytest.mark.parametrize("which", ["dq", "ddq"])
def test_a_motion_stands_only_while_every_rate_is_small(which, value):
    rest = Motion.at_rest(np.ones(3))
    moving = rest._replace(**{which: np.array([0.0, value, 0.0])})
    assert rest.stands()
    assert not moving.stands()
    assert moving.stands(2e-8) == (abs(value) < 2e-8)
    assert not moving.stands(1e-8)
    assert not moving.stands(5e-9)


def moving(*speeds, since_s=0.0):
    """A stop from some speeds, at 2 rad/s² and 20 rad/s³, that goes on since a while."""
    speeds = np.array(speeds)
    planner = VelocityPlanner(np.full(len(speeds), 2.0), np.full(len(speeds), 20.0))
    return planner.stop(Motion(0.5 + speeds, speeds, 0.0 * speeds)).advanced(since_s)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_stop_takes_and_goes_as_far_as_its_bounds_say(sign):
    """With a ramp, a plateau and a ramp: v/a + a/j, and half of that at the speed of the start."""
    stop = moving(sign * 0.5)
    assert stop.duration_s == pytest.approx(0.35)
    start = 0.5 + sign * 0.5
    ends = sorted([start, start + sign * 0.5 * 0.5 * 0.35])
    assert [*stop.low, *stop.high] == pytest.approx(ends)
    np.testing.assert_array_equal(stop.at().dq, [sign * 0.5])
    assert stop.at(0.175).dq == pytest.approx(sign * 0.25)
    assert stop.at(0.35).q == pytest.approx(ends[1] if sign > 0.0 else ends[0])
    assert stop.at(0.351).stands(1e-12)


def test_a_stop_knows_how_much_of_it_is_left():
    stop = moving(0.5)
    assert stop.to_go_s == stop.duration_s
    later = stop.advanced(0.1)
    assert later.to_go_s == pytest.approx(0.25)
    assert not later.finished
    np.testing.assert_array_equal(later.at().q, stop.at(0.1).q)
    np.testing.assert_array_equal(later.at(0.05).q, stop.at(0.1 + 0.05).q)
    np.testing.assert_array_equal(later.postures(np.array([0.05]))[0], stop.at(0.1 + 0.05).q)
    end = stop.advanced(stop.duration_s)
    assert end.finished
    assert end.to_go_s == end.advanced(1.0).to_go_s == 0.0


def test_the_stop_of_what_stands_is_over_and_stays_where_it_is():
    stop = Stop.at_rest(np.array([0.3, -0.2]))
    assert stop.finished
    for bound in (stop.low, stop.high, stop.at(2.0).q):
        np.testing.assert_array_equal(bound, [0.3, -0.2])
    assert stop.at(2.0).stands()


def test_the_stop_of_each_arm_can_be_had_of_that_of_all():
    whole = moving(0.5, -0.3, 0.1, 0.2, -0.6, since_s=0.1)
    for part in (slice(0, 2), slice(2, 5)):
        own = whole.of(part)
        assert (own.duration_s, own.elapsed_s) == (whole.duration_s, 0.1)
        np.testing.assert_array_equal(own.low, whole.low[part])
        np.testing.assert_array_equal(own.high, whole.high[part])
        for t in (0.0, 0.1, 0.3, 1.0):
            for found, wanted in zip(own.at(t), whole.at(t).of(part), strict=True):
                np.testing.assert_array_equal(found, wanted)


def test_each_arm_arrives_on_its_own_and_those_of_a_group_always_together():
    assert arriving(5, (TWO, THREE), ()) == ((TWO, False), (THREE, False))
    (group, together), *others = arriving(5, (TWO, THREE), (np.array([0, 1]),))
    assert group.tolist() == [0, 1]
    assert together is True
    assert others == [(THREE, False)]


def test_an_arm_with_a_group_inside_arrives_together_and_no_freedom_is_left_out():
    assert arriving(5, (TWO, THREE), (np.array([2, 3]),)) == ((TWO, False), (THREE, True))
    assert arriving(5, (TWO, THREE), (np.array([0]),)) == ((TWO, True), (THREE, False))


def test_where_all_arms_are_one_group_or_there_is_one_all_arrive_together():
    assert arriving(5, (), ()) == ()
    assert arriving(5, (slice(0, 5),), ()) == ()
    assert arriving(5, (TWO, THREE), (np.arange(5),)) == ()
    assert arriving(4, (), (np.array([0, 1]), np.array([2, 3]))) == ()


# --- ways to velocities ---------------------------------------------------------------------------

T = 0.3
A, J = np.array([2.0, 3.0, 4.0, 1.5, 5.0]), np.array([20.0, 50.0, 30.0, 40.0, 25.0])
START = Motion(
    np.array([0.1, 0.2, 0.3, 0.4, 0.5]),
    np.array([0.5, -0.4, 0.3, -0.2, 0.1]),
    np.array([0.2, 0.0, -1.0, 0.5, 0.0]),
)
TARGET = np.array([-0.5, 0.6, 0.7, -0.8, 0.3])


def alone(part, together):
    """What some joints would do if there were no others."""
    planner = VelocityPlanner(A[part], J[part])
    return planner.step(START.of(part), TARGET[part], T, together)


@pytest.mark.parametrize("together", [True, False])
def test_each_arm_goes_as_if_there_were_no_other(together):
    planner = VelocityPlanner(A, J, parts=(TWO, THREE))
    for found in (
        planner.step(START, TARGET, T, together),
        planner.step_and_stop(START, TARGET, T, together)[0],
    ):
        for part in (TWO, THREE):
            for one, other in zip(found.of(part), alone(part, together), strict=True):
                np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("together", [True, False])
def test_those_of_a_group_arrive_together_whatever_the_others_do(together):
    planner = VelocityPlanner(A, J, groups=((0, 1),), parts=(TWO, THREE))
    found = planner.step(START, TARGET, T, together)
    for part, own in ((TWO, True), (THREE, together)):
        for one, other in zip(found.of(part), alone(part, own), strict=True):
            np.testing.assert_array_equal(one, other)
    # Without parts, all of them do.
    found = VelocityPlanner(A, J, groups=((0, 1),)).step(START, TARGET, T, together)
    for one, other in zip(found, alone(slice(0, 5), True), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("groups", [(), ((0, 1),)])
@pytest.mark.parametrize("parts", [(), (TWO, THREE)])
def test_a_step_with_its_stop_is_the_step_and_its_stop(groups, parts):
    planner = VelocityPlanner(A, J, groups, parts)
    moved, stop = planner.step_and_stop(START, TARGET, T, True)
    for one, other in zip(moved, planner.step(START, TARGET, T, True), strict=True):
        np.testing.assert_array_equal(one, other)
    for one, other in zip(stop[1:], planner.stop(moved)[1:], strict=True):
        np.testing.assert_array_equal(one, other)
    assert stop.start is moved


def test_a_straight_way_and_its_stop_stay_on_one_line():
    """Whatever the joints' bounds: the slowest decides."""
    line = START._replace(ddq=-0.3 * START.dq)
    moved, stop = VelocityPlanner(A, J).straight(line, 0.3 * START.dq, T)
    times = np.linspace(0.0, stop.to_go_s, 20)
    rates = [moved.dq, moved.ddq, moved.q - line.q, *(stop.postures(times) - line.q)]
    for rate in rates:
        shares = rate / START.dq
        np.testing.assert_allclose(shares, shares[0], atol=1e-12)
    assert np.abs(moved.dq[0]) < np.abs(START.dq[0])
    assert stop.at(stop.duration_s).stands(1e-9)
    # It is to end where it was told to, and not just at rest.
    for _ in range(200):
        line, _ = VelocityPlanner(A, J).straight(line, 0.3 * START.dq, T)
    np.testing.assert_allclose(line.dq, 0.3 * START.dq)


def test_shaped_velocities_are_those_of_a_step_and_change_no_position():
    planner = VelocityPlanner(A, J)
    found, step = planner.shape(START, TARGET, T), planner.step(START, TARGET, T, True)
    assert found.q is START.q
    np.testing.assert_array_equal(found.dq, step.dq)
    np.testing.assert_array_equal(found.ddq, step.ddq)
    rest = Motion.at_rest(np.ones(5))
    assert planner.shape(rest, np.zeros(5), T) is rest
    assert planner.shape(rest, TARGET, T) is not rest


def test_there_is_no_way_from_or_to_what_is_no_number():
    planner, wrong = VelocityPlanner(A, J), np.full(5, np.nan)
    for way in (
        lambda: planner.shape(START, wrong, T),
        lambda: planner.step_and_stop(START, wrong, T, True),
        lambda: planner.straight(START, wrong, T),
    ):
        with pytest.raises(TrajectoryError, match="velocity target"):
            way()
    with pytest.raises(TrajectoryError, match="position target"):
        PositionPlanner(5).plan(START, wrong, (A, A, J))


# --- ways to positions ----------------------------------------------------------------------------

BOUNDS = (np.array([1.0, 1.0]), np.array([2.0, 2.0]), np.array([20.0, 20.0]))
FROM, TO = np.array([0.5, 0.5]), np.array([1.5, 0.1])


def test_a_way_takes_as_long_as_its_bounds_say_and_ends_at_rest_where_it_was_to_go():
    """From rest to rest over d with a plateau of each: d/v + v/a + a/j."""
    way = PositionPlanner(2).plan(Motion.at_rest(FROM), TO, BOUNDS)
    assert way.duration_s == pytest.approx(1.0 + 0.5 + 0.1)
    end = way.at(way.duration_s)
    np.testing.assert_allclose(end.q, TO, atol=1e-12)
    assert end.stands(1e-9)
    times = np.linspace(0.0, way.duration_s, 200)
    speeds = np.array([way.at(t).dq for t in times])
    assert np.abs(speeds).max() == pytest.approx(1.0)
    assert np.abs([way.at(t).ddq for t in times]).max() == pytest.approx(2.0)


def test_a_way_is_a_straight_line_unless_each_is_to_go_its_own():
    times = np.linspace(0.0, 1.6, 30)
    way = PositionPlanner(2).plan(Motion.at_rest(FROM), TO, BOUNDS)
    along = (np.array([way.at(t).q for t in times]) - FROM) / (TO - FROM)
    np.testing.assert_allclose(along[:, 0], along[:, 1], atol=1e-9)
    own = PositionPlanner(2, straight=False).plan(Motion.at_rest(FROM), TO, BOUNDS)
    assert own.duration_s == pytest.approx(way.duration_s)
    quickest = PositionPlanner(1).plan(
        Motion.at_rest(FROM[1:]), TO[1:], tuple(bound[1:] for bound in BOUNDS)
    )
    assert quickest.duration_s < 0.7 * way.duration_s
    assert own.at(quickest.duration_s).q[1] == pytest.approx(TO[1])
    assert abs(way.at(quickest.duration_s).q[1] - TO[1]) > 0.01


@pytest.mark.parametrize("straight", [True, False])
def test_what_a_way_was_planned_from_plans_it_again(straight):
    way = PositionPlanner(2, straight).plan(Motion.at_rest(FROM), TO, BOUNDS)
    plan = way.plan
    again = PositionPlanner(2, plan.straight).plan(plan.start, plan.target, plan.bounds)
    for t in (0.1, 0.5, 1.0):
        np.testing.assert_array_equal(again.at(t).q, way.at(t).q)


def test_a_way_knows_where_on_it_one_is():
    way = PositionPlanner(2).plan(Motion.at_rest(FROM), TO, BOUNDS)
    np.testing.assert_array_equal(way.at().q, FROM)
    later = way.advanced(0.3).advanced(0.2)
    assert later.elapsed_s == 0.5
    assert not later.finished
    for found, wanted in zip(later.at(0.25), way.at(0.75), strict=True):
        np.testing.assert_array_equal(found, wanted)
    for found, wanted in zip(later.now(), later.at(), strict=False):
        np.testing.assert_array_equal(found, wanted)
    np.testing.assert_array_equal(later.at().q, way.at(0.5).q)
    assert way.advanced(way.duration_s).finished
