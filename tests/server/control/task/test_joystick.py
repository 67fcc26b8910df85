import numpy as np
from telerobot.config.schema.sources import JoystickSection
from telerobot.server.control.inputs import StickCommand
from telerobot.server.control.task.sources import Joystick, JoystickState

from .shown import SHAPING, A, J, T, shown

ONE, WORLD = np.ones(6), np.eye(3)
TURN = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def held_at(twist, axes=WORLD):
    """Return what a stick at `twist` shows, None for one that fell silent."""
    return shown(stick=None if twist is None else StickCommand(twist, axes))


def hold(source, twist, seconds, state=None, axes=WORLD, gain=ONE):
    """Hold the stick; return the twists that came of it, and the last state."""
    state, rates = state or JoystickState.idle(), []
    for _ in range(round(seconds / T)):
        rate, state = source.rate(held_at(twist, axes), state, gain)
        rates.append(rate)
    return np.array(rates), state


def in_bounds(rates):
    rates = np.vstack([np.zeros((2, 6)), rates])
    assert (np.abs(np.diff(rates, axis=0)) <= A * T * (1 + 1e-6)).all()
    assert (np.abs(np.diff(rates, 2, axis=0)) <= J * T**2 * (1 + 1e-6)).all()


def test_the_stick_is_followed_inside_acceleration_and_jerk(rng):
    for _ in range(10):
        twist = rng.uniform(-1, 1, 6) * [0.3, 0.3, 0.3, 1, 1, 1]
        rates, _ = hold(Joystick(JoystickSection(), SHAPING), twist, 1.0)
        in_bounds(rates)
        np.testing.assert_allclose(rates[-1], twist, atol=1e-9)


def test_a_stick_that_falls_silent_fades_to_exactly_nothing_in_the_same_direction(rng):
    for _ in range(10):
        direction = rng.normal(size=6)
        twist = 0.3 * direction / np.linalg.norm(direction)
        source = Joystick(JoystickSection(), SHAPING)
        held, state = hold(source, twist, 1.0)
        faded, state = hold(source, None, 1.0, state)
        in_bounds(np.vstack([held, faded]))
        assert not faded[-1].any()
        assert faded[0] @ twist > 0
        for rate in faded:
            sideways = rate - (rate @ twist) / (twist @ twist) * twist
            assert np.linalg.norm(sideways) <= 0.05 * np.linalg.norm(twist)
        speeds = faded @ twist
        assert (np.diff(speeds) <= 1e-12).all()
        assert (speeds >= -1e-12).all()


def test_a_braking_stick_goes_the_same_way_to_rest_in_half_the_time(rng):
    twist = rng.uniform(-1, 1, 6) * [0.3, 0.3, 0.3, 1, 1, 1]
    plain, quick = (Joystick(JoystickSection(braking=b), SHAPING) for b in (1.0, 2.0))
    held, state = hold(plain, twist, 1.0)
    same, _ = hold(quick, twist, 1.0)
    np.testing.assert_array_equal(same, held)
    slow, _ = hold(plain, None, 1.0, state)
    for released in (None, np.zeros(6)):
        fast, _ = hold(quick, released, 0.5, state)
        np.testing.assert_allclose(fast, slow[1::2], atol=1e-8)


def test_a_braking_stick_that_is_taken_up_again_goes_on_inside_its_own_bounds():
    source, twist = Joystick(JoystickSection(braking=2.0), SHAPING), np.full(6, 0.3)
    _, state = hold(source, twist, 1.0)
    released, state = hold(source, None, 0.03, state)
    rates, state = hold(source, twist, 1.0, state)
    steps = np.diff(np.vstack([released, rates]), 2, axis=0)
    assert (np.abs(steps) <= 4.0 * J * T**2 * (1 + 1e-6)).all()
    assert (np.abs(steps[4:]) <= J * T**2 * (1 + 1e-6)).all()
    np.testing.assert_allclose(rates[-1], twist, atol=1e-9)


def test_a_stick_thrown_from_side_to_side_breaks_no_bound(rng):
    source, state, rates = Joystick(JoystickSection(), SHAPING), JoystickState.idle(), []
    for _ in range(300):
        twist = None if rng.random() < 0.1 else rng.choice([-0.5, 0.5], 6)
        for _ in range(rng.integers(1, 12)):
            rate, state = source.rate(held_at(twist), state, ONE)
            rates.append(rate)
    in_bounds(np.array(rates))


def test_gains_apply_in_the_axes_that_the_stick_names():
    gain = np.array([1.0, 0.0, 1.0, 0.5, 1.0, 1.0])
    rates, _ = hold(
        Joystick(JoystickSection(), SHAPING), np.full(6, 0.2), 1.0, axes=TURN, gain=gain
    )
    # The stick's x is World's y, its y is World's −x and is switched off.
    np.testing.assert_allclose(rates[-1], [0.0, 0.2, 0.2, -0.2, 0.1, 0.2], atol=1e-9)


def test_an_untouched_stick_asks_for_nothing():
    idle = JoystickState.idle()
    rate, state = Joystick(JoystickSection(), SHAPING).rate(held_at(None), idle, ONE)
    assert not rate.any()
    assert state is idle
