import numpy as np
import pytest
from telerobot.server.control.stop.limiter import Limiter
from telerobot.server.control.stop.motion import Motion
from telerobot.server.control.stop.trajectory import VelocityPlanner

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
    limiter = Limiter(-upper, upper, A, J, T, groups)
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
    limiter = Limiter(-upper, upper, A, J, T)
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
    return Limiter(-np.ones(1), np.array([upper]), np.array([5.0]), np.array([100.0]), T)


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
    limiter = Limiter(np.array([2.0]), np.array([3.0]), np.array([5.0]), np.array([100.0]), T)
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
