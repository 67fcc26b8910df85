"""Speed by wheels and accelerometer, against closed forms: spins, slopes, pushes, levers."""

import numpy as np
import pytest
from telerobot.server.perception.ahead import GroundSpeed

T, G, BIAS, NOISE = 0.01, 9.80665, 0.12, 0.02


def told(speed, wheels, *, pitch=None, turn=None, at=(0.0, 0.0)):
    """Run a filter; return what it missed by tick [m], and the filter.

    `speed`, `wheels` (k,) [m/s], `pitch` (k,) [rad] of Base's nose downwards, `turn` (k,) [rad/s].
    """
    rng, k = np.random.default_rng(3), len(speed)
    pitch = np.zeros(k) if pitch is None else pitch
    turn = np.zeros(k) if turn is None else turn
    ahead = np.diff(speed, prepend=speed[0]) / T - G * np.sin(pitch) + BIAS
    ahead -= turn**2 * at[0] + np.diff(turn, prepend=0.0) / T * at[1]
    felt = np.zeros((k, 6))
    felt[:, 0] = ahead + NOISE * rng.normal(size=k)
    felt[:, 4] = np.diff(pitch, prepend=pitch[0]) / T + 0.001 * rng.normal(size=k)
    felt[:, 5] = turn
    found = GroundSpeed(0.05, np.array(at), T)
    return np.array([found.missed(*each) for each in zip(felt, wheels, strict=True)]), found


def ramp(seconds, *at):
    """Return values (k,) through points (time, value)."""
    return np.interp(np.arange(0.0, seconds, T), *np.transpose(at))


def test_wheels_that_spin_on_the_spot_are_missed_by_all_that_they_roll():
    """Until they are seen, too: from the first millimetre on."""
    wheels = ramp(4.0, (1.0, 0.0), (1.4, 0.3), (3.0, 0.3), (3.3, 0.0))
    missed, found = told(0.0 * wheels, wheels)
    assert missed.sum() == pytest.approx(-wheels.sum() * T, rel=0.05)
    seen = np.flatnonzero(missed)[0] * T
    assert 1.0 < seen < 1.2
    assert found.slips is False


def test_a_base_that_is_pushed_away_below_wheels_that_stand_is_followed_until_it_rests():
    speed = ramp(5.0, (1.0, 0.0), (1.5, 0.4), (3.0, 0.0))
    missed, found = told(speed, 0.0 * speed)
    assert missed.sum() == pytest.approx(speed.sum() * T, rel=0.05)
    assert found.slips is False


def test_one_that_grips_misses_nothing_whatever_its_bias_speed_lever_and_turn():
    speed = ramp(6.0, (1.0, 0.0), (1.5, 0.5), (3.0, 0.5), (4.0, -0.5), (5.0, 0.0))
    turn = ramp(6.0, (1.0, 0.0), (1.5, 1.0), (3.5, -1.0), (5.0, 0.0))
    missed, _ = told(speed, speed, turn=turn, at=(0.4, -0.3))
    assert not missed.any()


def test_a_slope_that_it_drives_onto_is_no_slip_where_the_gyroscope_sees_it_pitch():
    """At 5 degrees gravity adds 0.85 m/s² within 0.3 s."""
    speed = ramp(6.0, (1.0, 0.0), (1.5, 0.3))
    missed, found = told(speed, speed, pitch=ramp(6.0, (2.5, 0.0), (2.8, -0.087)))
    assert not missed.any()
    assert found.slips is False


def test_after_a_unit_was_silent_the_wheels_are_believed():
    missed, found = told(ramp(2.0, (1.0, 0.0), (1.2, 0.3)), np.zeros(200))
    assert missed.any()
    assert found.slips
    assert found.missed(None, 0.3) == 0.0
    assert found.slips is False


def test_what_reads_evenly_something_else_beside_wheels_that_stand_has_another_bias():
    """Lifted onto a slope with its gyroscope silent: after three seconds that counts as level."""
    found, rest = GroundSpeed(0.05, np.zeros(2), T), np.zeros(6)
    slope = np.array([0.3, 0.0, G, 0.0, 0.0, 0.0])
    assert not any(found.missed(rest, 0.0) for _ in range(100))
    missed = np.array([found.missed(slope, 0.0) for _ in range(600)])
    assert missed[100:300].all()
    assert not missed[400:].any()
