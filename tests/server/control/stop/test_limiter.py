import numpy as np
import pytest
from telerobot.server.control.spatial import Motion
from telerobot.server.control.stop.limiter import Commanded, Limiter
from telerobot.server.control.stop.trajectory import VelocityPlanner

from ..bounds import bounded

T = 0.01
N = 4


def strengths(rng):
    A = 10 ** rng.uniform(0.3, 1.5, N)
    return rng.uniform(0.3, 4.0, N), A, A * 10 ** rng.uniform(1, 2.3, N)


def hostile(rng, V, steps):
    """Targets at full speed: constant, reversing, noise, and single joints, mixed."""
    target = np.zeros(N)
    for _ in range(steps):
        match rng.integers(40):
            case 0:
                target = rng.choice([-1.0, 1.0], N) * V
            case 1:
                target = -target
            case 2:
                target = np.where(rng.random(N) < 0.5, 0.0, target)
            case 3 | 4 | 5:
                target = rng.uniform(-V, V)
        yield target


@pytest.mark.parametrize("groups", [(), ((0, 2, 3),), ((0, 1), (2, 3))])
@pytest.mark.parametrize("seed", range(6))
def test_no_hostile_target_takes_a_joint_beyond_any_bound(seed, groups):
    rng = np.random.default_rng(seed)
    V, A, J = strengths(rng)
    upper = rng.uniform(0.2, 1.5, N)
    limiter = Limiter(bounded(-upper, upper, A, J), T, groups)
    motion = Motion.at_rest(np.zeros(N))
    stop, sent = limiter.verified_stop(motion), [motion.q] * 3
    taken_over = 0
    for target in hostile(rng, V, 1500):
        limited = limiter.step(motion, stop, target, 1.0)
        motion, stop = limited.motion, limited.stop
        taken_over += limited.stopped
        sent.append(motion.q)
        # The way to rest that is held starts here and stays inside, looked at finely.
        np.testing.assert_allclose(stop.at().q, motion.q, atol=1e-12)
        if len(sent) % 10 == 0:
            way = np.array([stop.at(t).q for t in np.linspace(0, stop.to_go_s, 20)])
            assert (np.abs(way) <= upper + 1e-9).all()
    q = np.array(sent)
    assert (np.abs(q) <= upper + 1e-9).all()
    for order, bound in enumerate((V, A, J), start=1):
        assert (np.abs(np.diff(q, order, axis=0)) <= bound * T**order * (1 + 1e-6) + 1e-12).all()
    # The run went where it hurts: into its bounds, as hard as the joints can.
    assert taken_over > 0
    assert (np.abs(q).max(axis=0) > 0.9 * upper).any()
    assert (np.abs(np.diff(q, 3, axis=0)).max(axis=0) > 0.9 * J * T**3).any()


@pytest.mark.parametrize("seed", range(3))
def test_changing_the_speed_factor_in_full_motion_breaks_no_bound(seed):
    rng = np.random.default_rng(seed)
    V, A, J = strengths(rng)
    upper = rng.uniform(0.2, 1.5, N)
    limiter = Limiter(bounded(-upper, upper, A, J), T)
    motion = Motion.at_rest(np.zeros(N))
    stop, sent, factor = limiter.verified_stop(motion), [motion.q] * 3, 1.0
    for target in hostile(rng, V, 800):
        if rng.random() < 0.05:
            factor = rng.choice([0.05, 0.3, 1.0])
        limited = limiter.step(motion, stop, factor * target, factor)
        motion, stop = limited.motion, limited.stop
        sent.append(motion.q)
    q = np.array(sent)
    assert (np.abs(q) <= upper + 1e-9).all()
    for order, bound in enumerate((V, A, J), start=1):
        assert (np.abs(np.diff(q, order, axis=0)) <= bound * T**order * (1 + 1e-6) + 1e-12).all()


def one_joint(upper=1.0):
    return Limiter(bounded(-1.0, upper, 5.0, 100.0), T)


def test_any_moment_is_a_good_one_to_stop():
    limiter = one_joint()
    motion = Motion.at_rest(np.zeros(1))
    stop = limiter.verified_stop(motion)
    for _ in range(40):
        motion, stop, *_ = limiter.step(motion, stop, np.array([2.0]), 1.0)
    expected_end = stop.at(stop.to_go_s).q
    for _ in range(1000):
        motion, stop, stopped, _ = limiter.go_on(stop)
        assert stopped
    assert not motion.dq.any()
    assert not motion.ddq.any()
    np.testing.assert_allclose(motion.q, expected_end, atol=1e-12)


