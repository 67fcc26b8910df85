import numpy as np
import pytest
import ruckig
from telerobot.server.control.trajectory import Motion, TrajectoryError, VelocityPlanner
from telerobot.server.control.velocity_profile import stepped


def ruckigs(motion, target, acceleration, jerk, seconds, together):
    """The same question to the library."""
    n = len(target)
    asked, trajectory = ruckig.InputParameter(n), ruckig.Trajectory(n)
    asked.control_interface = ruckig.ControlInterface.Velocity
    way = ruckig.Synchronization
    asked.synchronization = way.Time if together else way.No
    asked.current_position, asked.current_velocity, asked.current_acceleration = motion
    asked.target_velocity, asked.target_acceleration = target, [0.0] * n
    asked.max_velocity, asked.max_acceleration, asked.max_jerk = [1e6] * n, acceleration, jerk
    assert ruckig.Ruckig(n).calculate(asked, trajectory) == ruckig.Result.Working
    return np.array(trajectory.at_time(seconds))


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
    for _ in range(500):
        motion, target, acceleration, jerk = drawn(rng)
        for seconds in (0.01, 0.1, 0.5, 2.0):
            found = stepped(*motion, target, acceleration, jerk, seconds, together)
            expected = ruckigs(motion, target, acceleration, jerk, seconds, together)
            np.testing.assert_allclose(found, expected, atol=1e-9)


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
