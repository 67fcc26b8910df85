import numpy as np
import pytest
from telerobot.server.control.barriers.rows import JointLimits, Room
from telerobot.server.control.spatial import Motion
from telerobot.server.control.stop.trajectory import VelocityPlanner

from ..bounds import bounded

T = 0.01


def joints(rng, n=50):
    """Joints of random strength: bounds on acceleration, jerk and speed."""
    A = 10 ** rng.uniform(0, 1.5, n)
    return A, A * 10 ** rng.uniform(1, 2.3, n), rng.uniform(0.3, 4.0, n)


def stopping_distance(v, A, J):
    """How far a joint goes from speed v until it rests, in closed form."""
    return np.where(v < A**2 / J, v * np.sqrt(v / J), v**2 / (2 * A) + v * A / (2 * J))


def room_of(A, J, V, reach=1.0):
    return JointLimits(bounded(-reach, np.full(len(A), reach), A, J, V), T)


def test_a_joint_at_the_speed_allowed_can_stop_in_the_room_left(rng):
    A, J, V = joints(rng)
    room = room_of(A, J, V)
    for distance in np.geomspace(1e-6, 3.0, 40):
        v = np.minimum(room.approach(np.full(len(A), distance)), V)
        assert (stopping_distance(v, A, J) + v * T <= distance).all()
        assert (v > 0).all()


def test_joints_sent_to_their_limits_come_to_rest_at_them_unstopped(rng):
    A, J, V = joints(rng)
    room, planner = room_of(A, J, V), VelocityPlanner(A, J)
    side = rng.choice([-1.0, 1.0], len(A))
    motion = Motion.at_rest(np.zeros(len(A)))
    furthest = 0.0
    for _ in range(2500):
        bounds = room.limits(motion.q)
        target = np.clip(side * V, bounds.low, bounds.high)
        motion = planner.step(motion, target, T, synchronised=False)
        furthest = max(furthest, (side * motion.q).max())
    assert furthest <= 1.0 + 1e-9
    np.testing.assert_allclose(motion.q, side, atol=1e-3)


def test_going_away_from_a_limit_is_as_free_there_as_anywhere(rng):
    A, J, V = joints(rng)
    room, n = room_of(A, J, V), len(A)
    for q in (0.9, 0.9999, 1.0, 1.2):
        assert (-room.limits(np.full(n, q)).low >= room.approach(np.full(n, 1.0))).all()
        assert (room.limits(np.full(n, -q)).high >= room.approach(np.full(n, 1.0))).all()


def test_beyond_a_limit_a_joint_goes_no_further_out_and_is_not_led_back_either(rng):
    """It may stand: an arm that is enabled there moves only when it is asked to."""
    A, J, V = joints(rng)
    room, n = room_of(A, J, V), len(A)
    np.testing.assert_array_equal(room.limits(np.full(n, 1.2)).high, 0.0)
    np.testing.assert_array_equal(room.limits(np.full(n, -1.2)).low, 0.0)


@pytest.mark.parametrize(
    ("part", "ahead", "back"),
    [(0.0, 1.0, 1.0), (0.5, 1.0, 1.0), (0.75, 0.5, 1.0), (1.0, 0.0, 1.0), (2.0, 0.0, 1.0)],
)
def test_the_leash_slows_a_command_that_runs_ahead_and_never_its_return(part, ahead, back, rng):
    A, J, V = joints(rng)
    room, n = room_of(A, J, V), len(A)
    leading = room.leash(np.full(n, 0.03 * part))
    np.testing.assert_allclose(leading.high, ahead * V, atol=1e-12)
    np.testing.assert_allclose(leading.low, -back * V, atol=1e-12)
    lagging = room.leash(np.full(n, -0.03 * part))
    np.testing.assert_allclose(lagging.low, -ahead * V, atol=1e-12)
    np.testing.assert_allclose(lagging.high, back * V, atol=1e-12)


def test_what_is_within_is_scaled_to_the_speeds_and_held_against_every_bound(rng):
    reached = set()
    for _ in range(200):
        n = 3
        room = room_of(*joints(rng, n))
        most, q = rng.uniform(0.2, 2.0, n), rng.uniform(-1.1, 1.1, n)
        dq, error = rng.normal(0.0, 1.5, n), rng.normal(0.0, 0.012, n)
        found = room.within(dq, most, q, error)
        share = 1.0 / max(1.0, np.max(np.abs(dq) / most))
        limits, leash = room.limits(q), room.leash(error)
        low = np.maximum(np.maximum(limits.low, leash.low), -most)
        high = np.minimum(np.minimum(limits.high, leash.high), most)
        np.testing.assert_allclose(found.dq, share * dq, rtol=1e-12)
        assert (np.abs(found.dq) <= most).all()
        np.testing.assert_array_equal(found.low, np.minimum(low, high))
        np.testing.assert_array_equal(found.high, np.maximum(low, high))
        outside = (found.dq < found.low) | (found.dq > found.high)
        assert found.beyond == outside.any()
        reached.add((share < 1.0, found.beyond))
    assert len(reached) == 4


def test_joints_that_leave_their_bounds_are_told(rng):
    for _ in range(50):
        low, high, dq = -rng.uniform(0, 1, 6), rng.uniform(0, 1, 6), rng.uniform(-1, 1, 6)
        dq[0], dq[1] = low[0], high[1]
        assert Room(low, high).left_by(dq) == np.flatnonzero((dq < low) | (dq > high)).tolist()
