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

    Its motors give torque as soon as the brakes open: nothing sinks before. Joints do not feel that
    the sensor lies, which would stop the arm: what the torque law makes of it is the subject.
    """
    loaded = load_cell("pa10_hand_torque")
    told = np.subtract(loaded.config.mechanism.force_torque.bias, bias)
    return altered(
        loaded,
        {
            "mechanism.operation_mode": mode,
            "mechanism.force_torque.bias": tuple(told),
            "rig.drive.torque_delay_s": 0.0,
            "touch": None,
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


# --- a zero that goes off while the arm stands ----------------------------------------------------


def standing(vector, comes_s=0.0, seconds=8.0):
    """Return the run of an arm that nobody moves, whose sensor's zero goes off by newtons (3,)."""
    off = {"kind": "bias", "target": "force_torque", "vector": vector, "value": comes_s}
    return play(load_cell("pa10"), {"at_s": 1.0, "rig/fault": off}, seconds=seconds)


@pytest.mark.parametrize(
    "zero", [(1.0, 0.0, 0.0), (0.0, 2.5, 0.0), (0.0, 0.0, -2.5), (0.4, 0.3, 0.0)]
)
def test_a_zero_that_is_a_little_off_leads_the_tool_a_little_way_and_no_farther(zero):
    """Force control would answer it for ever: 2.5 N by 1.75 mm/s."""
    run = standing(zero)
    assert run.summary["mode"] == "enabled"
    assert [e.values["force_n"] for e in run.events("force_unchanging")] == [
        pytest.approx(np.linalg.norm(zero), rel=0.1)
    ]
    assert way(run, 1.0, 8.0) < 1e-3 + 3.5 * 7e-4 * np.linalg.norm(zero)
    assert way(run, 6.5, 8.0) < 0.2e-3


def test_a_zero_that_drifts_on_is_followed_until_it_is_told():
    run = standing((0.0, 0.0, 6.0), 20.0, seconds=22.0)
    assert way(run, 1.0, 22.0) < 10e-3
    assert way(run, 18.0, 22.0) < 0.2e-3
    assert len(run.events("load_unexplained")) == 1
    assert len(run.events("force_unchanging")) >= 2


def test_a_load_of_two_newtons_sinks_two_millimetres_and_a_hand_is_answered_then_as_ever():
    """A weight hangs straight down, and is known sooner than what pushes from the side."""
    weight = {"kind": "push", "target": "force_torque", "vector": (0.0, 0.0, -2.0)}
    hand = {"kind": "hand", "target": "force_torque", "vector": (0.0, 15.0, -2.0), "value": 4.0}
    run = play(
        load_cell("pa10"),
        {"at_s": 1.0, "rig/fault": weight},
        {"at_s": 5.0, "rig/fault": hand},
        seconds=9.0,
    )
    assert way(run, 1.0, 5.0) < 2.5e-3
    (said,) = run.events("force_unchanging")
    assert "+0.21 kg that nobody told of" in said.detail
    assert said.time_s - run.simulation.player.start_s < 2.5
    # K_F times the impulse of a force that swells and dies away like a raised cosine.
    assert way(run, 5.0, 9.0) == pytest.approx(7e-4 * 15.0 * 2.0, rel=0.2)


def test_a_payload_that_is_told_does_not_let_the_zero_go_off_twice_as_far():
    cell, fault = load_cell("pa10"), {"kind": "bias", "target": "force_torque"}
    payload = cell.config.mechanism.force_torque.payload
    run = play(
        cell,
        {"at_s": 0.5, "rig/fault": {**fault, "vector": (2.5, 0.0, 0.0)}},
        {"at_s": 3.0, "operator/payload": {"mass": payload.mass, "com": list(payload.com)}},
        {"at_s": 4.0, "rig/fault": {**fault, "vector": (5.0, 0.0, 0.0)}},
        seconds=7.0,
    )
    assert run.summary["refused"] == []
    assert len(run.events("payload_set")) == len(run.events("force_unchanging")) == 1
    (said,) = run.events("load_unexplained")
    assert said.time_s - run.simulation.player.start_s > 4.5