def test_where_every_attempt_would_break_a_bound_the_stored_stop_goes_on():
    motion = Motion(np.zeros(1), np.array([0.5]), np.zeros(1))
    end = float(VelocityPlanner(np.array([5.0]), np.array([100.0])).stop(motion).high[0])
    limiter = one_joint(upper=end + 1e-3)
    held = limiter.verified_stop(motion)
    limited = limiter.step(motion, held, np.array([3.0]), 1.0)
    assert limited.stopped
    for found, stored in zip(limited.motion, held.at(T), strict=True):
        np.testing.assert_array_equal(found, stored)
    # It goes on for as long as the target does not relent, and ends inside.
    for _ in range(100):
        limited = limiter.step(limited.motion, limited.stop, np.array([3.0]), 1.0)
    assert limited.motion.q[0] <= end + 1e-3


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_start_beyond_a_bound_can_be_backed_out_of_and_gets_no_worse(side):
    limiter = one_joint()
    start = Motion.at_rest(np.array([1.1 * side]))
    motion, stop = start, limiter.verified_stop(start)
    for _ in range(100):
        motion, stop, *_ = limiter.step(motion, stop, np.array([2.0 * side]), 1.0)
        assert side * motion.q[0] <= 1.1 + 1e-12
    for _ in range(100):
        motion, stop, stopped, _ = limiter.step(motion, stop, np.array([-1.0 * side]), 1.0)
        assert not stopped
    assert side * motion.q[0] < 0.5
    # Once inside, the bound holds as for anybody.
    for _ in range(300):
        motion, stop, *_ = limiter.step(motion, stop, np.array([2.0 * side]), 1.0)
        assert side * motion.q[0] <= 1.0 + 1e-9


def test_half_way_back_from_beyond_a_bound_is_not_given_up_again():
    limiter = one_joint()
    motion = Motion.at_rest(np.array([1.2]))
    stop = limiter.verified_stop(motion)
    for _ in range(20):
        motion, stop, *_ = limiter.step(motion, stop, np.array([-0.5]), 1.0)
    motion, stop = Motion.at_rest(motion.q), limiter.verified_stop(Motion.at_rest(motion.q))
    reached = float(motion.q[0])
    assert 1.0 < reached < 1.2
    for _ in range(100):
        motion, stop, *_ = limiter.step(motion, stop, np.array([0.5]), 1.0)
        assert motion.q[0] <= reached + 1e-12


def test_rest_that_is_asked_for_at_rest_changes_nothing():
    limiter = one_joint()
    motion = Motion.at_rest(np.array([0.3]))
    stop = limiter.verified_stop(motion)
    limited = limiter.step(motion, stop, np.zeros(1), 1.0)
    assert limited.motion is motion
    assert not limited.stopped


def test_a_joint_whose_range_is_far_from_zero_moves_as_freely():
    limiter = Limiter(bounded(2.0, 3.0, 5.0, 100.0), T)
    motion = Motion.at_rest(np.array([2.2]))
    stop = limiter.verified_stop(motion)
    for _ in range(300):
        motion, stop, *_ = limiter.step(motion, stop, np.array([0.5]), 1.0)
        assert motion.q[0] <= stop.high[0] <= 3.0
    assert motion.q[0] > 2.9


def test_a_judge_has_a_say_and_news_that_worsens_the_stored_stop_is_told():
    limiter = one_joint()
    motion = Motion.at_rest(np.zeros(1))
    stop = limiter.verified_stop(motion)
    for _ in range(40):
        motion, stop, *_ = limiter.step(motion, stop, np.array([2.0]), 1.0, lambda _: 0.0)
    # Nothing but the stored stop is good enough.
    held = stop
    limited = limiter.step(motion, stop, np.array([2.0]), 1.0, lambda s: float(s is not held))
    assert limited.stopped
    assert not limited.worsened
    # Now nothing is, and the least bad is taken, whichever that is.
    limited = limiter.step(motion, stop, np.array([2.0]), 1.0, lambda s: 0.5 + (s is held))
    assert (limited.worsened, limited.stopped) == (True, False)
    limited = limiter.step(motion, stop, np.array([2.0]), 1.0, lambda s: 1.5 - (s is held))
    assert (limited.worsened, limited.stopped) == (True, True)


