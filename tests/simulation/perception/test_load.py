"""A load that no contact explains is said, and moves nothing; real contact is bled off as ever."""

import json

import numpy as np
import pytest
from telerobot.config.load import altered, load_cell
from telerobot.config.schema.mechanism import PayloadSection
from telerobot.server.perception.wrench import ForceTorqueMonitor

HAND = {"mass": 0.98, "com": (0.0, 0.0, 0.051)}
HEAVIER = PayloadSection(mass=5.98, com=(0.0, 0.0, 0.051))
BIAS = (50.4, -0.3, 0.6, 0.01, -0.02, 0.01)
PUSH = {"kind": "push", "target": "force_torque", "vector": [0.0, 20.0, 0.0]}
REST = {"twist": [0.0] * 6}


def changed(cell, sensor=None, rig=None, mode="csp"):
    """Return a cell whose daemon is told other things of the sensor, or whose rig is another."""
    cell = altered(cell, sensor or {}, "mechanism.force_torque")
    return altered(altered(cell, rig or {}, "rig"), {"mechanism.operation_mode": mode})


def way(run, from_s, to_s):
    """Return the greatest distance of the true tool from where it was [m]."""
    start = run.simulation.player.start_s
    places = [t.pose_mrf[:3] for t in run.truths if from_s <= t.time_s - start <= to_s]
    return np.linalg.norm(np.subtract(places, places[0]), axis=1).max()


@pytest.mark.parametrize(
    ("sensor", "rig", "mass_kg"),
    [
        ({"payload": HEAVIER}, {}, -5.0),
        ({}, {"payload_mass": 5.0, "payload_com": (0.0, 0.0, 0.1)}, 5.0),
    ],
    ids=["told too heavy", "told too light"],
)
def test_a_payload_that_is_told_wrong_is_said_and_does_not_move_the_arm(
    play, pa10, sensor, rig, mass_kg
):
    run = play(cell=changed(pa10, sensor, rig), seconds=4.0)
    (said,) = run.events("load_unexplained")
    assert said.values["force_n"] == pytest.approx(5.0 * 9.81, abs=0.5)
    assert said.values["mass_kg"] == pytest.approx(mass_kg, abs=0.05)
    assert said.values["off_vertical_deg"] < 3.0
    assert run.events("touched") == []
    assert run.summary["mode"] == "enabled"
    assert way(run, 0.3, 4.0) < 3.5e-3
    assert way(run, 1.0, 4.0) < 0.5e-3


def test_of_an_arm_that_stands_nobody_asks_for_thirty_readings_without_the_payload(
    play, pa10, monkeypatch
):
    asked, unloaded = [], ForceTorqueMonitor.unloaded.fget

    def counted(monitor):
        asked.append(monitor)
        return unloaded(monitor)

    monkeypatch.setattr(ForceTorqueMonitor, "unloaded", property(counted))
    run = play(cell=pa10, seconds=5.0)
    assert run.states[-1].on["force"]
    assert run.summary["mode"] == "enabled"
    assert asked == []


def test_a_sensor_that_is_biased_is_said_and_a_tare_is_the_way_out(play, pa10):
    steps = [{"at_s": 2.0, "operator/tare": {}}, {"at_s": 3.5, "rig/fault": PUSH}]
    run = play(*steps, cell=changed(pa10, {"bias": BIAS}), seconds=5.0)
    (said,) = run.events("load_unexplained")
    found = np.array(json.loads(said.values["bias"]))
    np.testing.assert_allclose(found, pa10.config.rig.force_torque.bias, atol=0.2)
    assert run.events("touched") == []
    assert way(run, 0.3, 3.4) < 3.5e-3
    assert way(run, 3.5, 4.9) > 10e-3


def test_telling_the_payload_is_the_other_way_out(play, pa10):
    steps = [{"at_s": 2.0, "operator/payload": HAND}, {"at_s": 3.5, "rig/fault": PUSH}]
    run = play(*steps, cell=changed(pa10, {"payload": HEAVIER}), seconds=5.0)
    assert len(run.events("load_unexplained")) == 1
    assert way(run, 1.0, 3.4) < 1e-3
    assert way(run, 3.5, 4.9) > 10e-3


