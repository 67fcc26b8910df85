import numpy as np
import pytest
from telerobot.config.schema.sources import ForceSection
from telerobot.server.control.inputs import Intent
from telerobot.server.control.spatial import Pose
from telerobot.server.control.task.sources import Force, ForceState, eased, pressed

from .shown import SHAPING, shown

GAIN = np.array([7e-4] * 3 + [0.03] * 3)
WALL = np.array([20.0, 0, 0, 0, 0, 0])
HARD = 5.0 * WALL


@pytest.fixture
def force():
    return Force(ForceSection(hold_threshold=30.0, hold_leash=0.02), SHAPING)


def rate(force, gain=GAIN, **said):
    return force.rate(shown(**said), force.idle(), gain)[0]


def test_pressing_a_wall_at_plus_x_with_20_newtons_backs_off_to_minus_x(force):
    np.testing.assert_allclose(rate(force, wrench=WALL), [-0.014, 0, 0, 0, 0, 0], atol=1e-15)


def test_the_twist_comes_in_world_axes_from_gains_in_the_mrfs(force, rng, random_pose):
    T, wrench, desired = random_pose(), rng.normal(size=6), rng.normal(size=6)
    gain = GAIN * rng.uniform(0, 1, 6)
    twist = rate(force, gain, wrench=wrench, wrench_desired=desired, T_world_mrf=T)
    np.testing.assert_allclose(T.R.T @ twist[:3], gain[:3] * (desired - wrench)[:3], atol=1e-15)
    np.testing.assert_allclose(T.R.T @ twist[3:], gain[3:] * (desired - wrench)[3:], atol=1e-15)


def test_a_desired_wrench_may_be_given_in_other_axes(force, rng, random_pose):
    T, R, desired = random_pose(), random_pose().R, rng.normal(size=6)
    gain = np.full(6, 0.01)
    twist = rate(
        force,
        gain,
        wrench=np.zeros(6),
        wrench_desired=desired,
        R_world_wrench=R,
        T_world_mrf=T,
    )
    expected = 0.01 * np.concatenate([R @ desired[:3], R @ desired[3:]])
    np.testing.assert_allclose(twist, expected, atol=1e-15)


def test_a_wrench_that_is_as_desired_asks_for_nothing(force, rng):
    wrench = rng.normal(size=6)
    assert not rate(force, wrench=wrench, wrench_desired=wrench).any()


def test_a_stale_sensor_asks_for_nothing_even_when_a_wrench_is_desired(force):
    assert not rate(force, wrench=None, wrench_desired=10 * np.ones(6)).any()


def test_in_hold_hard_contact_is_bled_off_and_a_light_one_is_held(force):
    held = {"intent": Intent.HOLD}
    assert not rate(force, wrench=WALL, **held).any()
    np.testing.assert_allclose(rate(force, wrench=HARD, **held), [-0.07, 0, 0, 0, 0, 0], atol=1e-15)


def test_what_bleeds_off_in_hold_goes_no_farther_than_the_leash(force):
    state, x = force.idle(), 0.0
    for _ in range(2000):
        at = Pose(np.eye(3), np.array([x, 0.0, 0.0]))
        context = shown(intent=Intent.HOLD, wrench=HARD, T_world_wrist=at, T_world_mrf=at)
        twist, state = force.rate(context, state, GAIN)
        assert state.bleeding
        x += SHAPING.period_s * twist[0]
    assert -0.02 - 1e-9 < x < -0.019


def test_an_arm_that_is_neither_moved_nor_held_is_asked_for_nothing_and_forgets(force):
    context = shown(intent=Intent.SEED, wrench=HARD)
    twist, state = force.rate(context, ForceState(np.ones(3), True), GAIN)
    assert not twist.any()
    assert state == ForceState()


def test_beside_commanded_joints_only_contact_is_given_way_to(force):
    """Noise and inertia move no joint; of more, what is beyond a third of the threshold."""
    jogged = {"jog": np.zeros(7)}
    assert not rate(force, wrench=0.4 * WALL, wrench_desired=WALL, **jogged).any()
    beyond = HARD[0] - 0.3 * 30.0
    expected = [-7e-4 * beyond, 0, 0, 0, 0, 0]
    np.testing.assert_allclose(rate(force, wrench=HARD, **jogged), expected, atol=1e-15)


# --- how hard other sources press -----------------------------------------------------------------

MOST = 100.0


def test_a_sum_that_presses_too_hard_keeps_its_direction_and_the_contact_moves_at_the_bound(
    rng, random_pose
):
    """The contact is one point, a lever away from the MRF; its speed is told by rigid motion."""
    slowed = 0
    for _ in range(100):
        R, gain = random_pose().R, GAIN * rng.uniform(0.2, 1, 6)
        lever, n, asked = rng.uniform(-0.2, 0.2, 3), rng.normal(size=3), rng.normal(size=6)
        n /= np.linalg.norm(n)

        def at_contact(twist, lever=lever, n=n):
            return n @ (twist[:3] + np.cross(twist[3:], lever))

        def wrench_mrf(force, lever=lever, n=n, R=R):
            return np.concatenate([R.T @ (force * n), R.T @ np.cross(lever, force * n)])

        press = pressed(None, wrench_mrf(rng.uniform(0.3, 3.0) * MOST), R, 0.25 * MOST, 0.02)
        gives_way = n @ R @ (gain * wrench_mrf(MOST))[:3]
        take = eased(asked, press, gain, R, MOST)
        if at_contact(asked) <= gives_way:
            assert take is None
            continue
        slowed += 1
        left = asked + take
        assert at_contact(left) == pytest.approx(gives_way)
        np.testing.assert_allclose(left / np.linalg.norm(left), asked / np.linalg.norm(asked))
    assert slowed > 30


def test_nothing_is_pressed_below_the_least_that_counts_and_a_bounce_lets_go_slowly():
    wrench = np.array([0.24 * MOST, 0, 0, 5.0, 0, 0])
    assert pressed(None, wrench, np.eye(3), 0.25 * MOST, 0.02) is None
    press = pressed(None, 1.1 * wrench, np.eye(3), 0.25 * MOST, 0.02)
    sizes = []
    while press is not None:
        sizes.append(press[0])
        press = pressed(press, np.zeros(6), np.eye(3), 0.25 * MOST, 0.02)
    np.testing.assert_allclose(sizes, 0.98 ** np.arange(len(sizes)))
    assert 0.02 * len(sizes) == pytest.approx(3.0, abs=0.05)


def test_a_stale_sensor_forgets_slowly_and_force_control_that_is_off_takes_nothing_back():
    press = np.array([1.0, 0, 0, 0, 0, 0])
    assert pressed(press, None, np.eye(3), MOST, 0.02)[0] == 0.98
    assert eased(np.array([0.2, 0, 0, 0, 0, 0]), press, np.zeros(6), np.eye(3), MOST) is None
