import numpy as np
import pinocchio as pin
import pytest
from telerobot.server.control.mechanism.wrench import (
    INERTIA_PERIODS,
    ContactWrench,
    WrenchState,
    load_of,
)
from telerobot.server.control.spatial import Pose, rotation_exp

MASS, COM = 1.3, np.array([0.01, -0.02, 0.06])
NONE = np.zeros(6)
LOAD, NO_LOAD = load_of(MASS, COM, NONE), load_of(0.0, NONE[:3], NONE)
T = 0.01


@pytest.fixture
def force(random_pose):
    return ContactWrench(random_pose(0.1), 1.0, T)


def weight(R_world_sensor):
    """What holds the payload up against gravity, by Pinocchio's spatial algebra."""
    held = pin.Inertia(MASS, COM, np.zeros((3, 3)))
    up = pin.Motion(R_world_sensor.T @ np.array([0, 0, 9.81]), np.zeros(3))
    return (held * up).vector


def test_in_every_attitude_the_payloads_weight_is_taken_off(force, random_pose):
    for _ in range(50):
        T_world_wrist = random_pose()
        R = T_world_wrist.R @ force.T_wrist_sensor.R
        np.testing.assert_allclose(force.weight(R, LOAD), weight(R), atol=1e-12)
        state = force.measure(WrenchState(), weight(R), LOAD, T_world_wrist)
        np.testing.assert_allclose(state.wrench, 0.0, atol=1e-12)


def test_bias_is_taken_off_in_the_sensors_axes(force, rng, random_pose):
    bias, contact, T_world_wrist = rng.normal(size=6), rng.normal(size=6), random_pose()
    reading = contact + bias + weight(T_world_wrist.R @ force.T_wrist_sensor.R)
    state = force.measure(WrenchState(), reading, load_of(MASS, COM, bias), T_world_wrist)
    np.testing.assert_allclose(state.wrench, contact, atol=1e-12)


def test_the_wrench_at_the_mrf_is_pinocchios(force, rng, random_pose):
    for _ in range(20):
        T_wrist_mrf, wrench = random_pose(0.3), rng.normal(size=6)
        M = pin.SE3(T_wrist_mrf.R, T_wrist_mrf.p).inverse() * pin.SE3(
            force.T_wrist_sensor.R, force.T_wrist_sensor.p
        )
        expected = M.act(pin.Force(wrench)).vector
        found, hand = force.at_mrf(WrenchState(wrench, hand=0.5 * wrench), T_wrist_mrf)
        np.testing.assert_allclose(found, expected, atol=1e-12)
        np.testing.assert_allclose(hand, 0.5 * expected, atol=1e-12)


def test_a_stale_sensor_knows_no_wrench(force):
    state = force.measure(WrenchState(np.ones(6)), None, LOAD, Pose.identity())
    assert state.wrench is None
    assert force.at_mrf(state, Pose.identity()) == (None, None)


def test_the_filter_starts_at_the_first_sample_and_then_smooths():
    force = ContactWrench(Pose.identity(), 0.25, T, inertia=False)
    state, found = WrenchState(), []
    for value in (8.0, 0.0, 0.0):
        state = force.measure(state, np.full(6, value), NO_LOAD, Pose.identity())
        found.append(state.wrench[0])
    assert found == pytest.approx([8.0, 6.0, 4.5])


# --- a payload in motion --------------------------------------------------------------------------


def wrist_at(t):
    """A wrist that swings and turns: up to 0.6 m/s² and 1.6 rad/s²."""
    swing = 0.1 * np.array([np.sin(2.0 * t), np.cos(2.4 * t), np.sin(1.7 * t + 1)])
    return Pose(rotation_exp(0.5 * np.array([np.sin(1.8 * t), np.cos(1.5 * t), 0.3 * t])), swing)


def held_at(force, t, h=1e-4):
    """The reading that holds up and accelerates the payload at a time, by fine differences."""
    places = [wrist_at(t + k * h) @ force.T_wrist_sensor for k in (-1, 0, 1)]
    x0, x1, x2 = (T.R @ COM + T.p for T in places)
    f = MASS * places[1].R.T @ ((x0 - 2 * x1 + x2) / h**2 + [0, 0, 9.81])
    return np.concatenate([f, np.cross(COM, f)])


def seen(force, times, age_s=0.0, load=LOAD):
    """The wrenches (k, 6) that are taken for contact while nothing is touched."""
    state, found = WrenchState(), []
    for t in times:
        sample = held_at(force, t - age_s)
        state = force.measure(state, sample, load, wrist_at(t), t, age_s)
        found.append(state.wrench)
    return np.array(found)


@pytest.mark.parametrize("age_s", [0.0, 0.0025, 0.005, 0.009])
def test_a_swinging_payload_is_no_contact_however_old_its_sample(force, age_s):
    contact = np.abs(seen(force, np.arange(0, 6, T), age_s))[4:]
    assert contact[:, :3].max() < 0.02
    assert contact[:, 3:].max() < 0.002