def test_what_is_acknowledged_acts(play, pa10):
    steps = [{"at_s": 2.0, "operator/acknowledge_load": {}}]
    run = play(*steps, cell=changed(pa10, {"payload": HEAVIER}), seconds=3.0)
    assert len(run.events("load_acknowledged")) == 1
    assert way(run, 1.0, 1.99) < 0.5e-3
    assert way(run, 2.0, 3.0) > 20e-3


def test_following_a_hand_does_not_follow_a_load(play):
    cell = changed(load_cell("pa10_hand"), {"payload": HEAVIER})
    run = play(cell=cell, seconds=4.0)
    assert len(run.events("load_unexplained")) == 1
    assert way(run, 0.3, 4.0) < 3.5e-3


def test_a_payload_that_is_told_wrong_while_enabled_is_said(play):
    run = play({"at_s": 1.0, "operator/payload": {**HAND, "mass": 5.98}}, seconds=4.0)
    (said,) = run.events("load_unexplained")
    assert said.values["mass_kg"] == pytest.approx(-5.0, abs=0.05)
    assert way(run, 1.0, 4.0) < 6e-3


@pytest.mark.parametrize(("mode", "stiffness"), [("csp", 2e3), ("csp", 2e4), ("cst", 2e3)])
def test_contact_when_the_arm_is_enabled_is_bled_off(play, pa10, mode, stiffness):
    run = play(
        {"at_s": 0.1, "cmd/posture": {"posture": "ready"}},
        {"at_s": 3.2, "cmd/joystick": {"twist": [0.05, 0, 0, 0, 0, 0], "expressed_in": "base"}},
        {"at_s": 6.5, "operator/mode": {"action": "disable"}},
        {"at_s": 6.5, "cmd/joystick": REST},
        {"at_s": 7.5, "operator/mode": {"action": "enable"}},
        cell=changed(pa10, rig={"wall.stiffness": stiffness}, mode=mode),
        seconds=12.0,
    )
    assert np.linalg.norm(run.at(7.4).wrench_mrf[:3]) > 20.0
    assert np.linalg.norm(run.truths[-1].contact_force) < 3.0
    assert run.events("load_unexplained") == []
    assert run.events("touched") == []


def test_contact_of_a_tool_with_an_unexplained_load_stops_the_arm(play, pa10):
    run = play(
        {"at_s": 0.1, "cmd/posture": {"posture": "ready"}},
        {"at_s": 3.2, "cmd/joystick": {"twist": [0.03, 0, 0, 0, 0, 0], "expressed_in": "base"}},
        cell=changed(pa10, {"bias": BIAS}),
        seconds=8.0,
    )
    (felt,) = run.events("touched")
    assert felt.values["joint"] == "tool"
    assert run.summary["mode"] == "hold"
    assert max(np.linalg.norm(t.contact_force) for t in run.truths) < 100.0


@pytest.mark.parametrize(
    ("sensor", "rig"),
    [({"bias": BIAS}, {}), ({}, {"payload_mass": 5.0, "payload_com": (0.0, 0.0, 0.1)})],
    ids=["bias", "told too light"],
)
def test_a_tool_that_turns_in_the_air_with_an_unexplained_load_touches_nothing(
    play, pa10, sensor, rig
):
    """A weight turns in the sensor's axes, a bias in World's, and neither is contact."""
    turns = [[0.0, 0.6, 0.0], [0.0, -0.6, 0.3], [0.6, 0.0, 0.0], [-0.6, 0.0, -0.3]]
    sticks = [
        {"at_s": 3.0 + 1.2 * i, "cmd/joystick": {"twist": [0.0, 0.0, 0.05 * (-1) ** i, *turn]}}
        for i, turn in enumerate(turns)
    ]
    ready = {"at_s": 0.8, "cmd/posture": {"posture": "ready"}}
    run = play(ready, *sticks, cell=changed(pa10, sensor, rig), seconds=7.8)
    assert len(run.events("load_unexplained")) == 1
    assert run.events("touched") == []
    attitudes = np.array([t.pose_mrf[3:] for t in run.truths])
    assert np.ptp(attitudes, axis=0).max() > 0.4


def test_a_payload_that_is_said_to_be_unknown_moves_nothing_either(play, pa10):
    cell = changed(pa10, {"payload": HEAVIER})
    run = play({"at_s": 0.05, "operator/payload": {"unknown": True}}, cell=cell, seconds=2.0)
    assert run.events("load_unexplained") == []
    assert len(run.events("load_unknown")) == 1
    assert way(run, 0.3, 2.0) < 1e-3
