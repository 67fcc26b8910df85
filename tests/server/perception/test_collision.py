import mujoco
import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.drivers.rig.physics.scene import build_model
from telerobot.server.control.mechanism.model import Dynamics, Mechanism
from telerobot.server.control.spatial import Pose
from telerobot.server.perception.filters import CollisionDetector, DetectorState, SensorLoad

T = 0.01


@pytest.fixture(scope="module")
def cell():
    return load_cell("pa10")


@pytest.fixture
def dynamics(cell):
    rotors = np.array([d.rotor_inertia for d in cell.config.mechanism.drives])
    return Dynamics(Mechanism.from_cell(cell), rotors, Pose.identity())


def physics_torque(cell, q, dq, ddq):
    """The physics engine's own inverse dynamics, without friction."""
    model, _ = build_model(cell)
    model.dof_frictionloss[:] = 0.0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    n = len(q)
    data.qpos[:n], data.qvel[:n], data.qacc[:n] = q, dq, ddq
    mujoco.mj_inverse(model, data)
    return data.qfrc_inverse[:n]


def test_the_torques_are_those_of_the_physics_engine(cell, dynamics, rng):
    payload = cell.config.mechanism.force_torque.payload
    dynamics.carry(payload.mass, np.array(payload.com))
    for _ in range(10):
        q, dq, ddq = rng.uniform(-0.4, 0.4, 7), rng.normal(size=7), rng.normal(size=7)
        q += cell.config.mechanism.postures["ready"]
        expected = physics_torque(cell, q, dq, ddq)
        np.testing.assert_allclose(dynamics.torque(q, dq, ddq), expected, atol=0.02)


def test_what_is_carried_weighs_at_every_joint(cell, dynamics, rng):
    com = (0.02, -0.03, 0.1)
    laden = altered(cell, {"rig.payload_mass": 2.0, "rig.payload_com": com})
    own = cell.config.mechanism.force_torque.payload
    moment = own.mass * np.array(own.com) + 2.0 * np.array(com)
    dynamics.carry(own.mass + 2.0, moment / (own.mass + 2.0))
    for _ in range(5):
        q = rng.uniform(-0.4, 0.4, 7) + cell.config.mechanism.postures["ready"]
        still = np.zeros(7)
        expected = physics_torque(laden, q, still, still)
        np.testing.assert_allclose(dynamics.torque(q, still, still), expected, atol=1e-6)


def follow(touch, dynamics, push, friction, seconds=1.0, missed=(), late=None, unknown=()):
    """Feed a motion with its exact torques, plus a push (7,) that no sensor sees.

    Ticks in `missed` are not served, those in `late` so much after their time [s]; of those in
    `unknown` nobody knows when they were, and they were late.
    """
    state = DetectorState()
    dynamics.carry(0.0, np.zeros(3))
    phase, size = np.arange(7), np.full(7, 0.1)
    for k in range(int(seconds / T)):
        if k in missed:
            continue
        t = k * T + (late or {}).get(k, 0.006 if k in unknown else 0.0)
        q = np.array([0.0, 0.3, 0.0, 2.0, 0.0, -0.7, 0.0]) + size * np.sin(2 * t + phase)
        middle = t - T / 2  # the mean of the period before
        dq = 2 * size * np.cos(2 * middle + phase)
        ddq = -4 * size * np.sin(2 * middle + phase)
        at = np.array([0.0, 0.3, 0.0, 2.0, 0.0, -0.7, 0.0]) + size * np.sin(2 * middle + phase)
        tau = dynamics.torque(at, dq, ddq) + friction * np.sign(dq) - push
        known_s = None if k in unknown else t
        state = touch.measure(state, q, tau, None, known_s)
    return state