@pytest.mark.parametrize("factor", [0.1, 0.5, 1.0])
def test_reduced_speed_reduces_the_acceleration_and_not_the_jerk(factor):
    """At the plateau the acceleration is the part of its bound; on the way there, all the jerk."""
    limiter = one_joint(upper=100.0)
    for again in (factor, 1.0, factor):  # the one before leaves nothing behind
        motion = Motion.at_rest(np.zeros(1))
        stop = limiter.verified_stop(motion)
        for tick in range(40):
            motion, stop, *_ = limiter.step(motion, stop, np.array([50.0]), again)
            if tick == 0:
                expected = min(0.9999 * 100.0 * T, again * 0.9999 * 5.0)
                assert motion.ddq == pytest.approx(expected)
    assert motion.ddq == pytest.approx(factor * 0.9999 * 5.0)
    # The stop that is held takes all of it, however slow the arm is to be.
    fast = one_joint(upper=100.0)
    assert limiter.verified_stop(motion).duration_s == fast.verified_stop(motion).duration_s
    assert stop.duration_s == fast.verified_stop(motion).duration_s


def test_what_is_faster_than_a_reduced_speed_allows_slows_down_with_all_of_the_acceleration():
    """At 2 rad/s one joint is told that a tenth of 3 rad/s is the most from now on."""
    V = np.array([3.0, 3.0])
    limiter = Limiter(bounded(-9.0, np.full(2, 9.0), 5.0, 100.0)._replace(velocity=V), T)
    motion = Motion(np.zeros(2), np.array([2.0, 0.0]), np.zeros(2))
    stop, slow_s = limiter.verified_stop(motion), None
    for tick in range(200):
        motion, stop, *_ = limiter.step(motion, stop, np.array([0.3, 0.0]), 0.1)
        if slow_s is None and abs(motion.dq[0]) < 0.31:
            slow_s = T * tick
    assert slow_s == pytest.approx((2.0 - 0.3) / 5.0 + 0.05, abs=0.03)
    # As fast as it may be, it takes a tenth again.
    assert motion.dq == pytest.approx([0.3, 0.0])
    motion, *_ = limiter.step(motion, stop, np.zeros(2), 0.1)
    assert motion.ddq[0] == pytest.approx(-0.1 * 0.9999 * 5.0)


def tried(target, refused, judge_of=lambda stop: 0.0):
    """What a limiter tries when a judge refuses the first so many stops, and what it takes."""
    n = len(target)
    limiter = Limiter(bounded(-9.0, np.full(n, 9.0), A4[:n], J4[:n]), STEP_S)
    motion = Motion.at_rest(np.zeros(n))
    seen = []

    def judge(stop):
        seen.append(stop)
        return 1.0 if len(seen) <= refused else judge_of(stop)

    return limiter.step(motion, limiter.verified_stop(motion), target, 1.0, judge), seen


A4, J4, STEP_S = np.array([5.0, 2.0, 4.0, 3.0]), np.array([100.0, 90.0, 20.0, 60.0]), 0.5
WISH = np.array([0.5, -0.4, 0.2, 0.3])


@pytest.mark.parametrize(("refused", "part"), [(0, 1.0), (1, 0.5), (2, 0.2), (3, 0.05)])
def test_what_is_tried_is_all_of_the_target_half_of_it_a_fifth_and_a_twentieth(refused, part):
    """The period is long here: the joints reach what is tried."""
    limited, seen = tried(WISH, refused)
    assert not limited.stopped
    assert not limited.worsened
    np.testing.assert_allclose(limited.motion.dq, part * WISH)
    assert len(seen) == refused + 1
    assert limited.stop is seen[-1]


def test_after_the_twentieth_part_nothing_more_is_tried():
    limited, seen = tried(WISH, 4, lambda stop: 0.0)
    assert limited.stopped  # the fifth that is judged is the held one
    assert len(seen) == 5


def test_between_no_things_the_twentieth_part_is_not_tried():
    """Where it alone would be inside the limits, the stored stop goes on."""
    motion = Motion.at_rest(np.zeros(1))
    for upper, stopped in ((0.02, False), (0.004, True)):
        limiter = Limiter(bounded(-1.0, upper, 5.0, 100.0), STEP_S)
        held = limiter.verified_stop(motion)
        limited = limiter.step(motion, held, np.array([0.1]), 1.0)
        assert limited.stopped == stopped
        judged = limiter.step(motion, held, np.array([0.1]), 1.0, lambda _: 0.0)
        assert not judged.stopped


