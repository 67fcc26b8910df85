"""A sensor with a bias that nobody told of, or that was told wrong, does not swing the arm."""

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.tools.scripts.script import Script
from telerobot.tools.simulation.simulation import Simulation

from ..conftest import Run

STICK = {"twist": [0.0, 0.1, 0.05, 0.0, 0.0, 0.2], "expressed_in": "base"}
HAND = {"mass": 0.98, "com": [0.0, 0.0, 0.051]}
FORCES = [
    (50.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    (-50.0, 0.0, 0.0, 0.0, 0.0, 0.0),  # straight down, as a weight at the sensor itself
    (0.0, 50.0, 0.0, 0.0, 0.0, 0.0),
]
WRENCHES = [
    (100.0, 0.0, 0.0, 0.0, 10.0, 0.0),
    (-100.0, 0.0, 0.0, 0.0, -10.0, 0.0),
    (0.0, 0.0, -100.0, 0.0, 0.0, 10.0),
]


def cell(mode, bias=(0.0,) * 6, **rig):
    """Return the cell whose sensor has a bias (6,) more than the daemon is told.

    Its motors give torque as soon as the brakes open: nothing sinks before.
    """
    loaded = load_cell("pa10_hand_torque")
    told = np.subtract(loaded.config.mechanism.force_torque.bias, bias)
    return altered(
        loaded,
        {
            "mechanism.operation_mode": mode,
            "mechanism.force_torque.bias": tuple(told),
            "rig.drive.torque_delay_s": 0.0,
            **{f"rig.{key}": value for key, value in rig.items()},
        },
    )


def play(cell, *steps, seconds):
    script = Script.model_validate({"duration_s": seconds, "step": list(steps)})
    simulation = Simulation(cell, script)
    return Run(simulation, simulation.run())


def way(run, from_s, to_s):
    """Return the greatest distance of the true tool from where it was [m]."""
    start = run.simulation.player.start_s
    places = [t.pose_mrf[:3] for t in run.truths if from_s <= t.time_s - start <= to_s]
    return np.linalg.norm(np.subtract(places, places[0]), axis=1).max()


@pytest.mark.parametrize(
    ("mode", "bias"),
    [("cst", bias) for bias in FORCES + WRENCHES] + [("csp", WRENCHES[0]), ("csv", WRENCHES[0])],
)
def test_a_biased_sensor_does_not_swing_the_arm_as_it_is_enabled_and_driven(mode, bias):
    steps = [
        {"at_s": 1.0, "cmd/joystick": STICK},
        {"at_s": 1.8, "cmd/joystick": {"twist": [0.0] * 6}},
    ]
    run = play(cell(mode, bias), *steps, seconds=2.2)
    assert way(run, -1.0, 1.0) < 5e-3
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0


@pytest.mark.parametrize("mode", ["csp", "cst"])
@pytest.mark.parametrize("bias", WRENCHES)
def test_a_bias_that_is_told_wrong_moves_nothing_before_it_is_acknowledged(mode, bias):
    steps = [
        {"at_s": 0.6, "operator/payload": {**HAND, "bias": list(bias)}},
        {"at_s": 1.2, "operator/acknowledge_load": {}},
        {"at_s": 1.3, "cmd/joystick": STICK},
    ]
    run = play(cell(mode), *steps, seconds=2.0)
    assert way(run, 0.6, 1.2) < 5e-3
    assert way(run, 1.2, 2.0) > 50e-3
    assert run.summary["mode"] == "enabled"
    assert run.summary["limit_violations"] == 0


def test_a_bias_is_still_known_when_the_arm_is_enabled_again():
    steps = [
        {"at_s": 0.8, "operator/mode": {"action": "disable"}},
        {"at_s": 1.4, "operator/mode": {"action": "enable"}},
    ]
    run = play(cell("cst", WRENCHES[0]), *steps, seconds=2.4)
    assert way(run, -1.0, 2.4) < 5e-3
    assert run.summary["mode"] == "enabled"


@pytest.mark.parametrize("kg", [-3.0, 3.0])
def test_a_payload_that_was_told_wrong_is_held_all_the_same(kg):
    at = (0.0, 0.0, 0.051)
    laden = cell("cst", payload_mass=max(kg, 0.0), payload_com=at)
    if kg < 0.0:
        sensor = laden.config.mechanism.force_torque
        laden = altered(laden, {"mechanism.force_torque.payload.mass": sensor.payload.mass - kg})
    run = play(laden, seconds=2.0)
    assert way(run, -1.0, 2.0) < 5e-3
    assert way(run, 1.8, 2.0) < 1e-3


@pytest.mark.parametrize("force", [(20.0, 0.0, 0.0), (0.0, -20.0, 0.0)])
def test_a_hand_that_pushes_is_answered_whatever_the_bias(force):
    push = {
        "at_s": 2.8,
        "rig/fault": {"kind": "hand", "target": "force_torque", "vector": list(force)},
    }
    told = {"at_s": 0.8, "operator/tare": {}}
    led = [play(cell("cst", bias), told, push, seconds=3.5) for bias in ((0.0,) * 6, WRENCHES[0])]
    ways = [way(run, 2.8, 3.5) for run in led]
    assert ways[0] > 0.2
    assert ways[1] == pytest.approx(ways[0], rel=0.05)