def test_the_estimate_is_the_push(dynamics):
    touch = CollisionDetector(dynamics, np.zeros(7), np.full(7, 3.0), 0.0, 6.0, 0.02, T)
    push = np.array([0.0, 5.0, 0.0, -2.0, 0.0, 0.0, 0.0])
    state = follow(touch, dynamics, push, 0.0)
    np.testing.assert_allclose(state.external, push, atol=0.05)
    felt = touch.touched(state)
    assert felt.joint == 1
    assert felt.torque == pytest.approx(5.0, abs=0.05)


def test_friction_alone_is_no_push_not_even_where_its_sign_turns(dynamics):
    friction = np.full(7, 4.0)
    touch = CollisionDetector(dynamics, friction, np.full(7, 0.5), 0.0, 6.0, 0.0, T)
    for seconds in np.arange(0.1, 3.2, 0.1):
        state = follow(touch, dynamics, np.zeros(7), friction, seconds)
        assert touch.touched(state) is None


def test_a_short_knock_is_not_contact_yet(dynamics):
    touch = CollisionDetector(dynamics, np.zeros(7), np.full(7, 3.0), 0.0, 50.0, 0.05, T)
    state = follow(touch, dynamics, np.full(7, 10.0), 0.0, 0.06)
    assert np.abs(state.external).max() > 3.0
    assert touch.touched(state) is None


def test_a_tick_that_was_missed_in_motion_is_no_push(dynamics):
    touch = CollisionDetector(dynamics, np.zeros(7), np.full(7, 3.0), 0.0, 6.0, 0.0, T)
    for last in range(41, 50):
        state = follow(touch, dynamics, np.zeros(7), 0.0, last * T, missed=(40,))
        assert touch.touched(state) is None
        assert np.abs(state.external).max() < 0.5


@pytest.mark.parametrize("late_s", [0.0005, 0.002, 0.004, 0.0049, 0.006])
def test_a_tick_that_was_late_in_motion_and_the_one_after_are_no_push(dynamics, late_s):
    """Taken as even, 6 ms of lateness are 12 rad/s² at 0.2 rad/s."""
    touch = CollisionDetector(dynamics, np.zeros(7), np.full(7, 3.0), 0.0, 6.0, 0.0, T)
    for last in range(41, 50):
        state = follow(touch, dynamics, np.zeros(7), 0.0, last * T, late={40: late_s})
        assert touch.touched(state) is None
        assert np.abs(state.external).max() < 0.5


def test_a_sample_of_no_known_instant_is_no_push(dynamics):
    touch = CollisionDetector(dynamics, np.zeros(7), np.full(7, 3.0), 0.0, 6.0, 0.0, T)
    for last in range(41, 50):
        state = follow(touch, dynamics, np.zeros(7), 0.0, last * T, unknown=(40, 44))
        assert touch.touched(state) is None
        assert np.abs(state.external).max() < 0.5


def test_the_first_estimate_is_no_more_certain_than_one_that_follows(dynamics):
    touch = CollisionDetector(dynamics, np.zeros(7), np.full(7, 3.0), 0.0, 6.0, 0.0, T)
    push = np.full(7, 5.0)
    first, second = (follow(touch, dynamics, push, 0.0, n * T).external for n in (3, 4))
    assert (np.abs(first) < 0.5 * push).all()
    assert (np.abs(second) > np.abs(first)).all()


def test_a_push_is_felt_through_a_missed_tick(dynamics):
    touch = CollisionDetector(dynamics, np.zeros(7), np.full(7, 3.0), 0.0, 6.0, 0.0, T)
    state = follow(touch, dynamics, np.full(7, 5.0), 0.0, 1.0, missed=(98,))
    assert touch.touched(state) is not None


# --- what the sensor sees -------------------------------------------------------------------------

REACH = np.array([0.0, 0.3, 0.0, 2.0, 0.0, -0.7, 0.0])