def test_joints_get_there_together_at_first_and_then_each_as_soon_as_it_can():
    limited, _ = tried(WISH, 0)
    planner = VelocityPlanner(0.9999 * A4, 0.9999 * J4)
    motion = Motion.at_rest(np.zeros(4))
    for refused, part, together in ((0, 1.0, True), (1, 0.5, False), (2, 0.2, False)):
        limited, _ = tried(WISH, refused)
        expected = planner.step(motion, part * WISH, STEP_S, together)
        for found, wanted in zip(limited.motion, expected, strict=True):
            np.testing.assert_array_equal(found, wanted)
    limited, _ = tried(WISH, 3)
    along = limited.motion.q / WISH
    np.testing.assert_allclose(along, along[0], rtol=1e-9)


def test_what_each_arm_was_told_can_be_had_of_what_all_were():
    limited, _ = tried(WISH, 0)
    start = np.arange(4.0)
    told = Commanded.at_rest(start).followed_by(limited)
    one = told.of(slice(1, 3))
    np.testing.assert_array_equal(one.motion.q, limited.motion.q[1:3])
    np.testing.assert_array_equal(one.stop.low, limited.stop.low[1:3])
    newest, before, first = one.sent
    np.testing.assert_array_equal(newest, limited.motion.q[1:3])
    np.testing.assert_array_equal(before, start[1:3])
    np.testing.assert_array_equal(first, start[1:3])


@pytest.mark.parametrize("least", range(4))
def test_where_all_fall_short_the_least_bad_of_them_is_taken(least):
    amounts = [2.0, 2.0, 2.0, 2.0, 5.0]
    amounts[least] = 1.0
    told = iter(amounts)
    limited, seen = tried(WISH, 0, lambda _: next(told))
    assert (limited.worsened, limited.stopped) == (True, False)
    assert limited.stop is seen[least]


def test_of_equally_bad_ones_the_first_is_taken_and_before_the_held_one_none():
    limited, seen = tried(WISH, 0, lambda _: 2.0)
    assert (limited.worsened, limited.stopped) == (True, True)
    told = iter([2.0, 2.0, 2.0, 2.0, 5.0])
    limited, seen = tried(WISH, 0, lambda _: next(told))
    assert limited.stop is seen[0]


@pytest.mark.parametrize(("short", "worsened"), [(1e-3, False), (1.1e-3, True), (1.9e-3, True)])
def test_a_held_stop_has_become_worse_when_it_falls_short_by_more_than_a_millimetre(
    short, worsened
):
    told = iter([9.0] * 4 + [short])
    limited, _ = tried(WISH, 0, lambda _: next(told))
    assert (limited.stopped, limited.worsened) == (True, worsened)


def test_a_stop_that_has_run_out_is_rest_without_a_rounding():
    limiter = one_joint()
    motion = Motion(np.array([0.1]), np.array([0.3]), np.array([0.7]))
    stop = limiter.verified_stop(motion)
    while not stop.finished:
        motion, stop, *_ = limiter.go_on(stop)
    assert motion.stands()
    again = limiter.go_on(stop).motion
    np.testing.assert_array_equal(again.q, motion.q)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_stop_may_reach_a_bound_and_not_pass_it(side):
    """The stop of the motion that is tried ends at the bound to the last bit, or just beyond."""
    free = Limiter(bounded(-9.0, 9.0, 5.0, 100.0), T)
    motion = Motion.at_rest(np.zeros(1))
    taken = free.step(motion, free.verified_stop(motion), np.array([side]), 1.0)
    reached = max(abs(taken.stop.low[0]), abs(taken.stop.high[0]))
    for bound, whole in ((reached, True), (np.nextafter(reached, 0.0), False)):
        tight = Limiter(bounded(-bound, bound, 5.0, 100.0), T)
        limited = tight.step(motion, tight.verified_stop(motion), np.array([side]), 1.0)
        assert np.array_equal(limited.motion.q, taken.motion.q) == whole


def test_where_the_target_is_no_number_the_stored_stop_goes_on():
    limiter = one_joint()
    motion = Motion(np.zeros(1), np.array([0.5]), np.zeros(1))
    held = limiter.verified_stop(motion)
    limited = limiter.step(motion, held, np.array([np.nan]), 1.0)
    assert limited.stopped
    np.testing.assert_array_equal(limited.motion.q, held.at(T).q)


def test_at_the_very_end_of_a_stop_nothing_is_left_of_a_rounding(rng):
    for _ in range(50):
        motion = Motion(np.zeros(3), rng.normal(size=3), rng.normal(size=3))
        stop = VelocityPlanner(np.full(3, 5.0), np.full(3, 100.0)).stop(motion)
        wide = np.full(3, 99.0)
        limiter = Limiter(bounded(-wide, wide, wide, wide), stop.duration_s)
        assert limiter.go_on(stop).motion.stands()
