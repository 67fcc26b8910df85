import numpy as np
import pytest
import ruckig
from telerobot.server.control.spatial import Motion
from telerobot.server.control.stop.profile import reach, shape, stepped
from telerobot.server.control.stop.trajectory import TrajectoryError, VelocityPlanner


def ruckigs(motion, target, acceleration, jerk, way):
    """The library's answer to the same question."""
    n = len(target)
    asked, trajectory = ruckig.InputParameter(n), ruckig.Trajectory(n)
    asked.control_interface = ruckig.ControlInterface.Velocity
    asked.synchronization = way
    asked.current_position, asked.current_velocity, asked.current_acceleration = motion
    asked.target_velocity, asked.target_acceleration = target, [0.0] * n
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = [1e6] * n, acceleration, jerk
    assert ruckig.Ruckig(n).calculate(asked, trajectory) == ruckig.Result.Working
    return trajectory


def drawn(rng):
    """A motion, a target and bounds; some rest, some are there, some accelerate beyond bounds."""
    n = int(rng.integers(1, 9))
    acceleration, jerk = rng.uniform(0.5, 5.0, n), rng.uniform(5.0, 100.0, n)
    ddq = acceleration * rng.uniform(-1.0, 1.0, n) * rng.choice([0.0, 1.0, 1.0, 1.5], n)
    motion = Motion(rng.normal(size=n), rng.normal(size=n) * rng.choice([0.0, 1.0], n), ddq)
    target = rng.normal(size=n) * rng.choice([0.0, 0.01, 1.0], n)
    return motion, target, acceleration, jerk


@pytest.mark.parametrize("together", [True, False])
def test_the_way_is_the_quickest_one_that_ruckig_finds(together, rng):
    for _ in range(200):
        motion, target, acceleration, jerk = drawn(rng)
        way = ruckig.Synchronization.Time if together else ruckig.Synchronization.No
        expected = ruckigs(motion, target, acceleration, jerk, way)
        for seconds in (0.01, 0.1, 0.5, 2.0):
            found = stepped(*motion, target, acceleration, jerk, seconds, together)
            np.testing.assert_allclose(found, expected.at_time(seconds), atol=1e-9)


def test_from_tick_to_tick_it_stays_on_its_way_and_inside_its_bounds(rng):
    for _ in range(20):
        motion, target, acceleration, jerk = drawn(rng)
        within = np.abs(motion.ddq) <= acceleration
        whole = stepped(*motion, target, acceleration, jerk, 0.3, True)
        for _ in range(30):
            before = motion
            motion = Motion(*stepped(*motion, target, acceleration, jerk, 0.01, True))
            assert (np.abs(motion.ddq - before.ddq) <= jerk * 0.01 + 1e-12).all()
            assert (np.abs(motion.ddq) <= acceleration + 1e-12)[within].all()
        np.testing.assert_allclose(np.array(motion), whole, atol=1e-9)


def test_a_stick_is_shaped_as_freedoms_that_go_together_and_not_where_all_rests(rng):
    moved = 0
    for _ in range(60):
        motion, target, acceleration, jerk = drawn(rng)
        still = rng.choice([0.0, 1.0], 3)
        motion = Motion(motion.q, still[0] * motion.dq, still[1] * motion.ddq)
        target = still[2] * target
        out = np.full((2, len(target)), np.nan)
        rests = not (motion.dq.any() or motion.ddq.any() or target.any())
        assert shape(motion.dq, motion.ddq, target, acceleration, jerk, 0.03, out) is not rests
        moved += not rests
        way = stepped(*motion, target, acceleration, jerk, 0.03, True)[1:]
        np.testing.assert_allclose(out, np.full_like(way, np.nan) if rests else way, atol=1e-12)
    assert 10 < moved < 60


@pytest.mark.parametrize("broken", [0, 1, 2])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_refused_by_name(broken, value):
    planner = VelocityPlanner(np.ones(2), np.ones(2))
    parts = [np.zeros(2), np.zeros(2), np.zeros(2)]
    parts[broken] = np.array([0.0, value])
    with pytest.raises(TrajectoryError, match="velocity target"):
        planner.step(Motion(*parts), np.ones(2), 0.01, synchronised=True)
    with pytest.raises(TrajectoryError, match="velocity target"):
        planner.step(Motion.at_rest(np.zeros(2)), np.full(2, value), 0.01, synchronised=False)
    if broken:
        with pytest.raises(TrajectoryError, match="stop from"):
            planner.stop(Motion(*parts))