def test_without_inertia_the_swing_is_felt(force):
    plain = ContactWrench(force.T_wrist_sensor, 1.0, T, inertia=False)
    assert np.abs(seen(plain, np.arange(0, 6, T))[:, :3]).max() > 0.5


def test_a_wrench_comes_as_late_as_it_is_said_to(force):
    state, found = WrenchState(), []
    for k in range(40):
        sample = held_at(force, 0.0) + np.array([k, 0, 0, 0, 0, 0.0])
        state = force.measure(state, sample, LOAD, wrist_at(0.0), k * T)
        found.append(state.wrench[0] - state.contact[0])
    assert found[-1] == pytest.approx(-INERTIA_PERIODS)


def test_ticks_that_were_missed_are_no_acceleration(force):
    times = np.concatenate([np.arange(0, 1, T), 1.03 + np.arange(0, 1, T)])
    contact = np.abs(seen(force, times))[4:]
    assert contact[:, :3].max() < 1.2  # without inertia for three ticks, never v / T


def test_of_a_payload_that_moves_in_jerks_the_mean_leaves_nothing(force):
    """A drive starts each period quickly and ends it slowly: one sample sees the end alone."""
    jerks, dt = 20, T / 20
    x, v, state, places = 0.0, 0.0, WrenchState(), force.T_wrist_sensor
    seen = {"newest": 0.0, "mean": 0.0}
    upright = weight(places.R)
    for k in range(60):
        rise, samples = 2.0 * np.sin(0.3 * k), []
        for i in range(jerks):
            a = 2.0 * rise * (1.0 - (i + 0.5) / jerks)
            x, v = x + dt * v + 0.5 * dt**2 * a, v + dt * a
            f = MASS * places.R.T @ np.array([a, 0.0, 0.0])
            samples.append(upright + np.concatenate([f, np.cross(COM, f)]))
        wrist = Pose(np.eye(3), np.array([x, 0.0, 0.0]))
        mean = (np.mean(samples, axis=0), 0.5 * T)
        state = force.measure(state, samples[-1], LOAD, wrist, k * T, mean=mean)
        if k > 4:
            seen["newest"] = max(seen["newest"], float(np.abs(state.wrench[:3]).max()))
            seen["mean"] = max(seen["mean"], float(np.abs(state.hand[:3]).max()))
    assert seen["newest"] > 0.7 * 2.0 * MASS
    assert seen["mean"] < 0.1 * 2.0 * MASS


def test_a_quick_tool_that_was_told_to_be_is_believed(force):
    bounded = ContactWrench(force.T_wrist_sensor, 1.0, T, max_acceleration=0.3)
    felt = {}
    for commanded in (0.0, 5.0):
        state = WrenchState()
        for k in range(20):
            place = Pose(np.eye(3), np.array([0.5 * 4.0 * (k * T) ** 2, 0.0, 0.0]))
            f = MASS * force.T_wrist_sensor.R.T @ np.array([4.0, 0.0, 9.81])
            reading = np.concatenate([f, np.cross(COM, f)])
            state = bounded.measure(state, reading, LOAD, place, k * T, commanded=commanded)
        felt[commanded] = float(np.linalg.norm(state.wrench[:3]))
    assert felt[0.0] == pytest.approx(3.7 * MASS, rel=1e-6)
    assert felt[5.0] < 1e-6


def test_what_no_tool_can_do_is_taken_for_a_late_sync(force):
    """A SYNC 3 ms late looks like 1.5 m/s² and more."""
    bounded = ContactWrench(force.T_wrist_sensor, 1.0, T, max_acceleration=0.3)
    state = WrenchState()
    worst = 0.0
    for k in range(100):
        late = 0.003 if k == 50 else 0.0
        place = Pose(np.eye(3), np.array([0.5 * (k * T + late), 0.0, 0.0]))
        reading = weight(place.R @ force.T_wrist_sensor.R)
        state = bounded.measure(state, reading, LOAD, place, k * T)
        worst = max(worst, np.abs(state.wrench[:3]).max())
    assert 0.0 < worst < 1.01 * 0.3 * MASS


def test_cross_talk_is_taken_off_by_the_calibration(force, rng, random_pose):
    response = np.eye(6) + 0.02 * rng.normal(size=(6, 6))
    corrected = ContactWrench(force.T_wrist_sensor, 1.0, T, np.linalg.inv(response))
    contact, bias, T_world_wrist = rng.normal(size=6), rng.normal(size=6), random_pose()
    R = T_world_wrist.R @ force.T_wrist_sensor.R
    reading = response @ (contact + weight(R)) + bias
    state = corrected.measure(WrenchState(), reading, load_of(MASS, COM, bias), T_world_wrist)
    np.testing.assert_allclose(state.wrench, contact, atol=1e-12)
    np.testing.assert_allclose(corrected.weight(R, LOAD), response @ weight(R), atol=1e-12)