def stand(touch, dynamics, wrench, lag_s=0.002, push=None, seconds=1.0):
    """Feed a standing arm whose tool exerts `wrench(t)` (6,), of which no model knows.

    The sensor gives the means of two samples, 5 ms apart, the newest `lag_s` before the joints;
    drives report the mean of the period before. Returns every state.
    """
    state, states = DetectorState(), []
    dynamics.carry(0.0, np.zeros(3))
    still, samples = np.zeros(7), []
    (gravity, _), J = dynamics.needed(REACH, still, still)
    for k in range(round(seconds / T)):
        t = k * T
        samples = [*samples[-2:], wrench(t - lag_s - T / 2), wrench(t - lag_s)]
        jump = max(
            (b - (a + c) / 2 for a, b, c in zip(samples, samples[1:], samples[2:], strict=False)),
            key=np.linalg.norm,
            default=np.zeros(6),
        )
        load = SensorLoad(np.mean(samples[-2:], axis=0), jump, lag_s + T / 4)
        seen = np.mean([wrench(t - s) for s in np.arange(0.0005, T, 0.001)], axis=0)
        tau = gravity + seen @ J - (0.0 if push is None else push)
        state = touch.measure(state, REACH, tau, load, t)
        states.append(state)
    return states


def pressing(force):
    return np.array([0.0, 0.0, force, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("lag_s", [0.0, 0.002, 0.005])
def test_a_contact_that_grows_quickly_is_no_push_when_the_sensor_sees_it(dynamics, lag_s):
    """To 60 N at 1.2 N a millisecond: 16 ms of lateness would be 15 N·m at the shoulder."""
    touch = CollisionDetector(dynamics, np.zeros(7), np.full(7, 3.0), 0.0, 6.0, 0.0, T)
    states = stand(touch, dynamics, lambda t: pressing(1200.0 * np.clip(t - 0.5, 0, 0.05)), lag_s)
    assert max(np.abs(s.external).max() for s in states[50:] if s.external is not None) < 3.0
    assert not any(touch.touched(s) for s in states)


def test_what_hangs_on_the_sensor_need_not_be_known(dynamics):
    touch = CollisionDetector(dynamics, np.zeros(7), np.full(7, 3.0), 0.0, 6.0, 0.0, T)
    states = stand(touch, dynamics, lambda _t: np.array([50.0, 30.0, -80.0, 5.0, -8.0, 1.0]))
    assert np.abs(states[-1].external).max() < 1e-6


@pytest.mark.parametrize("closed", [0.15, 0.25, 0.35])
def test_contact_that_chatters_between_the_sensors_samples_is_no_push(dynamics, rng, closed):
    """Whether a sample finds it closed or open is chance, now and then many times in a row."""
    closes = rng.random(4000) < closed

    def chattering(t):
        return pressing(15.0 / closed if t > 0.3 and closes[int(t * 1e3 + 0.5)] else 0.0)

    touch = CollisionDetector(dynamics, np.zeros(7), np.full(7, 3.0), 0.0, 6.0, 0.02, T)
    states = stand(touch, dynamics, chattering, seconds=3.5)
    assert max(np.abs(s.external).max() for s in states[40:]) > 3.0
    assert not any(touch.touched(s) for s in states)


def test_a_push_is_felt_while_the_tool_presses(dynamics):
    touch = CollisionDetector(dynamics, np.zeros(7), np.full(7, 3.0), 0.0, 6.0, 0.02, T)
    push = np.array([0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    states = stand(touch, dynamics, lambda _t: pressing(60.0), push=push)
    assert touch.touched(states[-1]).joint == 1
    np.testing.assert_allclose(states[-1].external, push, atol=1e-3)


def test_a_sensor_that_falls_silent_is_no_push(dynamics):
    """What it read is then what the arm is told to carry."""
    touch = CollisionDetector(dynamics, np.zeros(7), np.full(7, 3.0), 0.0, 6.0, 0.0, T)
    weight = pressing(0.0)
    state = stand(touch, dynamics, lambda _t: weight)[-1]
    tau = dynamics.torque(REACH, np.zeros(7), np.zeros(7))
    for k in range(100, 200):
        state = touch.measure(state, REACH, tau, None, k * T)
        assert touch.touched(state) is None