def test_a_stop_is_the_quickest_one_of_each_freedom_and_knows_how_far_it_goes(rng):
    for _ in range(100):
        motion, _, acceleration, jerk = drawn(rng)
        stop = VelocityPlanner(acceleration, jerk).stop(motion)
        rest = np.zeros(len(motion.q))
        # Ruckig counts a target position of zero to the extrema: let zero be where it starts.
        expected = ruckigs(
            motion._replace(q=rest), rest, acceleration, jerk, ruckig.Synchronization.No
        )
        assert stop.duration_s == pytest.approx(expected.duration, abs=1e-9)
        extrema = expected.position_extrema
        np.testing.assert_allclose(stop.low - motion.q, [e.min for e in extrema], atol=1e-9)
        np.testing.assert_allclose(stop.high - motion.q, [e.max for e in extrema], atol=1e-9)
        along_it(stop, motion, expected)


def test_a_straight_stop_keeps_the_shares_that_ruckig_keeps(rng):
    for _ in range(60):
        motion, _, acceleration, jerk = drawn(rng)
        within = np.clip(motion.ddq, -acceleration, acceleration)
        motion = rng.choice([motion._replace(ddq=within), straight(motion, rng)])
        motion = Motion(*motion)
        moved, stop = VelocityPlanner(acceleration, jerk).straight(motion, 0.3 * motion.dq, 0.01)
        rest = np.zeros(len(motion.q))
        expected = ruckigs(
            moved._replace(q=rest), rest, acceleration, jerk, ruckig.Synchronization.Phase
        )
        assert stop.duration_s == pytest.approx(expected.duration, abs=1e-9)
        along_it(stop, moved, expected)


def straight(motion, rng):
    """The same speed, gone about along one line."""
    return motion._replace(ddq=rng.uniform(-0.3, 0.3) * motion.dq)


def along_it(stop, start, expected):
    """Every state along a stop is the library's, whether asked now or later."""
    times = np.linspace(0.0, 1.2 * stop.duration_s + 0.01, 20)
    postures = stop.postures(times)
    half = stop.advanced(0.5 * stop.duration_s)
    for t, q in zip(times, postures, strict=True):
        found, wanted = stop.at(t), Motion(*map(np.array, expected.at_time(t)))
        np.testing.assert_allclose(found.q, q, atol=1e-12)
        np.testing.assert_allclose(found.q - start.q, wanted.q, atol=1e-9)
        np.testing.assert_allclose(found.dq, wanted.dq, atol=1e-9)
        assert (stop.low - 1e-12 <= q).all()
        assert (q <= stop.high + 1e-12).all()
        np.testing.assert_allclose(half.at(t - half.elapsed_s).q, q, atol=1e-12)
    assert stop.at(stop.duration_s + 1e-9).stands(1e-9)


def turned_at(v, a, phases):
    """The least and the greatest way of one freedom through phases (2, k), by numpy's roots."""
    x, ways = 0.0, [0.0]
    for seconds, j in phases.T:
        way = np.poly1d([j / 6.0, a / 2.0, v, x])
        turns = [t.real for t in way.deriv().roots if abs(t.imag) < 1e-12]
        ways += [way(t) for t in (*turns, seconds) if 0.0 <= t <= seconds]
        x, v, a = way(seconds), way.deriv()(seconds), a + j * seconds
    return min(ways), max(ways)


def test_the_reach_of_any_way_is_where_it_turns_or_ends(rng):
    """Also of one that turns twice within a phase, as no quickest stop does."""
    twice = (0.25, -1.0, np.array([[1.8], [1.0]]))
    early = (0.25, -0.75, np.array([[1.0], [1.0]]))
    even = (0.5, -2.0, np.array([[0.4], [0.0]]))
    still = (0.0, 0.0, np.array([[0.4], [0.0]]))
    drawn_ways = [
        (*rng.normal(size=2), np.array([rng.uniform(0.0, 2.0, 3), rng.normal(0.0, 3.0, 3)]))
        for _ in range(60)
    ]
    for v, a, phases in (twice, early, even, still, *drawn_ways):
        for sign in (-1.0, 1.0):
            jerks = phases * [[1.0], [sign]]
            start = np.array([2.0]), np.array([sign * v]), np.array([sign * a])
            low, high, lasts = reach(*start, jerks[:, :, None])
            least, most = turned_at(sign * v, sign * a, jerks)
            assert (low[0], high[0]) == pytest.approx((2.0 + least, 2.0 + most), abs=1e-9)
            assert lasts == pytest.approx(phases[0].sum())
