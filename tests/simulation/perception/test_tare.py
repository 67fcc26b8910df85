"""A tare on a live arm: what is no contact is taken for none, and what is one is not."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell

TARE = {"operator/tare": {}}


def wrong_bias(name, bias):
    """Return a cell whose daemon takes another bias for the sensor's than it has."""
    cell = load_cell(name)
    mechanism = cell.config.mechanism
    sensor = mechanism.force_torque.model_copy(update={"bias": bias})
    mechanism = mechanism.model_copy(update={"force_torque": sensor})
    return altered(cell, {"mechanism": mechanism})


def moments_and_forces(run, from_s):
    start = run.simulation.player.start_s
    return np.mean([s.wrench_mrf for s in run.states if s.time_s - start > from_s], axis=0)


@pytest.mark.parametrize("name", ["pa10_peg", "pa10"])
def test_an_arm_that_follows_the_sensors_noise_is_tared(play, name):
    """Force control is on: it moves by what the sensor reads, the noise of it included."""
    true = np.array(load_cell(name).config.rig.force_torque.bias)
    cell = wrong_bias(name, tuple((true + np.repeat([0.3, 0.01], 3)).tolist()))
    run = play({"at_s": 2.0, **TARE}, seconds=4.0, cell=cell)
    assert run.summary["refused"] == []
    moving = np.array([s.dq_command for s in run.states[150:200]])
    assert np.abs(moving).max() > 0.0
    left = moments_and_forces(run, 3.0)
    assert np.abs(left[:3]).max() < 0.05
    assert np.abs(left[3:]).max() < 5e-3


def refusals(run):
    return [line for line in run.summary["refused"] if "tare" in line]


def test_what_a_stick_pushes_against_a_wall_is_no_bias(play):
    """The arm stands there: the push is what force control and stick agree on."""
    push = {"twist": [0.0, 0.0, 0.01, 0.0, 0.0, 0.0], "relative_to": "mrf", "expressed_in": "mrf"}
    steps = [
        {"at_s": 0.2, "cmd/posture": {"posture": "ready"}},
        {"at_s": 3.5, "cmd/joystick": {**push, "twist": [0.0, 0.0, 0.05, 0.0, 0.0, 0.0]}},
        {"at_s": 5.5, "cmd/joystick": push},
        {"at_s": 9.0, **TARE},
    ]
    run = play(*steps, seconds=9.5)
    force = moments_and_forces(run, 9.2)[:3]
    assert np.linalg.norm(force) > 5.0
    stood = run.speeds(8.6, 9.0)
    assert np.abs(stood.mean(axis=0)).max() < 2e-3
    assert len(refusals(run)) == 1
    assert "the arm moves, or is told to" in refusals(run)[0]


def test_an_arm_that_is_jogged_slowly_is_not_tared(play):
    rates = [0.0] * 6 + [0.01]
    run = play({"at_s": 0.5, "cmd/jog": {"rates": rates}}, {"at_s": 1.5, **TARE}, seconds=2.0)
    assert len(refusals(run)) == 1
